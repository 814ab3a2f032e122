"""Backups: everything that cannot be made again, as plain files in a directory of its own.

::

    backups/2026-06-01T020000Z/
    ├── manifest.json            version, time, SHA-256 and size of every file, and what was missing; written last:
    │                            without it, it is none
    ├── store.sqlite|.pgdump     the whole database
    └── machines/, recordings/, excitations/, identifications/

A sealed recording never changes, so where backup and service are on one file system it is a second name of the same
bytes (hard link) and takes no room; anything else is copied.
"""

from __future__ import annotations

import errno
import json
import secrets
import shutil
import threading
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from importlib.metadata import version
from pathlib import Path

import structlog

from daq.errors import HilfitError
from daq.messages import Sentence
from daq.whole_files import digest_of, sync_directory, write_whole
from server.backups.backup_files import BackupContent, copy_named, fetch_results
from server.platform.database.database_copies import check_restore, copy_database, newer, restore_database
from server.platform.database.engine import as_stored
from server.platform.database.schema import SCHEMA_VERSION
from server.platform.database.site_marker import SiteMarker
from server.platform.errors import StartError
from server.platform.files import DataDirectory, sync_tree
from server.platform.http.bodies import Shown
from server.platform.processes.rounds import Rounds

MANIFEST = "manifest.json"
DAILY = timedelta(days=1)
#: Daily backups that are kept; those that somebody ordered stay until somebody removes them.
KEPT = 14
LOOK_S = 60.0
_log = structlog.stdlib.get_logger(__name__)


class BackupResource(Shown):
    """A backup; ``kind`` is daily or ordered. It is restored by ``hilfit restore``, with the service stopped.

    ``missing``: files that the store names and that were gone when they were to be copied.
    """

    id: str
    created: str
    bytes: int
    kind: str
    missing: tuple[str, ...]


class Backups:
    """The backups of one data directory.

    Parameters
    ----------
    content : what a backup has to hold
    url : of the database
    directory : where they are kept; by default in the data directory
    """

    def __init__(
        self,
        files: DataDirectory,
        content: BackupContent,
        url: str,
        now: Callable[[], datetime],
        directory: Path | None = None,
    ) -> None:
        self._files = files
        self._content = content
        self._url = url
        self._now = now
        self.directory = files.backups if directory is None else directory.resolve()
        self._lock = threading.Lock()

    def make(self, kind: str = "ordered") -> BackupResource:
        """Make one while the service runs.

        Raises
        ------
        StartError
            If it cannot be written; one line.
        """
        with self._lock:
            moment = self._now().astimezone(UTC)
            id = f"{moment:%Y-%m-%dT%H%M%S.%f}"[:-3] + "Z"
            partial = self.directory / f".{id}.partial"
            try:
                partial.mkdir(parents=True)
                missing = self._copy(partial)
                manifest = {
                    "hilfit": version("hilfit"),
                    "created": as_stored(moment),
                    "kind": kind,
                    "store": SCHEMA_VERSION,
                    "missing": list(missing),
                    "files": _files_of(partial),
                }
                write_whole(partial / MANIFEST, json.dumps(manifest, indent=1).encode())
                partial.rename(self.directory / id)
                sync_directory(self.directory)
            except OSError as error:
                code = "server.backup_disk_full" if _is_full(error) else "server.backup_not_written"
                raise StartError(code, directory=self.directory, reason=error.strerror) from None
            finally:
                shutil.rmtree(partial, ignore_errors=True)
        found = _backup(self.directory / id)
        assert found is not None
        _log.info("backup_made", backup=id, bytes=found.bytes)
        if missing:
            _log.warning("backup_incomplete", backup=id, missing=missing)
        return found

    def _copy(self, partial: Path) -> tuple[str, ...]:
        """Copy the store, then all that the copy names; what of that was not there."""
        # What is made after the copy is one file too many, which harms nobody. PostgreSQL's copy cannot be read here:
        # what it names was named before it was made, or after.
        before = None if self._url.startswith("sqlite") else self._content.named(self._url)
        copy = copy_database(self._url, partial, "store")
        named = self._content.named(f"sqlite:///{copy}") if before is None else before | self._content.named(self._url)
        fetch_results(named, self._files, self._url)
        return copy_named(named, self._files.root, partial, self._content.unchanging)

    def list(self) -> tuple[BackupResource, ...]:
        """List newest first."""
        found = (_backup(path) for path in sorted(self.directory.glob("*Z"), reverse=True))
        return tuple(backup for backup in found if backup is not None)

    def daily(self) -> BackupResource | None:
        """Make one if the newest is a day old, and remove daily ones beyond :data:`KEPT`."""
        # One from a time that is still to come was made while the clock was wrong: it is no reason to wait.
        ages = [self._now() - datetime.fromisoformat(backup.created) for backup in self.list()]
        if any(timedelta(0) <= age < DAILY for age in ages):
            return None
        made = self.make("daily")
        # By the clock as it is now: those of a time to come stay until it has come.
        past = [backup for backup in self.list() if datetime.fromisoformat(backup.created) <= self._now()]
        for old in [backup for backup in past if backup.kind == "daily"][KEPT:]:
            shutil.rmtree(self.directory / old.id, ignore_errors=True)
        return made


class DailyBackups:
    """Makes a backup a day while the service runs."""

    def __init__(self, backups: Backups, troubles: dict[str, str]) -> None:
        self._backups = backups
        self._troubles = troubles
        # The first look is after a minute, when whatever starts has started.
        self.rounds = Rounds("backups", LOOK_S, self.look)

    def look(self) -> None:
        """Make a backup if one is due; one that cannot be made is a trouble until one can."""
        try:
            self._backups.daily()
            self._troubles.pop("backup_failed", None)
        except Exception as error:  # of a store or a disk that is away; the next look may do better
            own = isinstance(error, HilfitError)
            reason = str(error) if own else "the log of the service says why"
            self._troubles["backup_failed"] = Sentence("server.daily_backup_failed", reason=reason)
            _log.error("backup_failed", error=str(error), exc_info=None if own else error)


def manifest_of(backup: Path) -> dict[str, str]:
    """Read SHA-256 of every file of a backup, by its path in there.

    Raises
    ------
    StartError
        If it is no backup, or was made by a newer hilfit.
    """
    if not backup.is_dir():
        what = "is a file" if backup.exists() else "there is no such directory"
        raise StartError("server.give_backup_directory", backup=backup, what=what, manifest=MANIFEST)
    try:
        manifest = json.loads((backup / MANIFEST).read_text(encoding="utf-8"))
        wanted = {str(entry["path"]): str(entry["sha256"]) for entry in manifest["files"]}
        store = int(manifest.get("store", 0))
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        raise StartError("server.no_backup", backup=backup, manifest=MANIFEST) from None
    if store > SCHEMA_VERSION:
        raise StartError(newer(backup, store))
    return wanted


def restore(backup: Path, files: DataDirectory, content: BackupContent, url: str) -> int:
    """Put a backup in the place of what is there; the number of files.

    The caller holds the lock of the data directory. Files that are not in the backup remain. Everything is
    copied beside the data first, so what can go wrong does before anything is changed.

    Raises
    ------
    StartError
        If it is no backup, a file of it is damaged, or it cannot be written here; nothing is changed then.
    """
    wanted = manifest_of(backup)
    stores = [name for name in wanted if name.startswith("store.") and "/" not in name]
    if len(stores) != 1:
        raise StartError("server.backup_no_store", backup=backup)
    for name, expected in wanted.items():
        if name not in stores and (name.split("/")[0] not in content.folders or ".." in name.split("/")):
            raise StartError("server.backup_no_place", backup=backup, name=name)
        path = backup / name
        if not path.resolve().is_relative_to(backup.resolve()) or not path.is_file():
            raise StartError("server.backup_file_missing", backup=backup, name=name)
        if _sum_of(path) != expected:
            raise StartError("server.backup_file_damaged", backup=backup, name=name)
    check_restore(backup / stores[0], url)
    staged = files.root / f".restoring-{secrets.token_hex(4)}"
    try:
        for name in wanted:
            (staged / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(backup / name, staged / name)
            (files.root / name).parent.mkdir(parents=True, exist_ok=True)
        sync_tree(staged)
        for name in wanted:
            if name not in stores:
                (staged / name).replace(files.root / name)
        SiteMarker(files.root, backup.parent).forget()
        restore_database(staged / stores[0], url)
    except OSError as error:
        raise StartError("server.backup_not_restored", root=files.root, backup=backup, reason=error.strerror) from None
    finally:
        shutil.rmtree(staged, ignore_errors=True)
    return len(wanted)


def _is_full(error: OSError) -> bool:
    """Return whether the disk has no space left, or none for this user."""
    return error.errno in (errno.ENOSPC, errno.EDQUOT)


def _sum_of(path: Path) -> str:
    try:
        return digest_of(path)
    except OSError as error:
        raise StartError("server.backup_not_readable", path=path, reason=error.strerror) from None


def _files_of(directory: Path) -> list[dict[str, str | int]]:
    return [
        {"path": str(path.relative_to(directory)), "sha256": digest_of(path), "bytes": path.stat().st_size}
        for path in sorted(directory.rglob("*"))
        if path.is_file()
    ]


def _backup(path: Path) -> BackupResource | None:
    try:
        manifest = json.loads((path / MANIFEST).read_text(encoding="utf-8"))
        size = sum(int(entry["bytes"]) for entry in manifest["files"])
        missing = tuple(str(name) for name in manifest.get("missing", ()))
        return BackupResource(
            id=path.name, created=str(manifest["created"]), bytes=size, kind=str(manifest["kind"]), missing=missing
        )
    except (OSError, ValueError, KeyError, TypeError):
        return None
