"""The resource ``jobs``: long work of all kinds, which the other resources declare."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import suppress
from itertools import count

import structlog
from prometheus_client.core import GaugeMetricFamily, Metric

from server.jobs.claims import job_claims
from server.jobs.executors import Heartbeat, Silence, executors, hosts
from server.jobs.job_kinds import AT_MACHINES
from server.jobs.job_routes import router
from server.jobs.job_runner import EXECUTOR, QUEUES, JobRunner
from server.jobs.job_store import Jobs, job_events, job_files, jobs
from server.jobs.job_times import JobTimes
from server.jobs.worker_routes import router as worker_router
from server.platform.database.engine import Database
from server.platform.files import DataDirectory
from server.platform.parts import Parts
from server.platform.resource import Phase, Resource, Running
from server.platform.service import Service
from server.platform.settings import Settings
from server.platform.storage import StorageAwayError

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
        JobTimes: lambda parts: JobTimes(parts[Database]),
        JobRunner: _runner,
        Silence: lambda parts: Silence(parts[Database]),
        Heartbeat: _heartbeat,
    },
    running=_running,
    metrics=_metrics,
)
