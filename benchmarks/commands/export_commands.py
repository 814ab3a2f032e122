"""``hilfit bench model``, ``uses`` and ``regressor``: the model outside its report."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from benchmarks.commands.saying import benchmark
from benchmarks.targets import Outcome, Show


@benchmark
def regressor(
    machine: Annotated[Path | None, typer.Argument(help="Machine file; two arms of six joints if absent.")] = None,
    samples: Annotated[int, typer.Option(help="States at which the regressor is computed.", min=1)] = 10_000,
    repeats: Annotated[int, typer.Option(help="Times that each is timed; the shortest counts.", min=1)] = 15,
) -> Outcome:
    """Time the regressor beside a Pinocchio loop."""
    from benchmarks.exports.regressor import regressor as run
    from daq.machine.machine_file import load_machine

    return run(samples, repeats, None if machine is None else load_machine(machine))


@benchmark
def model(
    show: Show,
    samples: Annotated[Path | None, typer.Option(help="Directory of the sample cases.")] = None,
    data: Annotated[Path | None, typer.Option(help="Directory of the measured data.")] = None,
) -> Outcome:
    """Check exports against the model, C beside Pinocchio, and the coverage of the 95 % band."""
    from benchmarks.exports.model import run
    from benchmarks.measured import DATA
    from benchmarks.samples import SAMPLES

    return run(samples or SAMPLES, data or DATA, show)


@benchmark
def uses(
    show: Show,
    seed: Annotated[int, typer.Option(help="Seed of the run.")] = 1,
    hours: Annotated[
        float, typer.Option(help="Hours of motion and rest in turn that false alarms are counted in.", min=0.02)
    ] = 24.0,
) -> Outcome:
    """Test feedforward, simulation, overload, payload and energy, closed loops on the simulated machine."""
    from benchmarks.exports.uses import run

    return run(seed, hours, show)
