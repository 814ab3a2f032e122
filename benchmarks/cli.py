"""``hilfit bench``: every benchmark by name; targets beside what was measured, exit code 1 if one is missed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from benchmarks.one_thread import one_blas_thread
from daq.console import print_json, reported
from daq.errors import InputError

if TYPE_CHECKING:
    from benchmarks.targets import Outcome
    from sim_backends.machines import ArmKind

ARMS: tuple[Literal["folding", "slewing"], ...] = ("folding", "slewing")
DATABASES: tuple[Literal["sqlite", "postgresql"], ...] = ("sqlite", "postgresql")
#: Options of the benchmarks on random arms.
Replicas = Annotated[
    int | None, typer.Option(help="Most replicas of a null distribution, 0 for none; as 'identify' if absent.", min=0)
]
Length = Annotated[float, typer.Option(help="Length of each recording in s.", min=20.0)]
#: Name and what it shows; in the order of the list.
BENCHMARKS = {
    "attribution": "How often the loop is right on random arms, effects, joints and sizes.",
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
}


def register(app: typer.Typer) -> None:
    """Add the commands."""
    from benchmarks.acquisition.acquisition_commands import channels, faults, soak

    bench = typer.Typer(help="Benchmarks with targets; exit code 1 if a target is missed.", invoke_without_command=True)
    bench.callback()(_list)
    commands: tuple[Callable[..., None], ...] = (
        attribution, resolve, samples, demo, stages, speed, long, regressor, excitation, measured, mistakes, model,
        uses, service, faults, soak, channels, paper, page, throughput, storm,
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


def _counts(text: str) -> dict[str, int]:
    from benchmarks.attribution.recipe import KINDS

    counts: dict[str, int] = {}
    for part in text.split(","):
        kind, equals, number = part.strip().partition("=")
        if kind not in KINDS or not equals or not number.isdigit():
            raise InputError(f"--cases {part.strip()}: write CLASS=COUNT with CLASS one of {', '.join(KINDS)}")
        counts[kind] = int(number)
    return counts


def _arms(text: str | None) -> tuple[ArmKind, ...]:
    from sim_backends.machines import ARMS as ALL

    chosen = [part.strip() for part in (text or "").split(",") if part.strip()]
    for part in chosen:
        if part not in ALL:
            raise InputError(f"--arms {part}: is no kind of arm; one of {', '.join(ALL)}, with commas")
    return tuple(kind for part in dict.fromkeys(chosen) for kind in ALL if kind == part)


def attribution(
    cases: Annotated[
        str, typer.Option(help="How many of each class: null, large, medium, small, kinematic, outside, pairs.")
    ] = "null=100,large=60,medium=40,small=20,kinematic=30,outside=40,pairs=30",
    case: Annotated[str | None, typer.Option(help="One case alone, as CLASS:NUMBER.")] = None,
    seed: Annotated[int, typer.Option(help="Seed of the run; a case is the same whatever else is run.")] = 0,
    workers: Annotated[int, typer.Option(help="Processes, each with one BLAS thread.", min=1)] = 1,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Results, a line each; a run goes on where it stopped.")
    ] = None,
    compare: Annotated[Path | None, typer.Option(help="Results of another run: which cases changed.")] = None,
    cache: Annotated[Path | None, typer.Option(help="Keep simulated cases here, and take them from here.")] = None,
    only_make: Annotated[bool, typer.Option(help="Fill the cache and judge nothing.")] = False,
    apart: Annotated[
        bool, typer.Option(help="Also how far each case's data are from nothing and from other names of the catalogue.")
    ] = False,
    only: Annotated[str | None, typer.Option(help="Only this effect.")] = None,
    arms: Annotated[
        str | None,
        typer.Option(
            "--arms", "--arm", help="Only these arms, in turn: folding, slewing, excavator, telescope, with commas."
        ),
    ] = None,
    recipe: Annotated[
        int | None, typer.Option(help="Make the cases of an earlier recipe: 3 has folding and slewing arms only.")
    ] = None,
    seconds: Length = 60.0,
    bootstrap: Replicas = None,
    json: Annotated[bool, typer.Option("--json", help="Print checks and results as JSON.")] = False,
) -> None:
    """How often the loop is right on random arms, effects, joints and sizes."""
    one_blas_thread()
    from benchmarks.attribution import summary
    from benchmarks.attribution.recipe import KINDS, RECIPE, RECIPES, CaseKey, Selection
    from benchmarks.attribution.runs import Order, plan_of, read_lines, run
    from benchmarks.targets import lines_of, missed
    from fitting.loop.session import Options
    from sim_backends.undeclared import UNDECLARED

    if only is not None and only not in UNDECLARED:
        raise InputError(f"--only {only}: is no effect of the plant; one of {', '.join(sorted(UNDECLARED))}")
    if recipe is not None and recipe not in RECIPES:
        raise InputError(f"--recipe {recipe}: is no recipe; one of {', '.join(map(str, RECIPES))}")
    if only_make and cache is None:
        raise InputError("--only-make: fills a cache; name it with --cache")
    if compare is not None and not compare.is_file():
        raise InputError(f"{compare}: no such file; give results of another run to --compare")
    if case is not None:
        kind, _, number = case.partition(":")
        if kind not in KINDS or not number.isdigit():
            raise InputError(f"--case {case}: write CLASS:NUMBER with CLASS one of {', '.join(KINDS)}")
        keys = [CaseKey(kind, int(number), seed)]
    else:
        keys = plan_of(_counts(cases), seed)
    selection = Selection(only, _arms(arms), seconds, recipe or RECIPE)
    if cache is not None:
        cache.mkdir(parents=True, exist_ok=True)
    replicas = Options.bootstrap if bootstrap is None else bootstrap
    orders = [Order(key, selection, cache, only_make, apart, replicas) for key in keys]

    def show(line: dict[str, Any]) -> None:
        if not json:
            print(summary.case_text(line), flush=True)

    lines = run(orders, workers, output, show)
    checks = [] if only_make else summary.checks(lines)
    if json:
        content = {
            "benchmark": "attribution",
            "selection": selection.as_json(),
            "checks": [check.as_json() for check in checks],
            "found_against_lambda": summary.found_against_size(lines),
            "cases": lines,
        }
        print_json(content)
    else:
        print("\n".join([*summary.text(lines), "", *lines_of(checks)]))
        if compare is not None:
            print("\n".join(["", *summary.compared(read_lines(compare), lines)]))
    if missed(checks):
        raise typer.Exit(1)


def resolve(
    cases: Annotated[int, typer.Option(help="Ambiguous cases to find and close.", min=1)] = 20,
    seed: Annotated[int, typer.Option(help="Seed of the cases; those of 'attribution' with --only.")] = 0,
    most: Annotated[int | None, typer.Option(help="Cases to look at, at most; ten for each if absent.", min=1)] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Results, a line for each ambiguous case.")
    ] = None,
    seconds: Length = 60.0,
    bootstrap: Replicas = None,
    json: Annotated[bool, typer.Option("--json", help="Print checks and results as JSON.")] = False,
) -> None:
    """Ambiguous cases of effects that resemble others, closed by motions that the plant makes."""
    one_blas_thread()
    from benchmarks.attribution import resolving
    from benchmarks.targets import lines_of, missed
    from fitting.loop.session import Options

    if output is not None and output.exists():
        raise InputError(f"{output}: is there already; give another file to -o")
    replicas = Options.bootstrap if bootstrap is None else bootstrap
    lines: list[dict[str, Any]] = []
    looked_at = 0
    for line in resolving.ambiguous(seed, seconds, replicas, most or 10 * cases):
        looked_at += 1
        if line is None:
            continue
        lines.append(line)
        if output is not None:
            resolving.append(output, line)
        if not json:
            print(resolving.text(line), flush=True)
        if len(lines) >= cases:
            break
    checks = resolving.checks(lines, looked_at)
    if json:
        print_json({"benchmark": "resolve", "checks": [check.as_json() for check in checks], "cases": lines})
    else:
        print("\n".join(lines_of(checks)))
    if missed(checks):
        raise typer.Exit(1)


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
    _finish("samples", run(directory or SAMPLES, only, _shown(json)), json)


def demo(
    seed: Annotated[int, typer.Option(help="Of the plant's noise and of the motions.")] = 1,
    seconds: Annotated[float, typer.Option(help="Length of each recording in machine time.", min=20.0)] = 40.0,
    json: Annotated[bool, typer.Option("--json", help="Print the checks as JSON.")] = False,
) -> None:
    """The demonstration: cycles, rate, effect found, error before and after."""
    from benchmarks.demonstration import demonstration

    _finish("demo", demonstration(seed, seconds), json)


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
    _finish("stages", run(count, seed, arms, encoder_std, _shown(json)), json)


def speed(
    minutes: Annotated[
        str, typer.Option(help="Lengths of the training recording in minutes, rising, with commas.")
    ] = "10,30,60",
    no_loop: Annotated[bool, typer.Option("--no-loop", help="Leave the run with the loop out.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print the checks as JSON.")] = False,
) -> None:
    """Time and memory of an identification, and how they grow with the recording."""
    from benchmarks.speed import speed as run

    _finish("speed", run(_lengths(minutes), loop=not no_loop, show=_shown(json)), json)


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

    _finish("long", run(_lengths(minutes), effect_minutes, seed=seed, show=_shown(json)), json)


def regressor(
    machine: Annotated[Path | None, typer.Argument(help="Machine file; two arms of six joints if absent.")] = None,
    samples: Annotated[int, typer.Option(help="States at which the regressor is computed.", min=1)] = 10_000,
    repeats: Annotated[int, typer.Option(help="Times that each is timed; the shortest counts.", min=1)] = 15,
    json: Annotated[bool, typer.Option("--json", help="Print the checks as JSON.")] = False,
) -> None:
    """Time of the regressor beside a Pinocchio loop."""
    from benchmarks.exports.regressor import regressor as run
    from daq.machine.machine_file import load_machine

    _finish("regressor", run(samples, repeats, None if machine is None else load_machine(machine)), json)


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
    _finish("excitation", Outcome(tuple(run(arms, (seed,), long_runs, _shown(json)))), json)


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
    _finish("measured", run(data or DATA, page, only, _shown(json)), json)


def model(
    samples: Annotated[Path | None, typer.Option(help="Directory of the sample cases.")] = None,
    data: Annotated[Path | None, typer.Option(help="Directory of the measured data.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the checks as JSON.")] = False,
) -> None:
    """Exports against the model, C beside Pinocchio, and what the 95 % band is worth."""
    from benchmarks.exports.model import run
    from benchmarks.measured import DATA
    from benchmarks.samples import SAMPLES

    _finish("model", run(samples or SAMPLES, data or DATA, _shown(json)), json)


def uses(
    seed: Annotated[int, typer.Option(help="Seed of the run.")] = 1,
    minutes: Annotated[float, typer.Option(help="Minutes of motion that false alarms are counted in.", min=1)] = 60.0,
    json: Annotated[bool, typer.Option("--json", help="Print the checks as JSON.")] = False,
) -> None:
    """Feedforward, simulation, overload, payload and energy, with closed loops on the simulated machine."""
    from benchmarks.exports.uses import run

    _finish("uses", run(seed, minutes, _shown(json)), json)


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
    _finish("paper", run(count, seed, data or DATA, page, _shown(json)), json)


def mistakes(
    cases: Annotated[int, typer.Option(help="Machines that every mistake is made on.", min=1)] = 10,
    sound: Annotated[int, typer.Option(help="Machines without a mistake, half of them with an effect.", min=0)] = 200,
    seed: Annotated[int, typer.Option(help="Of the machines, motions and mistakes.")] = 0,
    only: Annotated[str | None, typer.Option(help="Part of a mistake's name.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print checks and cases as JSON.")] = False,
) -> None:
    """People's mistakes on random machines: what the checks call them, and whom they accuse."""
    from benchmarks.mistakes import MISTAKES
    from benchmarks.mistakes.running import as_json, run
    from benchmarks.targets import missed

    if only is not None and not any(only in name for name in MISTAKES):
        raise InputError(f"--only {only}: is in no mistake's name; there are {', '.join(MISTAKES)}")
    outcome, lines = run(cases, sound, seed, only, _shown(json))
    if json:
        checks = [check.as_json() for check in outcome.checks]
        print_json({"benchmark": "mistakes", "seed": seed, "checks": checks, "cases": as_json(lines)})
        if missed(outcome.checks):
            raise typer.Exit(1)
        return
    _finish("mistakes", outcome, json)


def service(
    tablets: Annotated[int, typer.Option(help="Clients of the live stream.", min=1, max=200)] = 20,
    rate: Annotated[float, typer.Option(help="Requests per second.", min=1, max=2000)] = 200.0,
    uploads: Annotated[int, typer.Option(help="Clients that upload recordings all the time.", min=0, max=100)] = 10,
    seconds: Annotated[float, typer.Option(help="Seconds of load.", min=2, max=60)] = 30.0,
    json: Annotated[bool, typer.Option("--json", help="Print the checks as JSON.")] = False,
) -> None:
    """Tablets, readers and uploads at the service while numerical work runs: latency, cycles lost."""
    from benchmarks.service.service import run

    _finish("service", run(tablets, rate, uploads, seconds, _shown(json)), json)


def page(
    cpu: Annotated[float, typer.Option(help="How many times slower than this computer the tablet is.", min=1)] = 4.0,
    megabits: Annotated[float, typer.Option(help="Its network, Mbit/s.", min=0.1)] = 10.0,
    times: Annotated[int, typer.Option(help="First views, each with an empty cache.", min=1)] = 5,
    seconds: Annotated[float, typer.Option(help="Seconds of looking at the live view.", min=1)] = 30.0,
    pictures: Annotated[
        Path | None, typer.Option(help="Make pictures of every view in this directory instead.", file_okay=False)
    ] = None,
    only: Annotated[str | None, typer.Option(help="With --pictures: only this view.")] = None,
    language: Annotated[str, typer.Option(help="With --pictures: en or de.")] = "en",
    json: Annotated[bool, typer.Option("--json", help="Print the checks as JSON.")] = False,
) -> None:
    """The page on a slow tablet: first view, frames dropped at 50 Hz; pictures of every view (--pictures)."""
    from benchmarks.page import measuring
    from benchmarks.page.browser import Tablet
    from benchmarks.page.pictures import PRESSED, VIEWS
    from benchmarks.page.pictures import run as make_pictures

    if only is not None and only not in VIEWS:
        raise InputError(f"--only {only}: is no view; one of {', '.join(VIEWS)}")
    if language not in PRESSED:
        raise InputError(f"--language {language}: must be one of {', '.join(PRESSED)}")
    if pictures is not None:
        _finish("page", make_pictures(pictures, only, _shown(json), language), json)
        return
    _finish("page", measuring.run(Tablet(cpu, megabits), times, seconds, _shown(json)), json)


def storm(
    seconds: Annotated[float, typer.Option(help="Seconds of killing.", min=2, max=600)] = 60.0,
    database: Annotated[str, typer.Option(help="sqlite, or postgresql (started from Debian's packages).")] = "sqlite",
    seed: Annotated[int, typer.Option(help="Of what is killed when.")] = 0,
    kills_only: Annotated[bool, typer.Option(help="No full disk, no read-only store, no jumps of the clock.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print the checks as JSON.")] = False,
) -> None:
    """kill -9 of servers, workers, stages and acquisitions: nothing lost, nothing twice."""
    from benchmarks.storm.run import run

    kind = next((known for known in DATABASES if known == database), None)
    if kind is None:
        raise InputError(f"--database {database}: write {' or '.join(DATABASES)}")
    kills = round(seconds * 100 / 60)
    outcome = run(seconds, kind, seed, _shown(json), kills=kills, longest=10 * seconds, faults=not kills_only)
    _finish("storm", outcome, json)


def throughput(
    workers: Annotated[
        str, typer.Option(help="Numbers of processes that work, the server among them, with commas.")
    ] = "1,2,4",
    jobs: Annotated[int, typer.Option(help="Identifications per worker.", min=1, max=50)] = 4,
    json: Annotated[bool, typer.Option("--json", help="Print the checks as JSON.")] = False,
) -> None:
    """Identifications per hour with several workers on PostgreSQL, and how well they share the work."""
    from benchmarks.service.throughput import run

    counts = [int(part) for part in workers.split(",") if part.strip().isdigit()]
    if not counts or min(counts) < 1 or len(counts) != len(workers.split(",")):
        raise InputError(f"--workers {workers}: write numbers from 1 on, as in 1,2,4")
    _finish("throughput", run(counts, jobs, _shown(json)), json)


def _shown(json: bool) -> Callable[[str], None]:
    return (lambda line: None) if json else (lambda line: print(line, flush=True))


def _finish(name: str, outcome: Outcome, json: bool) -> None:
    """Print checks beside their targets; exit code 1 if one is missed."""
    from benchmarks.targets import lines_of, missed

    if json:
        print_json({"benchmark": name, "checks": [check.as_json() for check in outcome.checks]})
    else:
        print("\n".join([*outcome.notes, *lines_of(outcome.checks)]) or "nothing to check")
    if missed(outcome.checks):
        raise typer.Exit(1)
