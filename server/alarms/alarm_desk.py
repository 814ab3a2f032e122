"""The desk that all parts of the service report to: alarms in the store, and the delays before they come there."""

from __future__ import annotations

import secrets
import threading
import time
from collections.abc import Callable
from datetime import UTC, datetime
from functools import partial

import sqlalchemy as sa
import structlog

from server.alarms import alarm_lifecycle as lifecycle
from server.alarms.alarm_lifecycle import KINDS, Alarm, Severity, Timer, step
from server.platform.database.engine import Database
from server.platform.database.repository import Repository
from server.platform.database.schema import put_out
from server.platform.errors import PreconditionError
from server.platform.http.route_parameters import Tags

alarms = Alarm.table
_ACTIVE = alarms.c.state == "active"
_log = structlog.stdlib.get_logger(__name__)


class Alarms(Repository[Alarm]):
    """All alarms of a service; every change is a transaction and one revision of ``alarms``.

    Parameters
    ----------
    clock : s, monotonic: delays must not know that the wall's clock was set
    """

    of = Alarm

    def __init__(self, database: Database, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__(database)
        self._clock = clock
        self._lock = threading.Lock()
        # What was active when the service ended is active until somebody reports otherwise.
        self._timers = {(alarm.machine, alarm.kind): Timer(on=True) for alarm in self.active()}

    def report(self, machine: str | None, kind: str, text: str, severity: Severity, on: bool) -> None:
        """Report whether something is wrong; again and again where the kind has a delay.

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
                    new = Alarm(
                        id=f"alarm-{secrets.token_hex(8)}",
                        machine=machine,
                        kind=kind,
                        text=text,
                        severity=severity,
                        raised=self._database.now(),
                    )
                    self._set(machine, kind, partial(lifecycle.raise_, new=new))
            elif timer.on:
                self._set(machine, kind, self._cleared)
            self._timers[machine, kind] = after
        if after.on != timer.on:
            _log.warning("alarm_raised" if on else "alarm_cleared", machine=machine, kind=kind, text=text)

    def _cleared(self, alarm: Alarm | None) -> Alarm | None:
        return None if alarm is None else lifecycle.clear(alarm, self._database.now())

    def _set(self, machine: str | None, kind: str, to: Callable[[Alarm | None], Alarm | None]) -> None:
        """Put ``to(newest)`` in the place of the newest alarm of that machine and kind, or beside it if its id is new.

        Nothing is written where nothing changes.
        """
        of_it = alarms.c.kind == kind, alarms.c.machine.is_not_distinct_from(machine)
        last = next(iter(self.all(*of_it, newest=1)), None)
        if to(last) == last:
            return
        with self._database.write("alarms") as connection:
            query = sa.select(alarms).where(*of_it).order_by(alarms.c.number.desc()).limit(1)
            last = next(iter(self.values(connection, connection.execute(query).all())), None)
            wanted = to(last)
            if wanted is not None and (last is None or wanted.id != last.id):
                self.put(connection, wanted)
                self._publish(connection, wanted)
            elif wanted is not None:
                self._put(connection, wanted)

    def _put(self, connection: sa.Connection, changed: Alarm) -> None:
        self.update(connection, **changed.columns())
        self._publish(connection, changed)

    def _publish(self, connection: sa.Connection, changed: Alarm) -> None:
        put_out(connection, "alarm", self._database.now(), changed.columns())

    def sweep(self) -> None:
        """Take those off the shelf whose time is over."""
        now = self._now()
        for alarm in self.all(alarms.c.shelved_until.is_not(None)):
            if lifecycle.expired(alarm, now):
                self._change(alarm.id, lifecycle.unshelve)

    def active(self) -> tuple[Alarm, ...]:
        """List all that are active."""
        return self.all(_ACTIVE)

    def open(self) -> tuple[Alarm, ...]:
        """List all that are active, or that nobody acknowledged."""
        return self.all(sa.or_(_ACTIVE, alarms.c.acknowledged.is_(False)))

    def since(self, machine: str, since: str, limit: int) -> tuple[Alarm, ...]:
        """List a machine's that came, or went, at ``since`` (ISO 8601, UTC) or later, or are active, newest first."""
        later = sa.or_(alarms.c.raised >= since, alarms.c.cleared >= since, _ACTIVE)
        return self.all(alarms.c.machine == machine, later, newest=limit)

    def acknowledge(self, id: str, who: str, tags: Tags = None) -> Alarm:
        """Note that somebody has seen it; doing it twice changes nothing. For ``tags`` see :meth:`unshelve`."""
        return self._change(id, partial(lifecycle.acknowledge, who=who), tags)

    def shelve(self, id: str, who: str, reason: str, seconds: float, tags: Tags = None) -> Alarm:
        """Keep it quiet for a while. For ``tags`` see :meth:`unshelve`."""
        now = self._now()
        return self._change(
            id, lambda alarm: lifecycle.shelve(alarm, who=who, reason=reason, seconds=seconds, now=now), tags
        )

    def unshelve(self, id: str, tags: Tags = None) -> Alarm:
        """Take it off the shelf; one that is on none is left as it is.

        Raises
        ------
        PreconditionError
            If ``tags`` are given and the alarm has changed since it had one of them
            (:func:`server.alarms.alarm_lifecycle.tag`).
        """
        return self._change(id, lifecycle.unshelve, tags)

    def _change(self, id: str, to: Callable[[Alarm], Alarm], tags: Tags = None) -> Alarm:
        def checked(alarm: Alarm) -> Alarm:
            if tags is not None and lifecycle.tag(alarm) not in tags:
                raise PreconditionError("server.alarm_changed_meanwhile", id=id)
            return to(alarm)

        before = self.get(id)
        if checked(before) == before:
            return before
        with self._database.write("alarms") as connection:
            changed = checked(self.found(connection, id))
            self._put(connection, changed)
        return changed

    def _now(self) -> datetime:
        return datetime.fromisoformat(self._database.now()).astimezone(UTC)
