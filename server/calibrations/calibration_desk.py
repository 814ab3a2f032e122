"""Calibrations of a running service."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

from server.audit.audit_log import Audit
from server.calibrations.calibration_content import content_of
from server.calibrations.calibration_store import Calibration, CalibrationStore
from server.identifications.identification_results import MODEL_FILE, IdentificationResults
from server.identifications.identification_store import Identifications
from server.jobs.job_store import Jobs
from server.platform.authorization.principals import SERVICE, Principal
from server.platform.database.engine import Database
from server.platform.errors import ConflictError, InvalidError, NotFoundError
from server.platform.files import DataDirectory


class Calibrations(CalibrationStore):
    """The store of calibrations, with what makes one of an identification."""

    def __init__(self, database: Database, files: DataDirectory, approves_own: bool = True) -> None:
        super().__init__(database, approves_own)
        self._results = IdentificationResults(database, files)
        self._identifications = Identifications(database)
        self._jobs = Jobs(database)

    def propose(self, identification: str, label: str, by: Principal = SERVICE) -> tuple[Calibration, bool]:
        """Propose an identification; the calibration that it is already, and False, if it was proposed before.

        Raises
        ------
        NotFoundError
            If there is no such identification.
        ConflictError
            If it is not done.
        InvalidError
            If its report cannot be read.
        """
        source = self._identifications.get(identification)
        state = self._jobs.get(source.job).state
        path = self._results.directory(identification) / "report.json"
        if state != "done" or not path.is_file():
            raise ConflictError(f"identification '{identification}' has no report: its job {source.job} is {state}")
        try:
            content = content_of(json.loads(path.read_text()))
        except (ValueError, KeyError, TypeError) as error:
            raise InvalidError(f"report.json of '{identification}' cannot be read ({error!r}); fit it again") from None
        return self.add(source, label, content, by)

    def model_file(self, id: str) -> dict[str, Any]:
        """``model.json`` of a calibration: that of its identification, with the calibration in its provenance.

        Where the identification's files are gone, or are of a version that wrote none, what the calibration kept
        (schema ``hilfit/calibration/1``).
        """
        found = self.get(id)
        try:
            text = (self._results.directory(found.identification) / MODEL_FILE).read_text(encoding="utf-8")
            content: dict[str, Any] = json.loads(text)
            content["provenance"]["calibration"] = id
        except (OSError, ValueError, KeyError, TypeError, NotFoundError):
            content = dict(found.model)
        return content | {"calibration": id, "identification": found.identification, "state": found.state}


class ByPolicy:
    """What schedules do to calibrations without a person; each step is in the audit log."""

    def __init__(self, calibrations: Calibrations, audit: Audit) -> None:
        self._calibrations = calibrations
        self._audit = audit

    def active(self, machine: str) -> Calibration | None:
        """The one in use."""
        return self._calibrations.active(machine)

    def propose(self, identification: str, label: str, by: tuple[str, str] | None = None) -> Calibration:
        """Propose an identification; the same calibration if it was proposed already.

        Parameters
        ----------
        by : id and name of the person who ordered it: to whoever asks for a second person, that one is the first
        """
        who = SERVICE if by is None else replace(SERVICE, id=by[0], name=by[1])
        calibration, made = self._calibrations.propose(identification, label, who)
        if made:
            self._audit.write(SERVICE, "calibrations.propose", calibration.id, {"identification": identification})
        return calibration

    def activate(self, id: str, note: str) -> None:
        """Approve and activate; nothing happens if it is active already."""
        calibration = self._calibrations.get(id)
        if calibration.state == "active":
            return
        if calibration.state == "proposed":
            self._calibrations.decide(id, "approved", SERVICE, note, None)
        self._calibrations.activate(id, None, SERVICE)
        self._audit.write(SERVICE, "calibrations.activate", id, {"note": note})
