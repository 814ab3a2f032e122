"""Jobs and their progress events.

A job is ``queued``, then ``running``, then once and for all ``done``, ``failed`` or ``cancelled``. Every step
of its progress is a row of its own, so a client that was away reads what it missed.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import sqlalchemy as sa

from daq.messages import Sentence
from server.jobs.claims import Claim
from server.platform.database.idempotency import IdempotencyKey, earlier, remember
from server.platform.database.repository import Repository, Value
from server.platform.database.schema import metadata, put_out, store_identity
from server.platform.database.stored import BESIDE, HIDDEN, Id, Kept, Stored
from server.platform.http.bodies import Message

State = Literal["queued", "running", "done", "failed", "cancelled"]
FINAL = frozenset({"done", "failed", "cancelled"})


class Job(Stored, table="jobs", noun="job"):
    """A job as it is now; ``fraction`` is 0 to 1 over all stages, ``text`` says in words what it does.

    ``subject``: id of what it makes. ``place``: name of the directory, below that of the job, in which its last stage
    left its files, once it is over (:mod:`server.jobs.job_places`).
    """

    id: Id
    kind: str
    label: str
    subject: str
    stages: tuple[str, ...]
    state: State
    stage: str | None = None
    fraction: float = 0.0
    text: str = ""
    text_message: Message | None = None
    error: str | None = None
    error_message: Message | None = None
    cancel_requested: bool = False
    created: str
    started: str | None = None
    ended: str | None = None
    place: Annotated[str | None, HIDDEN] = None


#: State of the job that makes a resource; kept with the job.
JobState = Annotated[State, BESIDE]


class JobEvent(Stored, table="job_events"):
    """One step of a job's progress; numbers count from 1 without a hole."""

    job: Annotated[str, Kept(references="jobs.id", key=True), HIDDEN]
    number: Annotated[int, Kept(key=True)]
    time: str
    state: State
    stage: str | None
    fraction: float
    text: str
    text_message: Message | None = None


jobs, job_events = Job.table, JobEvent.table
#: Digests of what jobs read and left, where that travels between hosts (:mod:`server.platform.storage`).
job_files = sa.Table(
    "job_files",
    metadata,
    sa.Column("job", sa.String, sa.ForeignKey("jobs.id"), primary_key=True),
    sa.Column("use", sa.String, primary_key=True),  # input, result
    sa.Column("name", sa.String, primary_key=True),  # below the data directory, or below the job's place
    sa.Column("sha256", sa.String, nullable=False),
)


@dataclass(frozen=True)
class Result:
    """Result of a job: a change of one resource, in the transaction that ends the job."""

    resource: str
    change: sa.Update


class Jobs(Repository[Job]):
    """Repository of jobs.

    What whoever runs a job stores goes with its claim: TakenOver, and nothing is stored, if that holds no more.
    """

    of = Job

    def insert(
        self, connection: sa.Connection, *, id: str, kind: str, label: str, subject: str, stages: tuple[str, ...]
    ) -> None:
        """Store a queued job with its first event, in the transaction that also makes the job's subject."""
        text = Sentence("server.waiting_turn")
        new = Job(
            id=id,
            kind=kind,
            label=label,
            subject=subject,
            stages=stages,
            state="queued",
            text=text,
            created=self._database.now(),
        )
        self.put(connection, new)
        self._event(connection, id, new.state, None, new.fraction, text)

    def order(
        self,
        subjects: Repository[Value],
        new: Value,
        kind: str,
        stages: tuple[str, ...],
        key: IdempotencyKey | None = None,
    ) -> Value:
        """Store what a job makes, and the job, in one transaction; what was made first if the key came before.

        Parameters
        ----------
        new : has ``id``, ``job`` and ``label``

        Raises
        ------
        ConflictError
            If the key came before with another request.
        """
        about: dict[str, str] = {name: getattr(new, name) for name in ("id", "job", "label")}
        with self._database.write(subjects.of.table.name, "jobs") as connection:
            made = earlier(connection, key)
            if made is not None:
                return subjects.found(connection, made)
            self.insert(
                connection, id=about["job"], kind=kind, label=about["label"], subject=about["id"], stages=stages
            )
            subjects.put(connection, new)
            remember(connection, key, about["id"], self._database.now())
        return new

    def unfinished(self) -> tuple[Job, ...]:
        """List queued and running jobs, oldest first."""
        return self.all(jobs.c.state.not_in(FINAL))

    def counts(self) -> dict[str, int]:
        """Count jobs per state."""
        query = sa.select(jobs.c.state, sa.func.count()).group_by(jobs.c.state)
        with self._database.read() as connection:
            return {state: int(count) for state, count in connection.execute(query)}

    def progress(self, id: str, stage: str, fraction: float, text: str, claim: Claim | None = None) -> bool:
        """Set a queued or running job's ``text``; its fraction never goes back.

        Returns
        -------
        False if the job has ended or somebody asked to cancel it: the caller should stop.
        """
        with self._database.write("jobs") as connection:
            if claim is not None:
                claim.check(connection)
            row = self.found(connection, id)
            if row.state in FINAL or row.cancel_requested:
                return False
            fraction = min(1.0, max(row.fraction, fraction))
            started = row.started or self._database.now()
            self.update(connection, id, state="running", stage=stage, fraction=fraction, text=text, started=started)
            self._event(connection, id, "running", stage, fraction, text)
        return True

    def cancelling(self, id: str, claim: Claim | None = None) -> bool:
        """Test whether somebody asked to cancel the job."""
        with self._database.read() as connection:
            if claim is not None:
                claim.check(connection)
            return bool(connection.execute(sa.select(jobs.c.cancel_requested).where(jobs.c.id == id)).scalar())

    def request_cancel(self, id: str) -> Job:
        """Ask a job to stop; cancel a queued one at once, leave one that has ended.

        Raises
        ------
        NotFoundError
            If there is no such job.
        """
        state = self.get(id).state
        with self._database.write("jobs") as connection:
            connection.execute(
                jobs.update().where(jobs.c.id == id, jobs.c.state.not_in(FINAL)).values(cancel_requested=True)
            )
        if state == "queued":
            self.finish(id, "cancelled", Sentence("server.cancelled_before"), states=("queued",))
        return self.get(id)

    def finish(
        self,
        id: str,
        state: State,
        text: str,
        error: str | None = None,
        *,
        claim: Claim | None = None,
        result: Result | None = None,
        place: str | None = None,
        files: Mapping[str, str] | None = None,
        states: Collection[str] = ("queued", "running"),
    ) -> bool:
        """End a job and store its result, and where its files are, in one transaction; only the first call counts.

        Returns
        -------
        Whether this call ended it, for which it has to be in one of ``states``.
        """
        with self._database.write("jobs", *([] if result is None else [result.resource])) as connection:
            if claim is not None:
                claim.check(connection)
            row = self.found(connection, id)
            if row.state not in states:
                return False
            if result is not None:
                connection.execute(result.change)
            _note_files(connection, id, "result", files or {})
            fraction = 1.0 if state == "done" else row.fraction
            values = {"state": state, "text": text, "error": error, "fraction": fraction, "place": place}
            self.update(connection, id, **values, ended=self._database.now())
            self._event(connection, id, state, row.stage, fraction, text)
            put_out(connection, "result", self._database.now(), {"job": id})
        return True

    def store(self) -> str:
        """Return what distinguishes this store from all others."""
        with self._database.read() as connection:
            return str(connection.execute(sa.select(store_identity.c.id)).scalar_one())

    def note_inputs(self, id: str, files: Mapping[str, str]) -> None:
        """Store the SHA-256 of what a job reads, by key."""
        with self._database.write() as connection:
            _note_files(connection, id, "input", files)

    def files(self, id: str, use: Literal["input", "result"]) -> dict[str, str]:
        """Return SHA-256 of what a job reads or left, by name; nothing where its files do not travel."""
        query = sa.select(job_files.c.name, job_files.c.sha256).where(job_files.c.job == id, job_files.c.use == use)
        with self._database.read() as connection:
            return {row.name: row.sha256 for row in connection.execute(query)}

    def events(self, id: str, after: int = 0) -> tuple[JobEvent, ...]:
        """List what happened after event number ``after``."""
        query = (
            sa.select(job_events)
            .where(job_events.c.job == id, job_events.c.number > after)
            .order_by(job_events.c.number)
        )
        with self._database.read() as connection:
            return tuple(JobEvent.read(row) for row in connection.execute(query))

    def _event(
        self, connection: sa.Connection, id: str, state: State, stage: str | None, fraction: float, text: str
    ) -> None:
        last = connection.execute(sa.select(sa.func.max(job_events.c.number)).where(job_events.c.job == id)).scalar()
        event = JobEvent(
            job=id,
            number=(last or 0) + 1,
            time=self._database.now(),
            state=state,
            stage=stage,
            fraction=fraction,
            text=text,
        )
        connection.execute(job_events.insert().values(**event.columns()))


class MadeByJobs(Repository[Value]):
    """Repository of what jobs make, each with the state of its job."""

    def values(self, connection: sa.Connection, rows: Sequence[sa.Row[Any]]) -> tuple[Value, ...]:
        """Return what rows hold."""
        query = sa.select(jobs.c.id, jobs.c.state).where(jobs.c.id.in_([row.job for row in rows]))
        states = {row.id: row.state for row in connection.execute(query)}
        return tuple(self.of.read(row, state=states[row.job]) for row in rows)


def found_by(made: type[Stored], id: str, **found: Any) -> Result:
    """Return a job's result for the thing with this id, to be stored with the end of the job."""
    return Result(made.table.name, made.table.update().where(made.table.c.id == id).values(**found))


def _note_files(connection: sa.Connection, id: str, use: str, files: Mapping[str, str]) -> None:
    connection.execute(job_files.delete().where(job_files.c.job == id, job_files.c.use == use))
    rows = [{"job": id, "use": use, "name": name, "sha256": sha256} for name, sha256 in files.items()]
    if rows:
        connection.execute(job_files.insert(), rows)
