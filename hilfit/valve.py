"""Valves from Python."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from daq.recordings.recording import Recording as RecordingFile
from daq.recordings.recording import read_recording
from fitting.valve.identify import identify_valves
from fitting.valve.inverse import ValveModel
from hilfit.machine import Machine
from hilfit.recording import Recording
from hilfit.shown import plot_valves

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Files = Sequence[str | Path | Recording]


@dataclass(frozen=True, repr=False)
class ValveResult:
    """Identified valves.

    Attributes
    ----------
    report : content of ``valve.json`` (schema ``hilfit/valve/1``)
    models : of each axis what is handed out; ``models["boom"].command(0.1)`` is the command for 0.1 m/s
    """

    report: dict[str, Any]
    models: Mapping[str, ValveModel]

    def plot(self, joints: Sequence[str] | None = None) -> Figure:
        """Plot speed over command, and measured beside predicted speed on the judged motion.

        Returns the figure of matplotlib; nothing is shown or saved.

        Parameters
        ----------
        joints : names of the axes that are drawn; all if None
        """
        return plot_valves(self.report, joints)

    def __repr__(self) -> str:
        errors = ", ".join(f"{n} {own['errors']['handed_out']:.3g}" for n, own in self.report["axes"].items())
        return f"ValveResult(error over the speed's RMS: {errors})"


def identify_valve(
    machine: Machine | str | Path,
    recordings: Files,
    validate: Files = (),
    *,
    bandwidth_hz: float | None = None,
    loop: bool = True,
) -> ValveResult:
    """Identify what speed a command gives, axis by axis: ``hilfit valve``.

    Parameters
    ----------
    machine : machine or its file; every axis with a ``cylinder.valve`` and a command channel is looked at
    recordings : recordings (of arrays too), or their files; several, so that laws are chosen on another motion
    validate : another motion, to judge by
    bandwidth_hz : cut-off of the filter; 3 Hz, or a fifth of a slower rate
    loop : whether effects are looked for

    Raises
    ------
    InputError
        One line about the machine file or a recording.
    """
    described = machine if isinstance(machine, Machine) else Machine.load(machine)

    def read(files: Files) -> list[RecordingFile]:
        content = described.content
        return [
            own.of(content) if isinstance(own, Recording) else read_recording(own, content, "operation")
            for own in files
        ]

    found = identify_valves(described.content, read(recordings), read(validate), bandwidth_hz=bandwidth_hz, loop=loop)
    return ValveResult(found.report, found.models)
