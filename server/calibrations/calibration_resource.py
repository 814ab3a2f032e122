"""The resource ``calibrations``: identifications that a person approved."""

from __future__ import annotations

from server.audit.audit_log import Audit
from server.calibrations.calibration_desk import ByPolicy, Calibrations
from server.calibrations.calibration_routes import machine_router, router
from server.calibrations.calibration_store import activations, calibration_steps, calibrations
from server.platform.database.engine import Database
from server.platform.files import DataDirectory
from server.platform.parts import Parts
from server.platform.resource import Resource
from server.platform.settings import Settings


def _calibrations(parts: Parts) -> Calibrations:
    return Calibrations(parts[Database], parts[DataDirectory], parts[Settings].approves_own)


CALIBRATIONS = Resource(
    name="calibrations",
    routers=(router, machine_router),
    tables=(calibrations, calibration_steps, activations),
    of_a_machine={"calibrations": calibrations},
    kept={"/calibrations": ("calibrations",)},
    provides={Calibrations: _calibrations, ByPolicy: lambda parts: ByPolicy(parts[Calibrations], parts[Audit])},
)
