"""``hilfit worker``: takes numerical jobs of a service with PostgreSQL, on this host or another.

It needs the addresses of the service's database and storage, and a directory of its own for what it is working on.
Before it takes a job it waits until both are there, are those of one store, and a server of its own version has used
them; a line a minute says what it waits for.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from importlib.metadata import version
from types import FrameType
from typing import Any

import sqlalchemy as sa
import structlog

from daq.messages import Sentence
from server.composition.declarations import RESOURCES, TABLES
from server.jobs.executors import Heartbeat, hosts
from server.jobs.job_kinds import NUMERICAL, JobKind
from server.jobs.job_runner import EXECUTOR, JobRunner
from server.platform import logs
from server.platform.database.engine import Database
from server.platform.database.patience import Patience
from server.platform.errors import ServiceStopping, StartError
from server.platform.files import DataDirectory, held, private_files
from server.platform.resource import Key, Parts, providers_of
from server.platform.settings import Settings

_log = structlog.stdlib.get_logger(__name__)


def work(settings: Settings, name: str, ready: Callable[[], None], given: Mapping[Key, Any] | None = None) -> None:
    """Take jobs until SIGTERM or SIGINT.

    Parameters
    ----------
    name : of this worker among all that share the database; the same after a restart
    ready : called once it takes jobs
    given : parts in the place of what is installed

    Raises
    ------
    StartError
        If there is no shared database, or the name is taken.
    """
    if settings.database_url is None:
        raise StartError("server.worker_without_database")
    if name == EXECUTOR or not name.replace("-", "").replace("_", "").replace(".", "").isalnum():
        raise StartError("server.worker_name_wrong", name=name, reserved=EXECUTOR)
    private_files()
    logs.configure()
    stopping = threading.Event()

    def stop(_number: int, _frame: FrameType | None) -> None:
        stopping.set()

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, stop)
    files = DataDirectory(settings.data_dir, settings.storage_url, settings.cache_bytes)
    waiting = Patience(stopping)
    # Two of one name would both resume the same jobs.
    taken = Sentence("server.worker_name_taken", name=name)
    alone = held(files.root / f"lock-worker-{name}", f"--name {name}", taken)
    with alone, suppress(ServiceStopping):
        database = Database(
            settings.full_database_url or "",
            TABLES,
            changed=lambda: None,
            backups=files.backups,
            pause=waiting.database,
            may_migrate=False,
        )
        runner = JobRunner(
            database,
            files,
            _kinds(settings, files, database, given or {}),
            stage_timeout_s=settings.stage_timeout_s,
            executor=f"worker-{name}",
            queues=(NUMERICAL,),
        )

        def state() -> str:
            # The lock's age tells a health check that this process lives and reaches the database.
            os.utime(files.root / f"lock-worker-{name}")
            return waiting.why or runner.host.away or "works"

        presence = Heartbeat(database, f"worker-{name}", state=state)
        try:
            waiting.patiently(presence.start)
            waiting.until(lambda: runner.host.out_of_reach() or other_version(database))
            runner.start()
            _log.info("working", worker=name)
            ready()
            stopping.wait()
        finally:
            runner.stop()
            presence.stop()
            database.close()
            _log.info("stopped", worker=name)


def other_version(database: Database) -> str | None:
    """Explain why the server is not one to work for; None if it is."""
    with database.read() as connection:
        found = connection.execute(sa.select(hosts.c.version).where(hosts.c.id == EXECUTOR)).scalar()
    if found == version("hilfit"):
        return None
    if found is None:
        return "no server has used this database yet; start it"
    return f"the server is hilfit {found}, this worker {version('hilfit')}; give both the same version"


def _kinds(
    settings: Settings, files: DataDirectory, database: Database, given: Mapping[Key, Any]
) -> tuple[JobKind, ...]:
    """List the kinds of jobs that are numerical work, of all resources."""
    parts = Parts(providers_of(RESOURCES))
    parts.put({Settings: settings, DataDirectory: files, Database: database})
    parts.put(given)
    kinds = (kind for resource in RESOURCES for kind in resource.job_kinds)
    return tuple(parts[kind] for kind in kinds if kind.queue == NUMERICAL)
