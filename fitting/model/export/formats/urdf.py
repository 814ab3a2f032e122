"""The links as URDF."""

from __future__ import annotations

from pathlib import Path

from fitting.model.arm_model import ArmModel
from fitting.model.export.bodies import written_bodies
from fitting.model.export.words import Written


def write(model: ArmModel, path: Path, possible: bool = False) -> Written:
    """Write links, joints and their limits as URDF; friction and damping of drives that act on a joint directly."""
    return written_bodies(model, path, "arm.urdf.j2", possible, cylinders=False)
