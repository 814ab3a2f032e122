"""The model in other programs' formats; :func:`export_model` writes one.

A format is a module of :mod:`fitting.model.export.formats`, with the name of the format.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import TYPE_CHECKING

from daq.errors import InputError
from fitting.model.export import formats

if TYPE_CHECKING:
    from fitting.model.arm_model import ArmModel
    from fitting.model.export.words import Written

__all__ = ["export_model", "format_names"]


def format_names() -> list[str]:
    """List the formats of a model's export."""
    return sorted(module.name for module in iter_modules(formats.__path__))


def export_model(model: ArmModel, to: str, path: Path, *, possible: bool = False) -> Written:
    """Write a model in one of :func:`format_names`.

    Parameters
    ----------
    possible : where a format has bodies or a motion, and none have the model's parameters, take the nearest that can
        exist; other formats pass over it

    Raises
    ------
    InputError
        If there is no such format, it cannot hold this model, or the place cannot be written.
    """
    if to not in format_names():
        raise InputError("fitting.export_no_format", name=to, names=format_names())
    written: Written = import_module(f"{formats.__name__}.{to}").write(model, path, possible)
    return written
