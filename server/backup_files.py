"""Which files a backup has to hold: those that the copied store names; and copying them while others write and delete.

A running service makes and removes files all the time: places of stages that are over, statistics, uploads. What is
copied is therefore not what a folder happens to hold but what the store names. A file that went before it was copied is
no reason to have no backup; it is said which it was.
"""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import sqlalchemy as sa

from server.store.tables import excitations, identifications, jobs, machine_versions, recordings

FOLDERS = ("machines", "recordings", "excitations", "identifications")
#: The folder whose files never change once they are there.
LINKED = "recordings"
#: What is being written now has a name that begins so, or ends so; it is not a file yet.
_UNFINISHED = (".journal", ".partial")


@dataclass(frozen=True)
class Named:
    """What a store names, as paths relative to the data directory.

    Attributes
    ----------
    needed : files, or directories of results, without which something in the store would be empty
    others : files and directories that are copied if they are there
    """

    needed: frozenset[str]
    others: frozenset[str]

    def __or__(self, other: Named) -> Named:
        """What either names."""
        return Named(self.needed | other.needed, self.others | other.others)


def named_files(url: str) -> Named:
    """What the store at ``url`` names."""
    needed: set[str] = set()
    others: set[str] = set()
    engine = sa.create_engine(url, poolclass=sa.NullPool)
    try:
        with engine.connect() as connection:
            for version in connection.execute(sa.select(machine_versions.c.name, machine_versions.c.version)):
                needed.add(f"machines/{version.name}/{version.version}.yaml")
            for row in connection.execute(sa.select(recordings.c.id, recordings.c.format, recordings.c.state)):
                (needed if row.state == "sealed" else others).add(f"recordings/{row.id}.{row.format}")
                others.add(f"recordings/{row.id}.statistics.json")
            for table in (identifications, excitations):
                made = sa.select(table.c.id, jobs.c.place).join(jobs, jobs.c.id == table.c.job)
                for id, place in connection.execute(made):
                    others.add(f"{table.name}/{id}")
                    if place is not None:
                        needed.add(f"{table.name}/{id}/{place}")
    finally:
        engine.dispose()
    return Named(frozenset(needed), frozenset(others))


def copy_named(named: Named, source: Path, target: Path) -> tuple[str, ...]:
    """Copy what a store names from the data directory ``source``; what was needed and was not there."""
    for place in sorted(named.needed | named.others):
        for path in _files_below(source / place):
            _copy(path, target / path.relative_to(source))
    return tuple(sorted(place for place in named.needed if not (target / place).exists()))


def _files_below(place: Path) -> Iterator[Path]:
    """A file itself, or the whole files of a directory; whatever vanishes meanwhile is left out."""
    if not place.is_dir():
        yield place
        return

    def tolerate(error: OSError) -> None:
        if error.errno not in (errno.ENOENT, errno.ENOTDIR):
            raise error

    for directory, folders, names in os.walk(place, onerror=tolerate):
        folders.sort()
        for name in sorted(names):
            if not name.startswith(".") and not name.endswith(_UNFINISHED):
                yield Path(directory, name)


def _copy(path: Path, copy: Path) -> None:
    """Copy a file, or give a recording a second name; nothing happens if the file is gone, or was copied before."""
    copy.parent.mkdir(parents=True, exist_ok=True)
    if copy.exists():
        return
    try:
        if path.parent.name == LINKED:
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
