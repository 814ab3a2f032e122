"""Claims of jobs by who works on them: a fencing token, checked in the transaction that stores.

A process that was silent for long may not be dead. When it wakes it goes on as if nothing had happened, while another
one has its jobs. So whoever begins to run a job takes its *claim*, a number one higher than all before, and everything
that it then stores about the job is stored in a transaction that first looks whether the claim still holds.

A claim is taken only while nobody else holds it: its holder gave it back, or the server revoked it because the holder
fell silent. A holder that starts again under its name works on nothing yet, so it releases what it held before: the job
may have been given to somebody else meanwhile, who waits for the claim.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import sqlalchemy as sa

from daq.messages import Sentence
from server.platform.database.engine import Database
from server.platform.database.schema import metadata
from server.platform.errors import TakenOver

job_claims = sa.Table(
    "job_claims",
    metadata,
    sa.Column("job", sa.String, sa.ForeignKey("jobs.id"), primary_key=True),
    sa.Column("number", sa.Integer, nullable=False),  # one higher with every holder
    sa.Column("holder", sa.String),  # executor; none: free
)


@dataclass(frozen=True)
class Claim:
    """Claim of ``holder`` to work on ``job``; it holds until a higher number was given out."""

    job: str
    holder: str
    number: int

    def check(self, connection: sa.Connection) -> None:
        """Raise TakenOver unless the claim holds, in a transaction that stores something on the strength of it."""
        newest = connection.execute(sa.select(job_claims.c.number).where(job_claims.c.job == self.job)).scalar()
        if newest != self.number:
            raise TakenOver(Sentence("server.another_process_has_it", job=self.job, holder=self.holder))


class Claims:
    """Repository of claims."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def take(self, job: str, holder: str) -> Claim | None:
        """Take the claim of a job; None while somebody else holds it."""
        with self._database.write() as connection:
            row = connection.execute(sa.select(job_claims).where(job_claims.c.job == job)).first()
            if row is None:
                connection.execute(job_claims.insert().values(job=job, holder=holder, number=1))
                return Claim(job, holder, 1)
            if row.holder not in (None, holder):
                return None
            _change(connection, job, row.number + 1, holder)
            return Claim(job, holder, row.number + 1)

    def give_back(self, claim: Claim) -> None:
        """Let others take it; nothing happens if they did already."""
        with self._database.write() as connection:
            connection.execute(
                job_claims.update()
                .where(job_claims.c.job == claim.job, job_claims.c.number == claim.number)
                .values(holder=None)
            )

    def release(self, holder: str) -> tuple[str, ...]:
        """Let go of whatever an earlier process of this name held; the jobs. That process stores nothing more."""
        return self.revoke(lambda other: other == holder)

    def revoke(self, silent: Callable[[str], bool]) -> tuple[str, ...]:
        """Take the claims of holders that are ``silent`` away from them; the jobs."""
        with self._database.read() as connection:
            held = connection.execute(sa.select(job_claims).where(job_claims.c.holder.is_not(None))).all()
        lost = [row for row in held if silent(row.holder)]
        if lost:
            with self._database.write() as connection:
                for row in lost:
                    _change(connection, row.job, row.number + 1, None, row.number)
        return tuple(row.job for row in lost)


def _change(connection: sa.Connection, job: str, number: int, holder: str | None, seen: int | None = None) -> None:
    """Write a row; only if its number is still the one that was ``seen``, where one is given."""
    where = [job_claims.c.job == job] + ([] if seen is None else [job_claims.c.number == seen])
    connection.execute(job_claims.update().where(*where).values(number=number, holder=holder))
