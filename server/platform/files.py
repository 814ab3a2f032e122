"""The data directory: where the service keeps files, and how they get there whole or not at all.

::

    data_dir/
    ├── hilfit.sqlite            store and workflow engine
    ├── lock                     held by the one server that uses this directory
    ├── machines/<name>/<version>.yaml
    ├── recordings/<id>.parquet|.csv, with .journal while being recorded, .incoming-* while being uploaded
    ├── excitations/<id>/<place>/        request.json, motion.csv, result.json, design.log
    ├── recalibrations/<id>/<place>/     request and log of the comparison
    ├── backups/<time>/          copies of everything that cannot be made again
    ├── identifications/<id>/<place>/    request.json, artefacts of the stages, report.json, report.html,
    │                                    report.de.html, <stage>.log
    ├── valves/<id>/<place>/     request.json, valve.json, inverse/, valve.log
    ├── tls/                     the site's own certificate and key
    ├── webhooks/site.key        what secrets of webhooks are made of; in no backup
    ├── monitor/                 what monitors learnt, per calibration, and their logs
    ├── cache/<SHA-256>/         what a worker fetched (server.platform.storage)
    └── simulation/              machine file and inbox of the simulated machine

A place is the directory of one execution of a stage (:mod:`server.jobs.job_places`).
"""

from __future__ import annotations

import fcntl
import os
import re
import secrets
import shutil
from collections.abc import AsyncIterable, Awaitable, Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from daq.messages import Sentence
from daq.whole_files import sync_directory
from server.platform.errors import ConflictError, StartError, TooLargeError, UnavailableError
from server.platform.storage import DataFolder, SharedStorage

#: Bytes gathered before one write to disk; small enough to be nothing in memory.
WRITE_BYTES = 2**20
DATABASE_FILE = "hilfit.sqlite"
LOCK_FILE = "lock"
#: How temporary files of a child begin, in the folder that it may write to (:mod:`server.platform.processes.children`).
TEMPORARY = ".child-"


@contextmanager
def held(lock: Path, place: str, taken: Sentence) -> Iterator[int]:
    """Hold a lock file, which goes with the process; gives its descriptor.

    Raises
    ------
    StartError
        If another process holds it (then ``taken`` is its text), or it cannot be written.
    """
    try:
        opened = lock.open("a")
    except OSError as error:
        raise StartError("server.place_not_writable", place=place, reason=error.strerror) from None
    with opened as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise StartError(taken) from None
        yield file.fileno()


class DataDirectory:
    """Paths below ``data_dir``; creates the directories.

    Parameters
    ----------
    url, cache_bytes : ``storage_url`` and ``cache_bytes`` of the settings

    Attributes
    ----------
    storage : how its files come to other hosts, and theirs here
    """

    def __init__(self, root: Path, url: str | None = None, cache_bytes: int = 4 * 2**30) -> None:
        self.root = root.resolve()
        self._held: int | None = None
        self.machines = self.root / "machines"
        self.recordings = self.root / "recordings"
        self.identifications = self.root / "identifications"
        self.excitations = self.root / "excitations"
        self.recalibrations = self.root / "recalibrations"
        self.backups = self.root / "backups"
        self.simulation = self.root / "simulation"
        try:
            for directory in (self.root, self.machines, self.recordings, self.identifications):
                directory.mkdir(parents=True, exist_ok=True)
            if self.root.stat().st_mode & 0o077:  # made before its files were private, or by somebody else
                _make_private(self.root)
        except OSError as error:
            raise StartError("server.data_dir_not_made", root=root, reason=error.strerror) from None
        self.storage = DataFolder(self.root) if url is None else SharedStorage(url, self.root, cache_bytes)

    @property
    def database(self) -> Path:
        """The SQLite file."""
        return self.root / DATABASE_FILE

    def machine_file(self, name: str, version: int) -> Path:
        """Locate the text of one version of a machine file; never changed once written."""
        return self.machines / name / f"{version}.yaml"

    def recording(self, id: str, format: str) -> Path:
        """Locate a sealed recording."""
        return self.recordings / f"{id}.{format}"

    def key(self, path: Path) -> str:
        """Return a path below the directory as hosts that share it write it."""
        return str(path.relative_to(self.root))

    def without_place(self, text: str) -> str:
        """Remove the place of the directory and of its cache from a text."""
        for place in re.findall(f"{re.escape(str(self.root))}/(?:cache/[0-9a-f]{{64}}/)?", text):
            text = text.replace(place, "")
        return text

    def incoming(self) -> Path:
        """Return a new name for an upload in progress."""
        return self.recordings / f".incoming-{secrets.token_hex(8)}"

    def clean(self) -> None:
        """Remove what interrupted uploads and killed children left behind; called before anything is served."""
        for leftover in self.recordings.glob(".incoming-*"):
            leftover.unlink(missing_ok=True)
        for leftover in self.root.glob(f"*/{TEMPORARY}*"):
            shutil.rmtree(leftover, ignore_errors=True)

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Hold the directory for this server.

        Two servers on one directory would both resume its unfinished jobs.

        Raises
        ------
        StartError
            If another server holds it.
        """
        taken = Sentence("server.data_dir_in_use", root=self.root)
        with held(self.root / LOCK_FILE, f"--data-dir {self.root}", taken) as self._held:
            try:
                yield
            finally:
                self._held = None

    def check(self) -> None:
        """See that the directory is the one that this server holds, and that it can be written.

        Raises
        ------
        UnavailableError
            If it was deleted, replaced or closed to us, or its disk is full.
        """
        try:
            if self._held is not None and not os.path.samestat((self.root / LOCK_FILE).stat(), os.fstat(self._held)):
                raise UnavailableError("server.data_directory_another_start")
            for directory in (self.machines, self.recordings, self.identifications):
                directory.stat()
            probe = self.root / f".probe-{secrets.token_hex(4)}"
            probe.write_bytes(b"written")
            probe.unlink()
        except OSError as error:
            raise UnavailableError("server.data_directory_cannot_used", reason=error.strerror) from None


def private_files() -> None:
    """Let this process, and what it starts, make files that only its user can read."""
    os.umask(0o077)


def _make_private(root: Path) -> None:
    """Take all rights of others from a directory and what is in it; links are left alone."""
    for directory, _, names in os.walk(root):
        for path in (Path(directory), *(Path(directory, name) for name in names)):
            if not path.is_symlink():
                with suppress(FileNotFoundError):  # of a service that runs
                    path.chmod(path.stat().st_mode & 0o700)


def sync_tree(directory: Path) -> None:
    """Make every file below ``directory`` and the directory itself survive a power cut."""
    for path in sorted(directory.rglob("*"), reverse=True):
        if path.is_dir():
            sync_directory(path)
        else:
            with path.open("rb") as file:
                os.fsync(file.fileno())
    sync_directory(directory)
    sync_directory(directory.parent)


async def receive(
    chunks: AsyncIterable[bytes],
    path: Path,
    limit: int,
    in_thread: Callable[..., Awaitable[Any]],
    room: Callable[[], object] = lambda: None,
) -> int:
    """Stream ``chunks`` into the new file ``path``, synced; the file is removed if anything goes wrong.

    Parameters
    ----------
    limit : most bytes taken
    in_thread : runs a blocking call elsewhere, ``await in_thread(function, *arguments)``
    room : called before each write; raises ConflictError if the disk has to take no more

    Returns
    -------
    Bytes written.

    Raises
    ------
    TooLargeError
        As soon as more than ``limit`` bytes came.
    ConflictError
        If the disk is full.
    """
    size = 0
    pending = bytearray()
    file = await in_thread(path.open, "xb")
    try:
        async for chunk in chunks:
            size += len(chunk)
            if size > limit:
                raise TooLargeError("server.upload_larger_bytes", limit=limit)
            pending += chunk
            if len(pending) >= WRITE_BYTES:
                await in_thread(room)
                await in_thread(file.write, bytes(pending))
                pending.clear()
        await in_thread(_finish, file, bytes(pending))
    except OSError as error:
        await in_thread(path.unlink, True)
        raise ConflictError("server.upload_cannot_stored", reason=error.strerror) from None
    except BaseException:
        path.unlink(missing_ok=True)
        raise
    finally:
        file.close()
    return size


def _finish(file: Any, rest: bytes) -> None:
    file.write(rest)
    file.flush()
    os.fsync(file.fileno())


#: Free bytes that recordings and uploads leave to the database, beyond what sealing the running ones takes.
RESERVE_BYTES = 256 * 2**20
Free = Callable[[], int]


def free_bytes(recordings: Path) -> int:
    """Count free bytes below ``recordings``, after what sealing its journals will take."""
    sizes = 0
    for journal in recordings.glob("*.journal"):
        try:
            sizes += journal.stat().st_size
        except FileNotFoundError:  # it was sealed meanwhile
            continue
    return shutil.disk_usage(recordings).free - sizes


def require_room(free: int, needed: int = 0) -> None:
    """Refuse what fills the disk.

    Parameters
    ----------
    needed : bytes that it will take, as far as that is known

    Raises
    ------
    ConflictError
        If not more than :data:`RESERVE_BYTES` would be free.
    """
    if free - needed <= RESERVE_BYTES:
        raise ConflictError(
            "server.disk_full_mib_free",
            free=max(free, 0) // 2**20,
            needed=needed // 2**20,
            reserve_bytes=RESERVE_BYTES // 2**20,
        )
