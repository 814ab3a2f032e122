"""When a running job will probably end: from how long earlier jobs of its kind took."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime, timedelta
from itertools import pairwise
from statistics import median

import sqlalchemy as sa

from server.jobs.job_store import Job, job_events, jobs
from server.platform.database.engine import Database, as_stored

#: Earlier jobs that count: computers and recordings change.
EARLIER = 10
#: Without earlier jobs its own progress is carried on, once it means something.
LEAST_FRACTION = 0.1


class JobTimes:
    """Estimates ends of jobs."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def expected_end(self, job: Job) -> str | None:
        """Estimate a running job's end, as the store writes times; None if it does not run, or no job is known.

        The stage that it is in takes what that stage took in the median of the last jobs of its kind that were done,
        or is about to end where it took longer; so do those that follow. Where none was done, or one with other
        stages, what it did so far is carried on.
        """
        if job.state != "running" or job.stage is None or job.started is None:
            return None
        now = datetime.fromisoformat(self._database.now())
        with self._database.read() as connection:
            usual = _usual(connection, job.kind)
            begun = connection.execute(
                sa.select(sa.func.min(job_events.c.time)).where(
                    job_events.c.job == job.id, job_events.c.stage == job.stage
                )
            ).scalar()
        following = job.stages[job.stages.index(job.stage) :] if job.stage in job.stages else ()
        if begun is not None and following and all(stage in usual for stage in following):
            here = max(now, datetime.fromisoformat(begun) + timedelta(seconds=usual[following[0]]))
            return as_stored(here + timedelta(seconds=sum(usual[stage] for stage in following[1:])))
        if job.fraction < LEAST_FRACTION:
            return None
        done = now - datetime.fromisoformat(job.started)
        return as_stored(now + done * (1 / job.fraction - 1))


def _usual(connection: sa.Connection, kind: str) -> dict[str, float]:
    """Compute the median seconds that each stage took in the last jobs of a kind."""
    newest = (
        sa.select(jobs.c.id).where(jobs.c.kind == kind, jobs.c.state == "done").order_by(jobs.c.number.desc())
    ).limit(EARLIER)
    events = connection.execute(
        sa.select(job_events.c.job, job_events.c.state, job_events.c.stage, job_events.c.time)
        .where(job_events.c.job.in_(newest.scalar_subquery()), job_events.c.stage.is_not(None))
        .order_by(job_events.c.job, job_events.c.number)
    )
    begun: dict[str, list[tuple[str, datetime]]] = {}
    for job, state, stage, time in events:
        seen = begun.setdefault(job, [])
        name = stage if state == "running" else ""  # the end
        if not seen or seen[-1][0] != name:
            seen.append((name, datetime.fromisoformat(time)))
    return _medians(list(begun.values()))


def _medians(runs: Sequence[Sequence[tuple[str, datetime]]]) -> dict[str, float]:
    took: dict[str, list[float]] = {}
    for run in runs:
        once: Mapping[str, float] = {
            name: (until - since).total_seconds() for (name, since), (_, until) in pairwise(run)
        }
        for name, seconds in once.items():
            took.setdefault(name, []).append(seconds)
    return {name: median(seconds) for name, seconds in took.items()}
