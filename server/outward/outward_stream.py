"""Reads what is to be said once, for all that say it: webhooks, MQTT, OPC UA.

Alarms and results come from the outbox of the store, in their order, and leave it in the transaction that stores the
deliveries of webhooks; states of acquisition are looked at in this process. Whoever takes messages never waits.
"""

from __future__ import annotations

import asyncio
import secrets
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import sqlalchemy as sa
import structlog

from daq.errors import HilfitError
from server.jobs.job_store import Job, Jobs
from server.machines.acquisition import Acquisition
from server.outward.outward_message import AlarmData, Message, ResultData, StateData
from server.platform.authorization.ownership import Ownership
from server.platform.changes import Changes
from server.platform.database.engine import Database
from server.platform.database.schema import outbox

#: s after which the outbox is read though nothing changed here (a worker wrote it), and least time between two looks.
POLL_S, LEAST_S = 2.0, 0.1
#: Most rows of one look.
MOST = 200
_COLLECTIONS = {"identification": "identifications", "excitation": "excitations", "recalibration": "jobs"}
_log = structlog.stdlib.get_logger(__name__)


class Sink(Protocol):
    """Says messages in its own way."""

    def take(self, message: Message) -> None:
        """Take a message; never waits, and may be given the same one twice."""


class MessageReader:
    """Makes messages of rows of the outbox.

    Parameters
    ----------
    verdict : of an identification, by its id
    """

    def __init__(self, jobs: Jobs, ownership: Ownership, verdict: Callable[[str], str | None]) -> None:
        self._jobs = jobs
        self._ownership = ownership
        self._verdict = verdict

    def message(self, row: Any) -> Message:
        """Return the message of a row."""
        if row.kind == "alarm":
            return alarm_message(row.id, row.content, row.time)
        job = self._jobs.get(row.content["job"])
        machine = self._ownership.machines_of_jobs([job.id]).get(job.id)
        return Message(row.id, "result", machine, row.time, self._result(job))

    def _result(self, job: Job) -> ResultData:
        collection = _COLLECTIONS.get(job.kind, "jobs")
        path = f"/api/v1/{collection}/{job.id if collection == 'jobs' else job.subject}"
        verdict = self._verdict(job.subject) if job.kind == "identification" and job.state == "done" else None
        own = {name: getattr(job, name) for name in ResultData.__dataclass_fields__ if hasattr(job, name)}
        made_of = None if job.error_message is None else job.error_message.model_dump()
        return ResultData(**own | {"job": job.id, "path": path, "verdict": verdict, "error_message": made_of})


def alarm_message(id: str, alarm: Mapping[str, Any], time: str) -> Message:
    """Return the message of an alarm, given its fields."""
    data = AlarmData(**{name: alarm[name] for name in AlarmData.__dataclass_fields__ if name in alarm})
    return Message(id, "alarm", alarm["machine"], time, data)


@dataclass(eq=False)
class OutwardStream:
    """The reading thread.

    Attributes
    ----------
    deliver : stores the deliveries of webhooks in a transaction; what to call once it is committed
    resume : lets deliveries go on that were stored and may not have been sent
    """

    database: Database
    changes: Changes
    reader: MessageReader
    states: Acquisition
    deliver: Callable[[sa.Connection, Sequence[Message]], Callable[[], object]]
    resume: Callable[[], object]

    def __post_init__(self) -> None:
        self._sinks: tuple[Sink, ...] = ()
        self._known: Mapping[str, StateData] = {}
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="outward", daemon=True)

    def start(self, sinks: Iterable[Sink], alarms: Iterable[Message] = ()) -> None:
        """Start reading; the sinks first get the ``alarms`` that are active now."""
        self._sinks = tuple(sinks)
        self._give(alarms)
        self._thread.start()

    def stop(self) -> None:
        """Stop reading; also if it never started."""
        self._stop.set()
        self.changes.notify()
        if self._thread.is_alive():
            self._thread.join()

    def _run(self) -> None:
        behind = True
        while not self._stop.is_set():
            number = self.changes.number
            more = False
            try:
                if behind:
                    self.resume()
                behind = False
                self.look_at_states()
                more = self.look_at_outbox() == MOST
            except Exception as error:  # of the store; what it holds will be there at the next look
                behind = True
                _log.error("outward_look_failed", exc_info=error)
            self._stop.wait(LEAST_S)
            if not more and not self._stop.is_set() and not self.changes.closed:
                asyncio.run(self.changes.wait(number, POLL_S))

    def look_at_states(self) -> None:
        """Send what changed of acquisition since the last look."""
        found = {name: self._state(name) for name in self.states.names()}
        now = found | {name: StateData("off") for name in self._known if name not in found}
        changed = {name: state for name, state in now.items() if self._known.get(name) != state}
        self._known = now
        time = self.database.now()
        self._give(
            Message(f"msg-{secrets.token_hex(12)}", "state", name, time, state) for name, state in changed.items()
        )

    def _state(self, name: str) -> StateData:
        statistics = self.states.statistics(name)
        return StateData(statistics["state"], statistics.get("error"), statistics.get("error_message"))

    def look_at_outbox(self) -> int:
        """Send what is in the outbox, the oldest first; return their number."""
        query = sa.select(outbox).order_by(outbox.c.number).limit(MOST)
        with self.database.read() as connection:
            rows = connection.execute(query).all()
        if not rows:
            return 0
        messages = [message for row in rows if (message := self._made(row)) is not None]
        self._give(messages)
        with self.database.write() as connection:  # who follows a webhook hears of its tries
            committed = self.deliver(connection, messages)
            connection.execute(outbox.delete().where(outbox.c.number <= rows[-1].number))
        committed()
        return len(rows)

    def _made(self, row: Any) -> Message | None:
        try:
            return self.reader.message(row)
        except (HilfitError, LookupError) as error:  # what it is about was deleted; the others have to go on
            _log.error("outward_not_said", message=row.id, exc_info=error)
            return None

    def _give(self, messages: Iterable[Message]) -> None:
        for message in messages:
            for sink in self._sinks:
                try:
                    sink.take(message)
                except Exception as error:  # one that is broken must not keep the others from it
                    _log.error("outward_not_taken", sink=type(sink).__name__, exc_info=error)
