"""Where jobs keep files: a directory for every execution of a stage, so that whoever comes late spoils nothing.

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
from contextlib import suppress
from pathlib import Path

from server.jobs.claims import Claim
from server.jobs.job_store import Job


def place_name(claim: Claim, stage: str) -> str:
    """Name of the directory of one execution."""
    return f"{claim.number}-{stage}"


def begin(directory: Path, name: str, before: str | None) -> bool:
    """Make a place below a job's ``directory`` with what the stage before left; False if that is gone.

    Parameters
    ----------
    before : name of the place of the stage before; None: nothing was recorded of one
    """
    if before is None or not (directory / before).is_dir():
        (directory / name).mkdir(parents=True)
        return False
    # No hard links: a late process may write on in a file that is there.
    shutil.copytree(directory / before, directory / name)
    return True


def tidy(directory: Path, keep: str) -> None:
    """Remove every place but the one that counts."""
    with suppress(OSError):
        for path in directory.iterdir():
            if path.is_dir() and path.name != keep:
                shutil.rmtree(path, ignore_errors=True)


def kept_place(directory: Path, job: Job) -> Path:
    """Where a job that is over left its files, below the ``directory`` of what it made."""
    # Jobs of store version 3 and before had one directory for all executions.
    return directory / (job.place or "")
