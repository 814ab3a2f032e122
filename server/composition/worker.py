"""``hilfit worker``: takes numerical jobs of a service with PostgreSQL, on this host or another.

It needs the service's database and its files: recordings are read and results are written where the service expects
them, so ``data_dir`` is a directory that all share.
"""

from __future__ import annotations

import os
import shutil
import signal
import tempfile
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from types import FrameType
from typing import Any

import structlog

from server.composition.declarations import RESOURCES, TABLES
from server.identifications.identification_resource import FETCHED
from server.jobs.executors import Heartbeat
from server.jobs.job_kinds import NUMERICAL, JobKind
from server.jobs.job_runner import EXECUTOR, JobRunner
from server.platform import logs
from server.platform.database.engine import Database
from server.platform.errors import StartError
from server.platform.files import DataDirectory, held, private_files
from server.platform.parts import Key, Parts
from server.platform.resource import providers_of
from server.platform.settings import Settings
from server.recordings.shared_recordings import SharedRecordings

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
        raise StartError("database_url: is not set; workers need the PostgreSQL of their service")
    if name == EXECUTOR or not name.replace("-", "").replace("_", "").replace(".", "").isalnum():
        raise StartError(f"--name {name}: use letters, digits, '-', '_' and '.', and not '{EXECUTOR}'")
    private_files()
    logs.configure()
    told = threading.Event()

    def stop(_number: int, _frame: FrameType | None) -> None:
        told.set()

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, stop)
    files = DataDirectory(settings.data_dir)
    scratch = Path(tempfile.gettempdir()) / f"hilfit-{name}"
    # Two of one name would both resume the same jobs.
    with held(files.root / f"lock-worker-{name}", f"--name {name}", "another worker has this name; give each its own"):
        shutil.rmtree(scratch, ignore_errors=True)  # what a killed worker of this name had fetched
        database = Database(settings.full_database_url or "", TABLES, changed=lambda: None, backups=files.backups)
        # The lock's age tells a health check that this process lives and reaches the database.
        presence = Heartbeat(database, f"worker-{name}", lambda: os.utime(files.root / f"lock-worker-{name}"))
        kinds = _kinds(settings, files, database, scratch, given or {})
        runner = JobRunner(
            database,
            files,
            kinds,
            stage_timeout_s=settings.stage_timeout_s,
            executor=f"worker-{name}",
            queues=(NUMERICAL,),
        )
        try:
            presence.start()
            runner.start()
            _log.info("working", worker=name)
            ready()
            told.wait()
        finally:
            runner.stop()
            presence.stop()
            database.close()
            _log.info("stopped", worker=name)


def _kinds(
    settings: Settings, files: DataDirectory, database: Database, scratch: Path, given: Mapping[Key, Any]
) -> tuple[JobKind, ...]:
    """The kinds of jobs that are numerical work, of all resources."""
    parts = Parts(providers_of(RESOURCES))
    url = settings.recordings_url
    fetched = None if url is None else (SharedRecordings(url), scratch)
    parts.put({Settings: settings, DataDirectory: files, Database: database, FETCHED: fetched})
    parts.put(given)
    kinds = (kind for resource in RESOURCES for kind in resource.job_kinds)
    return tuple(parts[kind] for kind in kinds if kind.queue == NUMERICAL)
