"""``hilfit bench faults``, ``soak`` and ``channels``: the commands of the benchmarks of acquisition."""

from __future__ import annotations

from typing import Annotated

import typer

from benchmarks.commands.saying import benchmark, known, rising
from benchmarks.targets import Outcome, Show


@benchmark
def faults(
    show: Show,
    times: Annotated[int, typer.Option(help="That every fault comes.", min=1)] = 20,
    seed: Annotated[int, typer.Option(help="Of when the faults come and how long they last.")] = 0,
    only: Annotated[str | None, typer.Option(help="Part of a fault's name.")] = None,
    real_time: Annotated[
        bool, typer.Option("--real-time", help="At the wall's clock instead of in lockstep, on a quiet computer.")
    ] = False,
) -> Outcome:
    """Cause every fault at random moments: what is lost, what is wrong, how soon it is over."""
    from benchmarks.acquisition.bus_rows import names, run_rows
    from benchmarks.acquisition.faults import run, scripts

    ours, theirs = [name for name, _ in scripts()], names()
    known("--only", only, (*ours, *theirs), "is in no fault's name; there are")
    outcome = Outcome(())
    if only is None or any(only in name for name in ours):
        outcome = run(times, seed, only, real_time, show)
    if only is None or any(only in name for name in theirs):
        bus = run_rows(times, seed, only, show)
        outcome = Outcome((*outcome.checks, *bus.checks), (*outcome.notes, *bus.notes))
    return outcome


@benchmark
def channels(
    show: Show,
    machines: Annotated[str, typer.Option(help="Numbers of machines at once, rising, with commas.")] = "1,4,8,12",
    seconds: Annotated[float, typer.Option(help="Length of each run.", min=2)] = 20.0,
) -> Outcome:
    """Count the machines of 40 channels at 50 Hz that one computer carries, and what each costs."""
    from benchmarks.acquisition.channels import run

    return run([int(number) for number in rising("--machines", machines, "1,4,8")], seconds, show)


@benchmark
def soak(
    show: Show,
    minutes: Annotated[float, typer.Option(help="How long.", min=0.5)] = 60.0,
    seed: Annotated[int, typer.Option(help="Of which fault comes when.")] = 0,
) -> Outcome:
    """Cause hours of faults one after another: nothing lost, memory flat."""
    from benchmarks.acquisition.soak import run

    return run(minutes, seed, show)
