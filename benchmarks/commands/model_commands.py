"""Benchmarks of identifications and of models: samples, times, measured machines, mistakes, valves, exports."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from benchmarks.cases import one_blas_thread
from benchmarks.commands.benchmark import Cache, OnlyMake, Results, Seed, benchmark, chosen, rising
from benchmarks.commands.benchmark import directory as existing
from benchmarks.targets import ARMS, Arm, Outcome, Show

_DATA = "the one with the measured data to --data"
OneArm = Annotated[str | None, typer.Option(help="Only this arm: folding or slewing.")]
Data = Annotated[
    Path | None, typer.Option(help="Directory of the measured data; ../shared/data beside the repository if absent.")
]


@benchmark
def samples(
    show: Show,
    directory: Annotated[
        Path | None, typer.Argument(help="A folder for each case; ../shared/samples beside the repository if absent.")
    ] = None,
    only: Annotated[str | None, typer.Option(help="Only this case.")] = None,
) -> Outcome:
    """Identify the sample recordings of an independent plant."""
    from benchmarks.samples import CASES, SAMPLES
    from benchmarks.samples import samples as run

    chosen("--only", only, CASES, "is no sample; one of")
    return run(existing(directory, SAMPLES, "one with a folder for each case"), only, show)


@benchmark
def demo(
    seed: Annotated[int, typer.Option(help="Of the plant's noise and of the motions.")] = 1,
    seconds: Annotated[float, typer.Option(help="Length of each recording in machine time.", min=20.0)] = 40.0,
) -> Outcome:
    """Check the demonstration: cycles, rate, effect found, error before and after."""
    from benchmarks.demonstration import demonstration

    return demonstration(seed, seconds)


@benchmark
def stages(
    show: Show,
    count: Annotated[int, typer.Option(help="Arms of each kind.", min=2)] = 15,
    seed: Annotated[int, typer.Option(help="Of the first arm.")] = 100,
    arm: OneArm = None,
    encoder_std: Annotated[
        float | None, typer.Option(help="Noise of both position sensors in rad and m instead of good ones'.", min=0.0)
    ] = None,
) -> Outcome:
    """Compare two stages with one, and intervals of parameters with the truth, on simulated arms."""
    from benchmarks.stages import stages as run

    return run(count, seed, _arms(arm), encoder_std, show)


@benchmark
def speed(
    show: Show,
    minutes: Annotated[
        str, typer.Option(help="Lengths of the training recording in minutes, rising, with commas.")
    ] = "10,30,60",
    no_loop: Annotated[bool, typer.Option("--no-loop", help="Leave the run with the loop out.")] = False,
    valves: Annotated[bool, typer.Option("--valves", help="Time that of a crane's valves, and nothing else.")] = False,
) -> Outcome:
    """Measure time and memory of an identification, and how they grow with the recording."""
    if valves:
        one_blas_thread()
        from benchmarks.valve.runs import timed

        return timed(0)
    from benchmarks.speed import speed as run

    return run(rising("--minutes", minutes, "10,30,60"), loop=not no_loop, show=show)


def _arms(arm: str | None) -> tuple[Arm, ...]:
    chosen("--arm", arm, ARMS, "write one of")
    return tuple(kind for kind in ARMS if arm in (None, kind))


@benchmark
def long(
    show: Show,
    minutes: Annotated[
        str, typer.Option(help="Lengths of the training recording in minutes, rising, with commas (600: ten hours).")
    ] = "10,30,60",
    effect_minutes: Annotated[
        float, typer.Option(help="Length of the recording in which a payload comes; 0 leaves it out.", min=0)
    ] = 120.0,
    seed: Annotated[int, typer.Option(help="Of arm, motions and noise.")] = 3,
) -> Outcome:
    """Identify hours of recordings with the loop: time, memory, and what it names."""
    from benchmarks.speed import long as run

    return run(rising("--minutes", minutes, "10,30,60"), effect_minutes, seed=seed, show=show)


@benchmark
def excitation(
    show: Show,
    arm: OneArm = None,
    seed: Annotated[int, typer.Option(help="Of the arm and of the search.")] = 0,
    long_runs: Annotated[int, typer.Option(help="Long searches that make the yardstick.", min=1)] = 20,
) -> Outcome:
    """Time a motion design with every limit; compare its condition number with long searches."""
    from benchmarks.excitation import run

    return run(_arms(arm), seed, long_runs, show)


@benchmark
def measured(
    show: Show,
    data: Data = None,
    page: Annotated[Path | None, typer.Option(help="Write the page with before and after here (Markdown).")] = None,
    only: Annotated[str | None, typer.Option(help="Only this machine.")] = None,
) -> Outcome:
    """Run identification and loop on measured machines, beside published numbers."""
    from benchmarks.measured import DATA, MACHINES, run

    chosen("--only", only, MACHINES, "is no measured machine; one of")
    return run(existing(data, DATA, _DATA), page, only, show)


@benchmark
def mistakes(
    show: Show,
    cases: Annotated[int, typer.Option(help="Machines that every mistake is made on.", min=1)] = 10,
    sound: Annotated[int, typer.Option(help="Machines without a mistake, half of them with an effect.", min=0)] = 200,
    seed: Annotated[int, typer.Option(help="Of the machines, motions and mistakes.")] = 0,
    only: Annotated[str | None, typer.Option(help="Part of a mistake's name.")] = None,
) -> Outcome:
    """Make people's mistakes on random machines: what the checks call them, and whom they accuse."""
    from benchmarks.measured import DATA
    from benchmarks.mistakes import MISTAKES
    from benchmarks.mistakes.running import run

    chosen("--only", only, list(MISTAKES), "is in no mistake's name; there are", part=True)
    return run(cases, sound, seed, only, show, DATA)


@benchmark
def paper(
    show: Show,
    count: Annotated[int, typer.Option(help="Simulated arms of each kind.", min=1)] = 4,
    seed: Annotated[int, typer.Option(help="Of the first arm.")] = 0,
    data: Data = None,
    page: Annotated[Path | None, typer.Option(help="Write the page here (Markdown), figures beside it.")] = None,
) -> Outcome:
    """Make the claims that hilfit began with again in kind: 78 to 18, cylinders, errors, two stages or one."""
    from benchmarks.measured import DATA
    from benchmarks.paper import run

    return run(count, seed, existing(data, DATA, _DATA), page, show)


@benchmark
def valve(
    show: Show,
    cases: Annotated[int, typer.Option(help="Machines; each is healthy once and has one effect once.", min=1)] = 60,
    seed: Seed = 0,
    cache: Cache = None,
    only_make: OnlyMake = False,
    output: Results = None,
    closed_loop: Annotated[int, typer.Option(help="Healthy machines that follow a path by their inverse.", min=0)] = 6,
    healthy: Annotated[bool, typer.Option("--healthy", help="Leave the cases with an effect out.")] = False,
    watch: Annotated[
        bool, typer.Option("--watch", help="Instead: the monitor on healthy machines, and after changes.")
    ] = False,
) -> Outcome:
    """Identify edges, delay, effects and inverse of valves on a bench, a crane and an excavator, at random."""
    one_blas_thread()
    if watch:
        from benchmarks.valve.watching import run as run_watched

        return run_watched(cases, seed, output, show)
    from benchmarks.valve.runs import run

    return run(cases, seed, cache, only_make, output, closed_loop, healthy, show)


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
