"""The links as MJCF: gravity, and drives; cylinders are tendons that two pressures pull on."""

from __future__ import annotations

from pathlib import Path

from fitting.model.arm_model import ArmModel
from fitting.model.export.bodies import written_bodies
from fitting.model.export.words import Written


def write(model: ArmModel, path: Path, possible: bool = False) -> Written:
    """Write links, joints, gravity and drives as MJCF."""
    return written_bodies(model, path, "arm.mjcf.j2", possible, cylinders=True)
