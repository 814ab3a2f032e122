"""The desk that all parts of the service report to; it keeps the delays and writes to the store."""

from __future__ import annotations

import secrets
import threading
import time
from collections.abc import Callable
from datetime import UTC, datetime
from functools import partial
from typing import Unpack

import structlog

from server.alarms import alarm_lifecycle as lifecycle
from server.alarms.alarm_conditions import KINDS, Severity, Timer, step
from server.alarms.alarm_lifecycle import Alarm
from server.alarms.alarm_store import AlarmStore
from server.platform.database.engine import Database, Page
from server.platform.database.lists import Narrowing
from server.platform.errors import PreconditionError
from server.platform.http.route_parameters import Tags

_log = structlog.stdlib.get_logger(__name__)


class Alarms:
    """All alarms of a service.

    Parameters
    ----------
    clock : s, monotonic: delays must not know that the wall's clock was set
    """

    def __init__(self, database: Database, clock: Callable[[], float] = time.monotonic) -> None:
        self._database = database
        self._store = AlarmStore(database)
        self._clock = clock
        self._lock = threading.Lock()
        # What was active when the service ended is active until somebody reports otherwise.
        self._timers = {(alarm.machine, alarm.kind): Timer(on=True) for alarm in self._store.active()}

    def report(self, machine: str | None, kind: str, text: str, severity: Severity, on: bool) -> None:
        """Say whether something is wrong; say it again and again where the kind has a delay.

        Parameters
        ----------
        machine : None: the service as a whole
        kind : one of :data:`KINDS`
        text : one line: what is wrong and what to do; of no account while ``on`` is False
        on : whether the condition holds now
        """
        with self._lock:
            timer = self._timers.get((machine, kind), Timer())
            after = step(timer, KINDS[kind], on, self._clock())
            if after.on:
                if on:
                    new = Alarm(f"alarm-{secrets.token_hex(8)}", machine, kind, text, severity, self._database.now())
                    self._store.set(machine, kind, partial(lifecycle.raise_, new=new))
            elif timer.on:
                self._store.set(machine, kind, self._cleared)
            self._timers[machine, kind] = after
        if after.on != timer.on:
            _log.warning("alarm_raised" if on else "alarm_cleared", machine=machine, kind=kind, text=text)

    def _cleared(self, alarm: Alarm | None) -> Alarm | None:
        return None if alarm is None else lifecycle.clear(alarm, self._database.now())

    def sweep(self) -> None:
        """Take those off the shelf whose time is over."""
        now = self._now()
        for alarm in self._store.shelved():
            if lifecycle.expired(alarm, now):
                self._store.change(alarm.id, lifecycle.unshelve)

    def get(self, id: str) -> Alarm:
        """The alarm; NotFoundError if there is none."""
        return self._store.get(id)

    def list(self, limit: int, after: int = 0, **narrowed: Unpack[Narrowing]) -> Page[Alarm]:
        """Newest first, see :meth:`AlarmStore.list`."""
        return self._store.list(limit, after, **narrowed)

    def active(self) -> tuple[Alarm, ...]:
        """All that are active."""
        return self._store.active()

    def open(self) -> tuple[Alarm, ...]:
        """All that are active, or that nobody acknowledged."""
        return self._store.open()

    def since(self, machine: str, since: str, limit: int) -> tuple[Alarm, ...]:
        """Those of a machine that came or went since, or are active, see :meth:`AlarmStore.since`."""
        return self._store.since(machine, since, limit)

    def acknowledge(self, id: str, who: str, tags: Tags = None) -> Alarm:
        """Somebody has seen it; doing it twice changes nothing. For ``tags`` see :meth:`unshelve`."""
        return self._change(id, partial(lifecycle.acknowledge, who=who), tags)

    def shelve(self, id: str, who: str, reason: str, seconds: float, tags: Tags = None) -> Alarm:
        """Keep it quiet for a while. For ``tags`` see :meth:`unshelve`."""
        now = self._now()
        return self._change(
            id, lambda alarm: lifecycle.shelve(alarm, who=who, reason=reason, seconds=seconds, now=now), tags
        )

    def unshelve(self, id: str, tags: Tags = None) -> Alarm:
        """Take it off the shelf; one that is on none stays as it is.

        Raises
        ------
        PreconditionError
            If ``tags`` are given and the alarm has changed since it had one of them
            (:func:`server.alarms.alarm_lifecycle.tag`).
        """
        return self._change(id, lifecycle.unshelve, tags)

    def _change(self, id: str, to: Callable[[Alarm], Alarm], tags: Tags) -> Alarm:
        def checked(alarm: Alarm) -> Alarm:
            if tags is not None and lifecycle.tag(alarm) not in tags:
                raise PreconditionError(f"alarm '{id}' has changed meanwhile; read it again")
            return to(alarm)

        return self._store.change(id, checked)

    def _now(self) -> datetime:
        return datetime.fromisoformat(self._database.now()).astimezone(UTC)
