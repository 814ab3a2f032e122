"""``hilfit bench faults``, ``soak`` and ``channels``: the commands of the benchmarks of acquisition."""

from __future__ import annotations

from typing import Annotated

import typer

from benchmarks.commands.saying import finish, shown


def faults(
    times: Annotated[int, typer.Option(help="That every fault comes.", min=1)] = 20,
    seed: Annotated[int, typer.Option(help="Of when the faults come and how long they last.")] = 0,
    only: Annotated[str | None, typer.Option(help="Part of a fault's name.")] = None,
    real_time: Annotated[
        bool, typer.Option("--real-time", help="At the wall's clock instead of in lockstep, on a quiet computer.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="Print the checks as JSON.")] = False,
) -> None:
    """Every fault at random moments: what is lost, what is wrong, how soon it is over."""
    from benchmarks.acquisition.bus_rows import names, run_rows
    from benchmarks.acquisition.faults import run, scripts
    from benchmarks.targets import Outcome
    from daq.errors import InputError

    ours, theirs = [name for name, _ in scripts()], names()
    if only is not None and not any(only in name for name in (*ours, *theirs)):
        raise InputError(f"--only {only}: is in no fault's name; there are {', '.join((*ours, *theirs))}")
    outcome = Outcome((), ())
    if only is None or any(only in name for name in ours):
        outcome = run(times, seed, only, real_time, shown(json))
    if only is None or any(only in name for name in theirs):
        bus = run_rows(times, seed, only, shown(json))
        outcome = Outcome((*outcome.checks, *bus.checks), (*outcome.notes, *bus.notes))
    finish("faults", outcome, json)


def channels(
    machines: Annotated[str, typer.Option(help="Numbers of machines at once, rising, with commas.")] = "1,4,8,12",
    seconds: Annotated[float, typer.Option(help="Length of each run.", min=2)] = 20.0,
    json: Annotated[bool, typer.Option("--json", help="Print the checks as JSON.")] = False,
) -> None:
    """How many machines of 40 channels at 50 Hz one computer carries, and what each costs."""
    from benchmarks.acquisition.channels import run
    from daq.errors import InputError

    numbers = [int(word) if word.isdigit() else 0 for word in machines.split(",")]
    if numbers != sorted(set(numbers)) or numbers[0] < 1:
        raise InputError(f"--machines {machines}: write rising numbers of at least 1 with commas, as in 1,4,8")
    finish("channels", run(numbers, seconds, shown(json)), json)


def soak(
    minutes: Annotated[float, typer.Option(help="How long.", min=0.5)] = 60.0,
    seed: Annotated[int, typer.Option(help="Of which fault comes when.")] = 0,
    json: Annotated[bool, typer.Option("--json", help="Print the checks as JSON.")] = False,
) -> None:
    """Hours of faults one after another: nothing lost, memory flat."""
    from benchmarks.acquisition.soak import run

    finish("soak", run(minutes, seed, shown(json)), json)
