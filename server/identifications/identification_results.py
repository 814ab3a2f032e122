"""Where identifications left their files."""

from __future__ import annotations

from pathlib import Path

from server.identifications.identification_store import Identifications
from server.jobs.job_places import kept_place
from server.jobs.job_store import Jobs
from server.platform.database.engine import Database
from server.platform.files import DataDirectory

#: The model's name among the files of an identification.
MODEL_FILE = "model.json"


class IdentificationResults:
    """Directories of requests, results of stages, and reports."""

    def __init__(self, database: Database, files: DataDirectory) -> None:
        self._files = files
        self._jobs = Jobs(database)
        self._identifications = Identifications(database)

    def directory(self, id: str) -> Path:
        """Of one identification; NotFoundError if there is none."""
        job = self._identifications.get(id).job
        return kept_place(self._files, self._files.identifications / id, self._jobs, job)
