"""Files that a backup has to hold: those that the copied store names; and copying them while others write and delete.

A running service makes and removes files all the time: places of stages that are over, statistics, uploads. What is
copied is therefore not what a folder happens to hold but what the store names. A file that went before it was copied is
no reason to have no backup; it is said which it was.
"""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Collection, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import sqlalchemy as sa

from server.jobs.job_store import job_files, jobs
from server.platform.database.database_copies import connected
from server.platform.errors import ServiceError
from server.platform.files import DataDirectory
from server.platform.resource import BackedUp, NamedFiles, Resource

#: What is being written now has a name that begins so, or ends so; it is not a file yet.
_UNFINISHED = (".journal", ".partial")


@dataclass(frozen=True)
class BackupContent:
    """Content that a backup has to hold, as the resources declare it."""

    parts: tuple[BackedUp, ...]

    @classmethod
    def of(cls, resources: Iterable[Resource]) -> BackupContent:
        """Collect the content of all resources."""
        return cls(tuple(found for resource in resources if (found := resource.backed_up) is not None))

    @property
    def folders(self) -> frozenset[str]:
        """Folders of the data directory that a backup may hold."""
        return frozenset(part.folder for part in self.parts)

    @property
    def unchanging(self) -> frozenset[str]:
        """Those whose files never change once they are there."""
        return frozenset(part.folder for part in self.parts if part.unchanging)

    def named(self, url: str) -> NamedFiles:
        """Read what the store at ``url`` names."""
        found = NamedFiles()
        with connected(url) as connection:
            for part in self.parts:
                found |= part.named(connection)
        return found


def fetch_results(named: NamedFiles, files: DataDirectory, url: str) -> None:
    """Fetch what jobs left on other hosts before it is copied; what cannot be fetched will be missing."""
    away = [place for place in named.needed if place.count("/") == 2 and not (files.root / place).exists()]
    if not away or not files.storage.shared:
        return
    with connected(url) as connection:
        for place in away:
            folder, name = place.rsplit("/", 1)
            query = sa.select(job_files.c.name, job_files.c.sha256).join(jobs, jobs.c.id == job_files.c.job)
            wanted = (jobs.c.subject == folder.split("/")[1], jobs.c.place == name, job_files.c.use == "result")
            left = {row.name: row.sha256 for row in connection.execute(query.where(*wanted))}
            with suppress(ServiceError):
                files.storage.bring(files.root / place, folder, left)


def copy_named(named: NamedFiles, source: Path, target: Path, unchanging: Collection[str]) -> tuple[str, ...]:
    """Copy what a store names from the data directory ``source``; what was needed and was not there.

    Parameters
    ----------
    unchanging : folders whose files never change, so that a second name is a copy
    """
    for place in sorted(named.needed | named.others):
        for path in _files_below(source / place):
            _copy(path, target / path.relative_to(source), place.split("/")[0] in unchanging)
    return tuple(sorted(place for place in named.needed if not (target / place).exists()))


def _files_below(place: Path) -> Iterator[Path]:
    """Yield a file itself, or the whole files of a directory; whatever vanishes meanwhile is left out."""
    if not place.is_dir():
        yield place
        return

    def tolerate(error: OSError) -> None:
        if error.errno not in (errno.ENOENT, errno.ENOTDIR):
            raise error

    for directory, folders, names in os.walk(place, onerror=tolerate):
        folders[:] = sorted(folder for folder in folders if not folder.startswith("."))
        for name in sorted(names):
            if not name.startswith(".") and not name.endswith(_UNFINISHED):
                yield Path(directory, name)


def _copy(path: Path, copy: Path, linked: bool) -> None:
    """Copy a file, or give it a second name; nothing happens if the file is gone, or was copied before."""
    copy.parent.mkdir(parents=True, exist_ok=True)
    if copy.exists():
        return
    try:
        if linked:
            try:
                os.link(path, copy)
                return
            except FileNotFoundError:
                raise
            except OSError:  # another file system, or one without hard links
                pass
        shutil.copyfile(path, copy)
    except FileNotFoundError:
        if not copy.parent.is_dir():  # it is the backup that went
            raise
