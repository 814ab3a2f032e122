"""Files of fits, and their verdicts."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

from fitting.report.schema.definition import looked
from server.identifications.identification_store import Fit, Fits, Identifications
from server.jobs.job_places import kept_place
from server.jobs.job_store import Jobs
from server.platform.database.engine import Database
from server.platform.errors import ConflictError
from server.platform.files import DataDirectory


def verdict_of(report: Mapping[str, Any]) -> str:
    """Return the report's verdict; ``not_looked_for`` if without the loop, where it would mean nothing."""
    loop = report["loop"]
    return str(loop["verdict"]) if looked(loop) else "not_looked_for"


#: The model's name among the files of an identification.
MODEL_FILE = "model.json"


class FitResults:
    """Directories of requests, results of stages, and reports; ``fits`` is where what they are of is stored."""

    fits: ClassVar[type[Fits[Any]]]

    def __init__(self, database: Database, files: DataDirectory) -> None:
        self._files = files
        self._jobs = Jobs(database)
        self._fits = self.fits(database)

    def directory(self, id: str) -> Path:
        """Locate one fit; NotFoundError if there is none."""
        return kept_place(
            self._files, self._files.root / self.fits.of.table.name / id, self._jobs, self._fits.get(id).job
        )

    def get(self, id: str) -> Fit:
        """Return one fit; NotFoundError if there is none."""
        found: Fit = self._fits.get(id)
        return found

    def written(self, id: str, name: str) -> Path:
        """Locate a file that every fit which is done has.

        Raises
        ------
        NotFoundError, ConflictError
            If there is no such fit, or it is not done.
        """
        job = self._jobs.get(self._fits.get(id).job)
        path = self.directory(id) / name
        if job.state != "done" or not path.is_file():
            raise ConflictError("server.no_job", one=self.fits.one, id=id, name=name, job=job.id, state=job.state)
        return path


class IdentificationResults(FitResults):
    """Of identifications."""

    fits = Identifications
