"""Calibrations of a running service."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from fitting.pipeline.stage_names import VALVE_REPORT
from server.audit.audit_resource import Audit
from server.calibrations.calibration_content import content_of, content_of_valves
from server.calibrations.calibration_store import Calibration, CalibrationStore, Of
from server.identifications.identification_results import MODEL_FILE, FitResults, IdentificationResults
from server.platform.authorization.principals import SERVICE, Principal
from server.platform.database.engine import Database
from server.platform.errors import InvalidError, NotFoundError
from server.platform.files import DataDirectory
from server.valves.valve_fits import ValveResults


class Calibrations(CalibrationStore):
    """The store of calibrations, with what makes one of an identification."""

    def __init__(self, database: Database, files: DataDirectory, approves_own: bool = True) -> None:
        super().__init__(database, approves_own)
        self._results: Mapping[Of, FitResults] = {
            "identification": IdentificationResults(database, files),
            "valves": ValveResults(database, files),
        }

    def propose(
        self, source: str, label: str, by: Principal = SERVICE, of: Of = "identification"
    ) -> tuple[Calibration, bool]:
        """Propose an identification, or one of valves; the calibration that it is already, and False, if it is one.

        Raises
        ------
        NotFoundError
            If there is no such identification.
        ConflictError
            If it is not done.
        InvalidError
            If its report cannot be read.
        """
        name, read = ("report.json", content_of) if of == "identification" else (VALVE_REPORT, content_of_valves)
        path = self._results[of].written(source, name)
        try:
            content = read(json.loads(path.read_text()))
        except (ValueError, KeyError, TypeError) as error:
            raise InvalidError("server.cannot_read", name=name, source=source, error=f"{error!r}") from None
        return self.add(self._results[of].get(source), label, content, by, of)

    def model_file(self, id: str) -> dict[str, Any]:
        """Return ``model.json`` of a calibration: its identification's, with the calibration in its provenance.

        Where the identification's files are gone, or are of a version that wrote none, what the calibration kept
        (schema ``hilfit/calibration/1``).
        """
        found = self.get(id)
        try:
            if found.identification is None:
                raise KeyError("of valves: what the calibration keeps is all of it")
            place = self._results["identification"].directory(found.identification)
            content: dict[str, Any] = json.loads((place / MODEL_FILE).read_text(encoding="utf-8"))
            content["provenance"]["calibration"] = id
        except (OSError, ValueError, KeyError, TypeError, NotFoundError):
            content = dict(found.model)
        return content | {"calibration": id, found.kind: found.source, "state": found.state}


class ByPolicy:
    """Steps that schedules take on calibrations without a person; each is in the audit log."""

    def __init__(self, calibrations: Calibrations, audit: Audit) -> None:
        self._calibrations = calibrations
        self._audit = audit

    def active(self, machine: str, of: Of = "identification") -> Calibration | None:
        """Return the one in use."""
        return self._calibrations.active(machine, of)

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
