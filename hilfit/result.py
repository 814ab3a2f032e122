"""Identification from Python."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fitting.loop.session import Options, Request
from fitting.pipeline.stages import identify as run
from hilfit.machine import Machine
from hilfit.model import Model
from hilfit.recording import Recording

Files = Sequence[str | Path | Recording]


@dataclass(frozen=True)
class Result:
    """A finished identification.

    Attributes
    ----------
    report : content of ``report.json`` (schema ``hilfit/report/1``)
    model : the corrected model
    """

    report: dict[str, Any]
    model: Model


def identify(
    machine: Machine | str | Path,
    unloaded: Files = (),
    train: Files = (),
    repeat: Files = (),
    validate: Files = (),
    *,
    operation: Files = (),
    output: str | Path | None = None,
    language: str = "en",
    **options: Any,
) -> Result:
    """Identify an arm from recordings and find what its model lacks: ``hilfit identify``.

    Parameters
    ----------
    machine : machine or its file
    unloaded, train, repeat, validate, operation : recordings, or their files, by role
    output : folder that keeps ``report.json``, ``report.html`` and ``model.json``; None keeps nothing
    language : of ``report.html``, ``en`` or ``de``
    options : fields of :class:`fitting.Options`: ``loop``, ``bandwidth_hz``, ``bootstrap``, ``estimator``, ...

    Raises
    ------
    InputError
        One line about the machine file, a recording or the language.
    TypeError
        For an option that there is not.
    """
    roles = {"unloaded": unloaded, "train": train, "repeat": repeat, "validate": validate, "operation": operation}
    files = tuple((role, _path(file)) for role, own in roles.items() for file in own)
    path = machine.path if isinstance(machine, Machine) else Path(machine)
    chosen = Options(**options)
    if output is not None:
        return _done(Request(path, files, Path(output), chosen, (language,)))
    with tempfile.TemporaryDirectory(prefix="hilfit-") as place:
        return _done(Request(path, files, Path(place), chosen, (language,)))


def _path(file: str | Path | Recording) -> Path:
    return file.path if isinstance(file, Recording) else Path(file)


def _done(request: Request) -> Result:
    report = run(request)
    return Result(report, Model.load(request.output))
