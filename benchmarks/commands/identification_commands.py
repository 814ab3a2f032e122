"""Benchmarks of identifications: samples, demonstration, stages, time and memory, measured machines, mistakes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from benchmarks.commands.saying import finish, shown
from daq.console import print_json
from daq.errors import InputError

ARMS: tuple[Literal["folding", "slewing"], ...] = ("folding", "slewing")
Length = Annotated[float, typer.Option(help="Length of each recording in s.", min=20.0)]


def samples(
    directory: Annotated[
        Path | None, typer.Argument(help="A folder for each case; ../shared/samples beside the repository if absent.")
    ] = None,
    only: Annotated[str | None, typer.Option(help="Only this case.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the checks as JSON.")] = False,
) -> None:
    """What the identification says of the sample recordings of an independent plant."""
    from benchmarks.samples import CASES, SAMPLES
    from benchmarks.samples import samples as run

    if only is not None and only not in CASES:
        raise InputError(f"--only {only}: is no sample; one of {', '.join(CASES)}")
    if directory is not None and not directory.is_dir():
        raise InputError(f"{directory}: no such directory; give one with a folder for each case")
    finish("samples", run(directory or SAMPLES, only, shown(json)), json)


def demo(
    seed: Annotated[int, typer.Option(help="Of the plant's noise and of the motions.")] = 1,
    seconds: Annotated[float, typer.Option(help="Length of each recording in machine time.", min=20.0)] = 40.0,
    json: Annotated[bool, typer.Option("--json", help="Print the checks as JSON.")] = False,
) -> None:
    """The demonstration: cycles, rate, effect found, error before and after."""
    from benchmarks.demonstration import demonstration

    finish("demo", demonstration(seed, seconds), json)


def stages(
    count: Annotated[int, typer.Option(help="Arms of each kind.", min=2)] = 15,
    seed: Annotated[int, typer.Option(help="Of the first arm.")] = 100,
    arm: Annotated[str | None, typer.Option(help="Only this arm: folding or slewing.")] = None,
    encoder_std: Annotated[
        float | None, typer.Option(help="Noise of both position sensors in rad and m instead of good ones'.", min=0.0)
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the checks as JSON.")] = False,
) -> None:
    """Two stages against one, and what the intervals of parameters are worth, on simulated arms."""
    from benchmarks.stages import stages as run

    if arm not in (None, "folding", "slewing"):
        raise InputError(f"--arm {arm}: write folding or slewing")
    arms = tuple(kind for kind in ARMS if arm in (None, kind))
    finish("stages", run(count, seed, arms, encoder_std, shown(json)), json)


def speed(
    minutes: Annotated[
        str, typer.Option(help="Lengths of the training recording in minutes, rising, with commas.")
    ] = "10,30,60",
    no_loop: Annotated[bool, typer.Option("--no-loop", help="Leave the run with the loop out.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print the checks as JSON.")] = False,
) -> None:
    """Time and memory of an identification, and how they grow with the recording."""
    from benchmarks.speed import speed as run

    finish("speed", run(_lengths(minutes), loop=not no_loop, show=shown(json)), json)


def _lengths(minutes: str) -> list[float]:
    try:
        lengths = [float(part) for part in minutes.split(",")]
    except ValueError:
        lengths = []
    if not lengths or lengths != sorted(set(lengths)) or lengths[0] < 1:
        raise InputError(f"--minutes {minutes}: write rising numbers of at least 1 with commas, as in 10,30,60")
    return lengths


def long(
    minutes: Annotated[
        str, typer.Option(help="Lengths of the training recording in minutes, rising, with commas (600: ten hours).")
    ] = "10,30,60",
    effect_minutes: Annotated[
        float, typer.Option(help="Length of the recording in which a payload comes; 0 leaves it out.", min=0)
    ] = 120.0,
    seed: Annotated[int, typer.Option(help="Of arm, motions and noise.")] = 3,
    json: Annotated[bool, typer.Option("--json", help="Print the checks as JSON.")] = False,
) -> None:
    """Hours of recordings with the loop: time, memory, and what it names."""
    from benchmarks.long import long as run

    finish("long", run(_lengths(minutes), effect_minutes, seed=seed, show=shown(json)), json)


def excitation(
    arm: Annotated[str | None, typer.Option(help="Only this arm: folding or slewing.")] = None,
    seed: Annotated[int, typer.Option(help="Of the arm and of the search.")] = 0,
    long_runs: Annotated[int, typer.Option(help="Long searches that make the yardstick.", min=1)] = 20,
    json: Annotated[bool, typer.Option("--json", help="Print the checks as JSON.")] = False,
) -> None:
    """Time of a motion design with every limit, and its condition number beside long searches."""
    from benchmarks.excitation import run
    from benchmarks.targets import Outcome

    if arm not in (None, "folding", "slewing"):
        raise InputError(f"--arm {arm}: write folding or slewing")
    arms = tuple(kind for kind in ARMS if arm in (None, kind))
    finish("excitation", Outcome(tuple(run(arms, (seed,), long_runs, shown(json)))), json)


def measured(
    data: Annotated[
        Path | None,
        typer.Option(help="Directory of the measured data; ../shared/data beside the repository if absent."),
    ] = None,
    page: Annotated[Path | None, typer.Option(help="Write the page with before and after here (Markdown).")] = None,
    only: Annotated[str | None, typer.Option(help="Only this machine.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the checks as JSON.")] = False,
) -> None:
    """Identification and loop on measured machines, beside published numbers."""
    from benchmarks.measured import DATA, MACHINES, run

    if only is not None and only not in MACHINES:
        raise InputError(f"--only {only}: is no measured machine; one of {', '.join(MACHINES)}")
    if data is not None and not data.is_dir():
        raise InputError(f"{data}: no such directory; give the one with the measured data to --data")
    finish("measured", run(data or DATA, page, only, shown(json)), json)


def mistakes(
    cases: Annotated[int, typer.Option(help="Machines that every mistake is made on.", min=1)] = 10,
    sound: Annotated[int, typer.Option(help="Machines without a mistake, half of them with an effect.", min=0)] = 200,
    seed: Annotated[int, typer.Option(help="Of the machines, motions and mistakes.")] = 0,
    only: Annotated[str | None, typer.Option(help="Part of a mistake's name.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print checks and cases as JSON.")] = False,
) -> None:
    """People's mistakes on random machines: what the checks call them, and whom they accuse."""
    from benchmarks.measured import DATA
    from benchmarks.mistakes import MISTAKES
    from benchmarks.mistakes.running import as_json, run
    from benchmarks.targets import missed

    if only is not None and not any(only in name for name in MISTAKES):
        raise InputError(f"--only {only}: is in no mistake's name; there are {', '.join(MISTAKES)}")
    outcome, lines = run(cases, sound, seed, only, shown(json), DATA)
    if json:
        checks = [check.as_json() for check in outcome.checks]
        print_json({"benchmark": "mistakes", "seed": seed, "checks": checks, "cases": as_json(lines)})
        if missed(outcome.checks):
            raise typer.Exit(1)
        return
    finish("mistakes", outcome, json)


def paper(
    count: Annotated[int, typer.Option(help="Simulated arms of each kind.", min=1)] = 4,
    seed: Annotated[int, typer.Option(help="Of the first arm.")] = 0,
    data: Annotated[
        Path | None,
        typer.Option(help="Directory of the measured data; ../shared/data beside the repository if absent."),
    ] = None,
    page: Annotated[Path | None, typer.Option(help="Write the page here (Markdown), figures beside it.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the checks as JSON.")] = False,
) -> None:
    """The claims that hilfit began with, made again in kind, each with its verdict."""
    from benchmarks.measured import DATA
    from benchmarks.paper import run

    if data is not None and not data.is_dir():
        raise InputError(f"{data}: no such directory; give the one with the measured data to --data")
    finish("paper", run(count, seed, data or DATA, page, shown(json)), json)
