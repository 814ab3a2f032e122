"""``hilfit bench``: every benchmark by name; targets beside what was measured, exit code 1 if one is missed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated

import typer

from benchmarks.commands.acquisition_commands import channels, faults, soak
from benchmarks.commands.export_commands import model, regressor, uses
from benchmarks.commands.identification_commands import (
    demo,
    excitation,
    long,
    measured,
    mistakes,
    paper,
    samples,
    speed,
    stages,
)
from benchmarks.commands.loop_commands import attribution, mismatch, resolve
from benchmarks.commands.service_commands import fleet, page, service, storm, throughput
from daq.console import print_json, reported

#: Name and what it shows; in the order of the list.
BENCHMARKS = {
    "attribution": "How often the loop is right on random arms, effects, joints and sizes.",
    "mismatch": "How often what bends one of two position sensors is named right; hundreds of cases.",
    "resolve": "Ambiguous cases: how many end in the single right name after at most two designed motions.",
    "samples": "What the identification says of the sample recordings of an independent plant.",
    "demo": "The demonstration: cycles, rate, effect found, error before and after.",
    "stages": "Two stages against one, and what the intervals of parameters are worth, on simulated arms.",
    "speed": "Time and memory of an identification, and how they grow with the recording.",
    "long": "Hours of recordings with the loop: time, memory, and what it names.",
    "regressor": "Time of the regressor beside a Pinocchio loop.",
    "excitation": "Time of a motion design with every limit, and its condition number beside long searches.",
    "measured": "Identification and loop on measured machines, beside published numbers.",
    "mistakes": "People's mistakes on random machines: what the checks call them, and whom they accuse.",
    "model": "Exports against the model, C beside Pinocchio, and what the 95 % band is worth.",
    "uses": "Feedforward, simulation, overload, payload and energy, with closed loops on the simulated machine.",
    "service": "Tablets, readers and uploads at the service while numerical work runs: latency, cycles lost.",
    "faults": "Every fault at random moments: what is lost, what is wrong, how soon it is over.",
    "soak": "Hours of faults one after another: nothing lost, memory flat.",
    "channels": "How many machines of 40 channels at 50 Hz one computer carries, and what each costs.",
    "paper": "The claims that hilfit began with, made again in kind: 78 to 18, cylinders, errors, two stages or one.",
    "page": "The page on a slow tablet: first view, frames dropped at 50 Hz; pictures of every view (--pictures).",
    "throughput": "Identifications per hour with several workers on PostgreSQL, and how well they share the work.",
    "storm": "kill -9 of servers, workers, stages and acquisitions: nothing lost, nothing twice.",
    "fleet": "Workers on other hosts that share only database and storage: cut off, killed, and what they cost.",
}


def register(app: typer.Typer) -> None:
    """Add the commands."""
    bench = typer.Typer(help="Benchmarks with targets; exit code 1 if a target is missed.", invoke_without_command=True)
    bench.callback()(_list)
    commands: tuple[Callable[..., None], ...] = (
        attribution, mismatch, resolve, samples, demo, stages, speed, long, regressor, excitation, measured, mistakes,
        model, uses, service, faults, soak, channels, paper, page, throughput, storm, fleet,
    )  # fmt: skip
    for name, command in zip(BENCHMARKS, commands, strict=True):
        bench.command(name, help=BENCHMARKS[name])(reported(command))
    app.add_typer(bench, name="bench")


def _list(
    context: typer.Context, json: Annotated[bool, typer.Option("--json", help="Print the list as JSON.")] = False
) -> None:
    """Benchmarks with targets; without a name they are listed."""
    if context.invoked_subcommand is not None:
        return
    if json:
        print_json([{"name": name, "shows": text} for name, text in BENCHMARKS.items()])
        return
    for name, text in BENCHMARKS.items():
        print(f"{name:14s} {text}")
