"""``hilfit bench attribution`` and ``resolve``: the loop on random arms."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from benchmarks.cases import Line, append, one_blas_thread, refuse_existing
from benchmarks.commands.benchmark import Cache, OnlyMake, Results, Seed, benchmark, chosen
from benchmarks.targets import Outcome, Show
from daq.errors import InputError

if TYPE_CHECKING:
    from benchmarks.attribution.recipe import CaseKey
    from sim_backends.machines import ArmKind

#: Options of the benchmarks on random arms.
Replicas = Annotated[
    int | None, typer.Option(help="Most replicas of a null distribution, 0 for none; as 'identify' if absent.", min=0)
]
Length = Annotated[float, typer.Option(help="Length of each recording in s.", min=20.0)]


def _counts(text: str, kinds: Sequence[str]) -> dict[str, int]:
    counts: dict[str, int] = {}
    for part in text.split(","):
        kind, equals, number = part.strip().partition("=")
        if kind not in kinds or not equals or not number.isdigit():
            raise InputError(f"--cases {part.strip()}: write CLASS=COUNT with CLASS one of {', '.join(kinds)}")
        counts[kind] = int(number)
    return counts


def _arms(text: str | None) -> tuple[ArmKind, ...]:
    from sim_backends.machines import ARMS

    parts = dict.fromkeys(part.strip() for part in (text or "").split(",") if part.strip())
    for part in parts:
        chosen("--arms", part, list(ARMS), "is no kind of arm; with commas, of")
    return tuple(kind for part in parts for kind in ARMS if kind == part)


Cases = Annotated[
    str, typer.Option(help="How many of each class: null, large, medium, small, kinematic, outside, pairs.")
]
Apart = Annotated[
    bool, typer.Option(help="Also how far each case's data are from nothing and from other names of the catalogue.")
]
Arms = Annotated[
    str | None,
    typer.Option(
        "--arms", "--arm", help="Only these arms, in turn: folding, slewing, excavator, telescope, with commas."
    ),
]
Recipe = Annotated[
    int | None, typer.Option(help="Make the cases of an earlier recipe: 3 has folding and slewing arms only.")
]


@benchmark
def attribution(
    show: Show,
    cases: Cases = "null=100,large=60,medium=40,small=20,kinematic=30,outside=40,pairs=30",
    case: Annotated[str | None, typer.Option(help="One case alone, as CLASS:NUMBER.")] = None,
    seed: Seed = 0,
    workers: Annotated[int, typer.Option(help="Processes, each with one BLAS thread.", min=1)] = 1,
    output: Results = None,
    compare: Annotated[Path | None, typer.Option(help="Results of another run: which cases changed.")] = None,
    cache: Cache = None,
    only_make: OnlyMake = False,
    apart: Apart = False,
    only: Annotated[str | None, typer.Option(help="Only this effect.")] = None,
    arms: Arms = None,
    recipe: Recipe = None,
    seconds: Length = 60.0,
    bootstrap: Replicas = None,
    without: Annotated[
        str | None, typer.Option(help="Judge without recordings of this role: repeat, unloaded or validate.")
    ] = None,
    bands: Annotated[bool, typer.Option(help="Judge at .7 and 1.3 of the bandwidth, too.")] = False,
    diagram: Annotated[
        Path | None, typer.Option(help="Draw stated probabilities against what is right, as PNG.")
    ] = None,
) -> Outcome:
    """Count how often the loop is right on random arms, effects, joints and sizes."""
    one_blas_thread()
    from benchmarks.attribution import summary
    from benchmarks.attribution.recipe import KINDS, RECIPE, RECIPES, Selection
    from benchmarks.attribution.runs import Order, plan_of, read_lines, run
    from fitting.loop.session import Options
    from sim_backends.undeclared import UNDECLARED

    chosen("--only", only, sorted(UNDECLARED), "is no effect of the plant; one of")
    if recipe is not None and recipe not in RECIPES:
        raise InputError(f"--recipe {recipe}: is no recipe; one of {', '.join(map(str, RECIPES))}")
    if only_make and cache is None:
        raise InputError("--only-make: fills a cache; name it with --cache")
    if compare is not None and not compare.is_file():
        raise InputError(f"{compare}: no such file; give results of another run to --compare")
    keys = plan_of(_counts(cases, KINDS), seed) if case is None else [_key(case, seed)]
    selection = Selection(only, _arms(arms), seconds, recipe or RECIPE)
    if cache is not None:
        cache.mkdir(parents=True, exist_ok=True)
    replicas = Options.bootstrap if bootstrap is None else bootstrap
    chosen("--without", without, ("repeat", "unloaded", "validate"), "is no role that can be left out; one of")
    orders = [
        Order(key, selection, cache, only_make, apart, replicas, without, (1.0, 0.7, 1.3) if bands else (1.0,))
        for key in keys
    ]
    lines = run(orders, workers, output, lambda line: show(summary.case_text(line)))
    changes = [] if compare is None else ["", *summary.compared(read_lines(compare), lines)]
    if diagram is not None and any("said" in line for line in lines):
        summary.draw_reliability(lines, diagram)
    content = {
        "selection": selection.as_json(),
        "found_against_lambda": summary.found_against_size(lines),
        "cases": lines,
    }
    checks = () if only_make else tuple(summary.checks(lines))
    return Outcome(checks, (*summary.text(lines), *changes, ""), content)


@benchmark
def mismatch(
    show: Show,
    cases: Annotated[
        str, typer.Option(help="How many of each class: sound, one, two, outside.")
    ] = "one=40,two=20,outside=20,sound=60",
    seed: Seed = 0,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Results, a line each.")] = None,
) -> Outcome:
    """Count right names of what bends one of two position sensors: many cases, without the efforts' search."""
    one_blas_thread()
    from benchmarks.attribution.mismatch import CLASSES, case_text, checks, run

    refuse_existing(output)
    lines = []
    for line in run(_counts(cases, CLASSES), seed):
        lines.append(line)
        show(case_text(line))
        append(output, line)
    return Outcome(tuple(checks(lines)))


def _key(case: str, seed: int) -> CaseKey:
    """Parse ``CLASS:NUMBER`` as a case of a seed."""
    from benchmarks.attribution.recipe import KINDS, CaseKey

    kind, _, number = case.partition(":")
    if kind not in KINDS or not number.isdigit():
        raise InputError(f"--case {case}: write CLASS:NUMBER with CLASS one of {', '.join(KINDS)}")
    return CaseKey(kind, int(number), seed)


@benchmark
def resolve(
    show: Show,
    cases: Annotated[int, typer.Option(help="Ambiguous cases to find and close.", min=1)] = 20,
    seed: Annotated[int, typer.Option(help="Seed of the cases; those of 'attribution' with --only.")] = 0,
    most: Annotated[int | None, typer.Option(help="Cases to look at, at most; ten for each if absent.", min=1)] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Results, a line for each ambiguous case.")
    ] = None,
    seconds: Length = 60.0,
    bootstrap: Replicas = None,
) -> Outcome:
    """Resolve ambiguous cases: how many end in the single right name after designed motions."""
    one_blas_thread()
    from benchmarks.attribution import resolving
    from fitting.loop.session import Options

    refuse_existing(output)
    replicas = Options.bootstrap if bootstrap is None else bootstrap
    lines: list[Line] = []
    looked_at = 0
    for line in resolving.ambiguous(seed, seconds, replicas, most or 10 * cases):
        looked_at += 1
        if line is None:
            continue
        lines.append(line)
        append(output, line)
        show(resolving.text(line))
        if len(lines) >= cases:
            break
    return Outcome(tuple(resolving.checks(lines, looked_at)), content={"cases": lines})
