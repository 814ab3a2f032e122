"""The model in other programs' formats; :func:`export_model` writes one."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from daq.errors import InputError
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
#: Those of links with masses and inertias.
BODIES = ("urdf", "mjcf")


def export_model(model: ArmModel, to: str, path: Path, *, possible: bool = False) -> Written:
    """Write a model in one of :data:`FORMATS`.

    Parameters
    ----------
    possible : where a format has bodies and none have the model's base parameters, take the nearest that can exist

    Raises
    ------
    InputError
        If there is no such format, it cannot hold this model, or the place cannot be written.
    """
    if to not in FORMATS:
        raise InputError(f"export: there is no format '{to}'; use one of {', '.join(FORMATS)}")
    module, name = FORMATS[to].split(":")
    write: Callable[..., Written] = getattr(import_module(module), name)
    return write(model, path, possible=possible) if to in BODIES else write(model, path)
