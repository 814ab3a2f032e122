"""``hilfit worker``: takes numerical jobs of a service with PostgreSQL, on this host or another.

It needs the service's database and its files: recordings are read and results are written where the service expects
them, so ``data_dir`` is a directory that all share.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import signal
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

import structlog

from server import logs
from server.errors import StartError
from server.executors import Presence
from server.files import DataDirectory, private_files
from server.jobs.excitation import ExcitationKind
from server.jobs.identification import IdentificationKind
from server.jobs.kinds import NUMERICAL
from server.parts import installed_parts
from server.service import Parts
from server.settings import Settings
from server.shared_recordings import SharedRecordings
from server.store import Database
from server.workflows import EXECUTOR, JobRunner

_log = structlog.stdlib.get_logger(__name__)


def work(
    settings: Settings, name: str, ready: Callable[[], None], make_parts: Callable[[], Parts] = installed_parts
) -> None:
    """Take jobs until SIGTERM or SIGINT.

    Parameters
    ----------
    name : of this worker among all that share the database; the same after a restart
    ready : called once it takes jobs

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
    files, parts = DataDirectory(settings.data_dir), make_parts()
    scratch = Path(tempfile.gettempdir()) / f"hilfit-{name}"
    with _alone(files, name):
        shutil.rmtree(scratch, ignore_errors=True)  # what a killed worker of this name had fetched
        database = Database(settings.full_database_url or "", changed=lambda: None, backups=files.backups)
        # The lock's age tells a health check that this process lives and reaches the database.
        presence = Presence(database, f"worker-{name}", lambda: os.utime(files.root / f"lock-worker-{name}"))
        shared = None if settings.recordings_url is None else SharedRecordings(settings.recordings_url)
        identification = IdentificationKind(database, files, parts.program, shared, scratch)
        runner = JobRunner(
            database,
            files,
            [identification, ExcitationKind(database, files, parts.design)],
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


@contextmanager
def _alone(files: DataDirectory, name: str) -> Iterator[None]:
    """Refuse a second worker of the same name: both would resume the same jobs."""
    with (files.root / f"lock-worker-{name}").open("a") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise StartError(f"--name {name}: another worker has this name; give each its own") from None
        yield
