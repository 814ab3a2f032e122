"""The model in other programs' formats; :func:`export_model` writes one."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from fitting.model.arm_model import ArmModel
from fitting.model.export.words import Written

__all__ = ["FORMATS", "Written", "export_model"]

#: Formats, and where the function is that writes each.
FORMATS = {
    "python": "fitting.model.export.python:write_python",
    "c": "fitting.model.export.c:write_c",
    "fmu": "fitting.model.export.fmu:write_fmu",
    "matlab": "fitting.model.export.matlab:write_matlab",
    "csv": "fitting.model.export.tables:write_csv",
    "urdf": "fitting.model.export.simulators:write_urdf",
    "mjcf": "fitting.model.export.simulators:write_mjcf",
}


def export_model(model: ArmModel, to: str, path: Path) -> Written:
    """Write a model in one of :data:`FORMATS`.

    Raises
    ------
    InputError
        If the format cannot hold this model, or the place cannot be written.
    """
    module, name = FORMATS[to].split(":")
    write: Callable[[ArmModel, Path], Written] = getattr(import_module(module), name)
    return write(model, path)
