"""``hilfit bench model``, ``uses`` and ``regressor``: the model outside its report."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from benchmarks.commands.saying import finish, shown


def regressor(
    machine: Annotated[Path | None, typer.Argument(help="Machine file; two arms of six joints if absent.")] = None,
    samples: Annotated[int, typer.Option(help="States at which the regressor is computed.", min=1)] = 10_000,
    repeats: Annotated[int, typer.Option(help="Times that each is timed; the shortest counts.", min=1)] = 15,
    json: Annotated[bool, typer.Option("--json", help="Print the checks as JSON.")] = False,
) -> None:
    """Time of the regressor beside a Pinocchio loop."""
    from benchmarks.exports.regressor import regressor as run
    from daq.machine.machine_file import load_machine

    finish("regressor", run(samples, repeats, None if machine is None else load_machine(machine)), json)


def model(
    samples: Annotated[Path | None, typer.Option(help="Directory of the sample cases.")] = None,
    data: Annotated[Path | None, typer.Option(help="Directory of the measured data.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the checks as JSON.")] = False,
) -> None:
    """Exports against the model, C beside Pinocchio, and what the 95 % band is worth."""
    from benchmarks.exports.model import run
    from benchmarks.measured import DATA
    from benchmarks.samples import SAMPLES

    finish("model", run(samples or SAMPLES, data or DATA, shown(json)), json)


def uses(
    seed: Annotated[int, typer.Option(help="Seed of the run.")] = 1,
    minutes: Annotated[
        float, typer.Option(help="Minutes of motion and rest in turn that false alarms are counted in.", min=1)
    ] = 60.0,
    json: Annotated[bool, typer.Option("--json", help="Print the checks as JSON.")] = False,
) -> None:
    """Feedforward, simulation, overload, payload and energy, with closed loops on the simulated machine."""
    from benchmarks.exports.uses import run

    finish("uses", run(seed, minutes, shown(json)), json)
