"""Identification from Python."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fitting.loop.session import Options, Request
from fitting.pipeline.stages import identify as run
from hilfit.machine import Machine
from hilfit.model import Model
from hilfit.recording import Recording
from hilfit.shown import plot_result, result_html, result_line

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Files = Sequence[str | Path | Recording]


@dataclass(frozen=True, repr=False)
class Result:
    """A finished identification.

    Attributes
    ----------
    report : content of ``report.json`` (schema ``hilfit/report/1``)
    model : the corrected model
    """

    report: dict[str, Any]
    model: Model

    def plot(self, joints: Sequence[str] | None = None) -> Figure:
        """Plot measured and predicted efforts over the held-out motion, and their difference.

        Returns the figure of matplotlib; nothing is shown or saved.

        Parameters
        ----------
        joints : names of those that are drawn; all if None
        """
        return plot_result(self.report, joints)

    def __repr__(self) -> str:
        return f"Result({result_line(self.report)})"

    def _repr_html_(self) -> str:
        return result_html(self.report)


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
    unloaded, train, repeat, validate, operation : recordings (of arrays too), or their files, by role
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
    described = machine if isinstance(machine, Machine) else Machine.load(machine)
    chosen = Options(**options)
    with tempfile.TemporaryDirectory(prefix="hilfit-") as place:
        files = tuple(
            (role, _path(file, described, Path(place) / f"{role}-{number}.parquet"))
            for role, own in roles.items()
            for number, file in enumerate(own, 1)
        )
        folder = Path(place) / "report" if output is None else Path(output)
        report = run(Request(described.path, files, folder, chosen, (language,)))
        return Result(report, Model.load(folder))


def _path(file: str | Path | Recording, machine: Machine, place: Path) -> Path:
    """Return the file of a recording; of arrays one that is written to ``place``."""
    return file.file(machine.content, place) if isinstance(file, Recording) else Path(file)
