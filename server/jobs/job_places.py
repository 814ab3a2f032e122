"""Places of jobs' files: a directory for every execution of a stage, so that whoever comes late spoils nothing.

::

    identifications/<id>/
    ├── 1-check/      what the stage `check` wrote, under claim 1
    ├── 1-fit/        its files again, and what `fit` was writing when its worker fell silent
    ├── 3-fit/        the same stage by whoever took over
    └── 3-report/     the last one: all that stays when the job is over

No two executions have the same number (:mod:`server.jobs.claims`), so nobody else writes there, whatever still runs.
Which directory counts is no question of the file system: the engine records it with the stage, and the store with the
end of the job, each only from whoever has the job. What is recorded is written by nobody any more.
"""

from __future__ import annotations

import shutil
from collections.abc import Collection, Mapping
from contextlib import suppress
from pathlib import Path

import sqlalchemy as sa

from server.jobs.claims import Claim
from server.jobs.job_store import Jobs
from server.jobs.job_store import jobs as job_table
from server.platform.files import DataDirectory
from server.platform.resource import NamedFiles


def place_name(claim: Claim, stage: str) -> str:
    """Return the directory's name of one execution."""
    return f"{claim.number}-{stage}"


def begin(files: DataDirectory, directory: Path, name: str, before: str | None, kept: Mapping[str, str]) -> bool:
    """Make a place below a job's ``directory`` with what the stage before left; False if that is gone.

    Parameters
    ----------
    before : name of the place of the stage before; None: nothing was recorded of one
    kept : SHA-256 of its files, where they may have been left on another host
    """
    if before is not None:
        files.storage.bring(directory / before, files.key(directory), kept)
    if before is None or not (directory / before).is_dir():
        (directory / name).mkdir(parents=True)
        return False
    # No hard links: a late process may write on in a file that is there.
    shutil.copytree(directory / before, directory / name)
    return True


def tidy(files: DataDirectory, directory: Path, keep: str | None, kept: Collection[str]) -> None:
    """Remove every place but the one that counts (None: all), and from the storage all but what was ``kept``."""
    with suppress(OSError):
        for path in directory.iterdir():
            if path.is_dir() and path.name != keep:
                shutil.rmtree(path, ignore_errors=True)
        if keep is None:
            directory.rmdir()
    files.storage.tidy(files.key(directory), kept)


def kept_place(files: DataDirectory, directory: Path, jobs: Jobs, id: str) -> Path:
    """Locate where a finished job left its files, below the ``directory`` of what it made; fetch if needed."""
    job = jobs.get(id)
    # Jobs of store version 3 and before had one directory for all executions.
    place = directory / (job.place or "")
    if job.place is not None and not place.is_dir():
        files.storage.bring(place, files.key(directory), jobs.files(id, "result"))
    return place


def named_results(table: sa.Table, connection: sa.Connection) -> NamedFiles:
    """Select what a store names of the things in ``table`` that jobs make: the place that counts, and all below.

    Their directories are called like the table.
    """
    needed, others = set(), set()
    for id, place in connection.execute(
        sa.select(table.c.id, job_table.c.place).join(job_table, job_table.c.id == table.c.job)
    ):
        others.add(f"{table.name}/{id}")
        if place is not None:
            needed.add(f"{table.name}/{id}/{place}")
    return NamedFiles(frozenset(needed), frozenset(others))
