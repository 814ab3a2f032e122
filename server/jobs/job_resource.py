"""The resource ``jobs``: long work of all kinds, which the other resources declare."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import AsyncIterator, Iterator, Mapping, Sequence
from contextlib import suppress
from datetime import datetime, timedelta
from functools import partial
from itertools import count, pairwise
from statistics import median
from typing import Annotated

import sqlalchemy as sa
import structlog
from fastapi import APIRouter, Header, Query
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import StreamingResponse
from prometheus_client.core import GaugeMetricFamily, Metric
from pydantic import BaseModel

from server.jobs.claims import job_claims
from server.jobs.executors import Heartbeat, Host, Silence, executors, hosts
from server.jobs.job_kinds import AT_MACHINES
from server.jobs.job_runner import EXECUTOR, QUEUES, JobRunner
from server.jobs.job_store import FINAL, Job, Jobs, State, job_events, job_files, jobs
from server.platform.authorization.guard import PrincipalDep, TypedRoute, require
from server.platform.database.engine import Database, as_stored
from server.platform.files import DataDirectory
from server.platform.http.bodies import Listed
from server.platform.http.route_parameters import TEXT, PageDep, ServiceDep, problems, sends
from server.platform.resource import Parts, Phase, Resource, Running
from server.platform.service import Service
from server.platform.settings import Settings
from server.platform.storage import StorageAwayError

#: Earlier jobs that count: computers and recordings change.
EARLIER = 10
#: Without earlier jobs its own progress is carried on, once it means something.
LEAST_FRACTION = 0.1


def expected_end(database: Database, job: Job) -> str | None:
    """Estimate a running job's end, as the store writes times; None if it does not run, or no job is known.

    The stage that it is in takes what that stage took in the median of the last jobs of its kind that were done,
    or is about to end where it took longer; so do those that follow. Where none was done, or one with other
    stages, what it did so far is carried on.
    """
    if job.state != "running" or job.stage is None or job.started is None:
        return None
    now = datetime.fromisoformat(database.now())
    with database.read() as connection:
        usual = _usual(connection, job.kind)
        begun = connection.execute(
            sa.select(sa.func.min(job_events.c.time)).where(job_events.c.job == job.id, job_events.c.stage == job.stage)
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


class JobResource(Job):
    """A job as it is now; ``fraction`` is 0 to 1 over all stages.

    ``expected_end``: when it will probably end, from how long earlier jobs of its kind took, else from its own
    progress; null while it waits, once it is over, and where nothing tells.
    """

    expected_end: str | None = None


class JobList(Listed[JobResource]):
    """A page of jobs."""


router = APIRouter(prefix="/jobs", tags=["jobs"], route_class=TypedRoute)
#: Seconds after which a comment is sent when nothing happens, so that proxies and clients see a live
#: connection.
KEEP_ALIVE_S = 15.0
#: No job has more events, and every database holds the number.
MOST_EVENTS = 2**53


@router.get("", responses=problems(422), dependencies=[require("read")])
def list_jobs(service: ServiceDep, principal: PrincipalDep, page: PageDep, state: State | None = None) -> JobList:
    """List jobs, newest first; a page may be short where jobs of other machines are left out."""
    # Of which machine a job is only what it makes says.
    found = service[Jobs].list(page["limit"], page["after"], state=state, between=page["between"])
    jobs = JobList.of(found, partial(_resource, service))
    if principal.machines is not None:
        machines = service.ownership.machines_of_jobs(job.id for job in jobs.items)
        jobs.items = [job for job in jobs.items if principal.may_see(machines.get(job.id))]
    return jobs


@router.get("/{id}", responses=problems(404, 422), dependencies=[require("read")])
def get(id: str, service: ServiceDep) -> JobResource:
    """Read a job."""
    return _resource(service, service[Jobs].get(id))


@router.post("/{id}/cancel", status_code=202, responses=problems(404, 422), dependencies=[require("operate")])
def cancel(id: str, service: ServiceDep) -> JobResource:
    """Ask a job to stop; one that has ended is left as it is."""
    return _resource(service, service[Jobs].request_cancel(id))


@router.get("/{id}/events", **sends({"text/event-stream": TEXT}, 404, 422), dependencies=[require("read")])
async def events(
    id: str,
    service: ServiceDep,
    after: Annotated[int, Query(ge=0, le=MOST_EVENTS, description="Number of the last event seen")] = 0,
    last_event_id: Annotated[str | None, Header(max_length=20)] = None,
) -> StreamingResponse:
    """Follow a job as server-sent events; the stream ends with the job. Each event's ``id`` is its number."""
    await run_in_threadpool(service[Jobs].get, id)
    if last_event_id is not None and last_event_id.isascii() and last_event_id.isdecimal():
        after = min(int(last_event_id), MOST_EVENTS)
    headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
    return StreamingResponse(_follow(service, id, after), media_type="text/event-stream", headers=headers)


async def _follow(service: Service, id: str, after: int) -> AsyncIterator[bytes]:
    while True:
        seen = service.changes.number
        over = (await run_in_threadpool(service[Jobs].get, id)).state in FINAL
        for event in await run_in_threadpool(service[Jobs].events, id, after):
            yield f"id: {event.number}\nevent: progress\ndata: {json.dumps(event.model_dump())}\n\n".encode()
            after = event.number
            if event.state in FINAL:
                return
        if over or service.changes.closed:  # whoever has seen the last event waits for nothing
            return
        if not await service.changes.wait(seen, KEEP_ALIVE_S):
            yield b": nothing new\n\n"


def _resource(service: Service, job: Job) -> JobResource:
    return JobResource.of(job, expected_end=expected_end(service.database, job))


worker_router = APIRouter(prefix="/workers", tags=["jobs"], route_class=TypedRoute)


class WorkerResource(Host):
    """A process that runs jobs.

    ``load``: processes that wanted to run on its host in the mean of the last minute. ``state``: works, or what it
    waits for. ``silent``: nothing was heard of it for so long that others go on with its jobs.
    """

    silent: bool


class WorkerList(BaseModel):
    """All that were ever heard of, by name."""

    items: list[WorkerResource]
    next: None = None


@worker_router.get("", dependencies=[require("read", every_machine=True)])
def list_workers(service: ServiceDep) -> WorkerList:
    """List the processes that run jobs; none where the service is alone."""
    query = sa.select(executors.c.host, hosts).join(hosts, hosts.c.id == executors.c.id).order_by(hosts.c.id)
    silence = service[Silence]
    with service.database.read() as connection:
        rows = [dict(row._mapping) for row in connection.execute(query)]
    return WorkerList(items=[WorkerResource(**row, silent=silence.silent(row["id"])) for row in rows])


#: Store and engine are brought together at every so many words of the server.
RECONCILED = 6
_log = structlog.stdlib.get_logger(__name__)


def _runner(parts: Parts) -> JobRunner:
    settings = parts[Settings]
    kinds = [parts[kind] for resource in parts[Service].resources for kind in resource.job_kinds]
    return JobRunner(
        parts[Database],
        parts[DataDirectory],
        kinds,
        stage_timeout_s=settings.stage_timeout_s,
        queues=tuple(QUEUES) if settings.local_jobs else (AT_MACHINES,),
    )


def _heartbeat(parts: Parts) -> Heartbeat:
    database, silence, beats = parts[Database], parts[Silence], count()

    def take_over() -> None:
        """Let others go on with the jobs of workers that fell silent."""
        if not database.still_alone():
            _log.critical("another_server_has_the_database", database=database.name)
            os.kill(os.getpid(), signal.SIGTERM)
            return
        silence.look()
        parts[JobRunner].take_over(silence.silent)
        if next(beats) % RECONCILED == 0:
            parts[JobRunner].reconcile()

    return Heartbeat(database, EXECUTOR, take_over)


def _running(parts: Parts) -> Iterator[Running]:
    runner = parts[JobRunner]
    with suppress(StorageAwayError):  # :meth:`JobRunner.reconcile` does it later
        parts[DataDirectory].storage.claim(parts[Jobs].store())
    yield Running(Phase.JOBS, runner.start, runner.stop)
    yield Running(Phase.ORDERS, stop=runner.halt)
    if not parts[Database].is_sqlite:  # else nobody shares it
        heartbeat = parts[Heartbeat]
        yield Running(Phase.CLOCKS, heartbeat.start, heartbeat.stop)


def _metrics(parts: Parts) -> Iterator[Metric]:
    states = GaugeMetricFamily("hilfit_jobs", "Jobs in each state.", labels=["state"])
    for state, number in parts[Jobs].counts().items():
        states.add_metric([state], number)
    yield states


JOBS = Resource(
    name="jobs",
    routers=(router, worker_router),
    tables=(jobs, job_events, executors, job_claims, job_files, hosts),
    kept={"/jobs": ("jobs", "identifications", "valves", "excitations", "recalibrations")},
    provides={
        Jobs: lambda parts: Jobs(parts[Database]),
        JobRunner: _runner,
        Silence: lambda parts: Silence(parts[Database]),
        Heartbeat: _heartbeat,
    },
    running=_running,
    metrics=_metrics,
)
