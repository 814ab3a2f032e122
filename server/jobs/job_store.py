"""Jobs and their progress events.

A job is ``queued``, then ``running``, then once and for all ``done``, ``failed`` or ``cancelled``. Every step
of its progress is a row of its own, so a client that was away reads what it missed.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any, Literal, Unpack

import sqlalchemy as sa

from server.jobs.claims import Claim
from server.jobs.job_tables import job_events, job_files, jobs
from server.platform.database.engine import Database, Page
from server.platform.database.lists import Narrowing, listed
from server.platform.database.outbox import put_out
from server.platform.database.schema import store_identity
from server.platform.errors import NotFoundError

State = Literal["queued", "running", "done", "failed", "cancelled"]
FINAL = frozenset({"done", "failed", "cancelled"})


@dataclass(frozen=True)
class Job:
    """A job as it is now; ``fraction`` is 0 to 1 over all stages, ``text`` says in words what it does.

    ``place``: name of the directory in which it left its files, once it is over (:mod:`server.jobs.job_places`).
    """

    id: str
    kind: str
    label: str
    subject: str
    stages: tuple[str, ...]
    state: State
    stage: str | None
    fraction: float
    text: str
    error: str | None
    cancel_requested: bool
    created: str
    started: str | None
    ended: str | None
    place: str | None = None


@dataclass(frozen=True)
class JobEvent:
    """One step of a job's progress; numbers count from 1 without a hole."""

    number: int
    time: str
    state: State
    stage: str | None
    fraction: float
    text: str


@dataclass(frozen=True)
class Result:
    """What a job found: a change of one resource, in the transaction that ends the job."""

    resource: str
    change: sa.Update


class Jobs:
    """Repository of jobs.

    What whoever runs a job stores goes with its claim: TakenOver, and nothing is stored, if that holds no more.
    """

    def __init__(self, database: Database) -> None:
        self._database = database

    def insert(
        self,
        connection: sa.Connection,
        *,
        id: str,
        kind: str,
        label: str,
        subject: str,
        stages: tuple[str, ...],
    ) -> None:
        """A queued job with its first event, in the transaction that also makes the job's subject."""
        text = "Waiting for its turn"
        connection.execute(
            jobs.insert().values(
                id=id,
                kind=kind,
                label=label,
                subject=subject,
                stages=list(stages),
                state="queued",
                fraction=0.0,
                text=text,
                cancel_requested=False,
                created=self._database.now(),
            )
        )
        self._event(connection, id, "queued", None, 0.0, text)

    def get(self, id: str) -> Job:
        """The job; NotFoundError if there is none."""
        with self._database.read() as connection:
            row = connection.execute(sa.select(jobs).where(jobs.c.id == id)).first()
        if row is None:
            raise NotFoundError(f"there is no job '{id}'", job=id)
        return _job(row)

    def list(self, limit: int, after: int = 0, **narrowed: Unpack[Narrowing]) -> Page[Job]:
        """Newest first, narrowed to what is given."""
        return listed(self._database, jobs, _job, limit, after, **narrowed)

    def unfinished(self) -> tuple[Job, ...]:
        """Queued and running jobs, oldest first."""
        query = sa.select(jobs).where(jobs.c.state.not_in(FINAL)).order_by(jobs.c.number)
        with self._database.read() as connection:
            return tuple(_job(row) for row in connection.execute(query))

    def counts(self) -> dict[str, int]:
        """Number of jobs per state."""
        query = sa.select(jobs.c.state, sa.func.count()).group_by(jobs.c.state)
        with self._database.read() as connection:
            return {state: int(count) for state, count in connection.execute(query)}

    def progress(self, id: str, stage: str, fraction: float, text: str, claim: Claim | None = None) -> bool:
        """A queued or running job does ``text``; its fraction never goes back.

        Returns
        -------
        False if the job has ended or somebody asked to cancel it: the caller should stop.
        """
        with self._database.write("jobs") as connection:
            if claim is not None:
                claim.check(connection)
            row = connection.execute(sa.select(jobs).where(jobs.c.id == id)).one()
            if row.state in FINAL or row.cancel_requested:
                return False
            fraction = min(1.0, max(row.fraction, fraction))
            connection.execute(
                jobs.update()
                .where(jobs.c.id == id)
                .values(
                    state="running",
                    stage=stage,
                    fraction=fraction,
                    text=text,
                    started=row.started or self._database.now(),
                )
            )
            self._event(connection, id, "running", stage, fraction, text)
        return True

    def cancelling(self, id: str, claim: Claim | None = None) -> bool:
        """Whether somebody asked to cancel the job."""
        with self._database.read() as connection:
            if claim is not None:
                claim.check(connection)
            return bool(connection.execute(sa.select(jobs.c.cancel_requested).where(jobs.c.id == id)).scalar())

    def request_cancel(self, id: str) -> Job:
        """Ask a job to stop; a queued one is cancelled at once, one that has ended stays as it is.

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
            self.finish(id, "cancelled", "Cancelled before it started", states=("queued",))
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
            row = connection.execute(sa.select(jobs).where(jobs.c.id == id)).one()
            if row.state not in states:
                return False
            if result is not None:
                connection.execute(result.change)
            _note_files(connection, id, "result", files or {})
            fraction = 1.0 if state == "done" else row.fraction
            connection.execute(
                jobs.update()
                .where(jobs.c.id == id)
                .values(state=state, text=text, error=error, fraction=fraction, ended=self._database.now(), place=place)
            )
            self._event(connection, id, state, row.stage, fraction, text)
            put_out(connection, "result", self._database.now(), {"job": id})
        return True

    def store(self) -> str:
        """What tells this store from all others."""
        with self._database.read() as connection:
            return str(connection.execute(sa.select(store_identity.c.id)).scalar_one())

    def note_inputs(self, id: str, files: Mapping[str, str]) -> None:
        """Store the SHA-256 of what a job reads, by key."""
        with self._database.write() as connection:
            _note_files(connection, id, "input", files)

    def files(self, id: str, use: Literal["input", "result"]) -> dict[str, str]:
        """SHA-256 of what a job reads or left, by name; nothing where its files do not travel."""
        query = sa.select(job_files.c.name, job_files.c.sha256).where(job_files.c.job == id, job_files.c.use == use)
        with self._database.read() as connection:
            return {row.name: row.sha256 for row in connection.execute(query)}

    def events(self, id: str, after: int = 0) -> tuple[JobEvent, ...]:
        """What happened after event number ``after``."""
        query = (
            sa.select(job_events)
            .where(job_events.c.job == id, job_events.c.number > after)
            .order_by(job_events.c.number)
        )
        with self._database.read() as connection:
            return tuple(
                JobEvent(row.number, row.time, row.state, row.stage, row.fraction, row.text)
                for row in connection.execute(query)
            )

    def _event(
        self, connection: sa.Connection, id: str, state: State, stage: str | None, fraction: float, text: str
    ) -> None:
        last = connection.execute(sa.select(sa.func.max(job_events.c.number)).where(job_events.c.job == id)).scalar()
        connection.execute(
            job_events.insert().values(
                job=id,
                number=(last or 0) + 1,
                time=self._database.now(),
                state=state,
                stage=stage,
                fraction=fraction,
                text=text,
            )
        )


def _note_files(connection: sa.Connection, id: str, use: str, files: Mapping[str, str]) -> None:
    connection.execute(job_files.delete().where(job_files.c.job == id, job_files.c.use == use))
    rows = [{"job": id, "use": use, "name": name, "sha256": sha256} for name, sha256 in files.items()]
    if rows:
        connection.execute(job_files.insert(), rows)


def _job(row: sa.Row[Any]) -> Job:
    values = {key: value for key, value in row._mapping.items() if key != "number"}
    return Job(**{**values, "stages": tuple(values["stages"])})
