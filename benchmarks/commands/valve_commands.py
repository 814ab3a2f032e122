"""``hilfit bench valve``: command to speed and back, on plants drawn at random."""

from __future__ import annotations

import json as json_text
from pathlib import Path
from typing import Annotated, Any

import typer

from benchmarks.commands.saying import benchmark
from benchmarks.one_thread import one_blas_thread
from benchmarks.targets import Outcome, Show, figure
from daq.errors import InputError


@benchmark
def valve(
    show: Show,
    cases: Annotated[int, typer.Option(help="Machines; each is healthy once and has one effect once.", min=1)] = 60,
    seed: Annotated[int, typer.Option(help="Seed of the run; a case is the same whatever else is run.")] = 0,
    cache: Annotated[Path | None, typer.Option(help="Keep simulated cases here, and take them from here.")] = None,
    only_make: Annotated[bool, typer.Option(help="Fill the cache and judge nothing.")] = False,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Results, a line each; a run goes on where it stopped.")
    ] = None,
    closed_loop: Annotated[int, typer.Option(help="Healthy machines that follow a path by their inverse.", min=0)] = 6,
    healthy: Annotated[bool, typer.Option("--healthy", help="Leave the cases with an effect out.")] = False,
    watch: Annotated[
        bool, typer.Option("--watch", help="Instead: the monitor on healthy machines, and after changes.")
    ] = False,
) -> Outcome:
    """Identify edges, delay, effects and inverse of valves on a bench, a crane and an excavator, at random."""
    one_blas_thread()
    if watch:
        return _watched(cases, seed, output, show)
    from tempfile import TemporaryDirectory

    import numpy as np

    from benchmarks.valve.closing import followed
    from benchmarks.valve.drawing import CLASSES, ValveKey, stored_cases
    from benchmarks.valve.judging import identified
    from benchmarks.valve.scoring import case_text, checks, scored

    if only_make and cache is None:
        raise InputError("--only-make: fills a cache; name it with --cache")
    keys = [ValveKey(n, made, seed) for n in range(cases) for made in CLASSES[: 1 if healthy else 2]]  # type: ignore[arg-type]
    with TemporaryDirectory() as temporary:
        folders = stored_cases(cache or Path(temporary), keys, show)
        if only_make:
            return Outcome((), (f"{len(folders)} cases in {cache}", ""), {})
        known: dict[str, dict[str, Any]] = {}
        if output is not None and output.is_file():
            known = {line["case"]: line for line in map(json_text.loads, output.read_text().splitlines())}
        lines = []
        for key, folder in zip(keys, folders, strict=True):
            line = known.get(key.text)
            if line is None:
                answer = identified(folder)
                line = scored(folder, answer)
                if key.made == "null" and key.number < closed_loop:
                    line["followed"] = followed(folder, key, answer)
                if output is not None:
                    with output.open("a", encoding="utf-8") as file:
                        file.write(json_text.dumps(line) + "\n")
            show(case_text(line))
            lines.append(line)
    result = checks(lines)
    shares = [own["preview"] / own["linear"] for line in lines if (own := line.get("followed"))]
    if shares:
        worst = f"{100 * float(np.median(shares)):.0f} % (worst {100 * max(shares):.0f} %)"
        result.append(figure("tracking error by inverse and preview over linear feedforward's, median",
                             100.0 * float(np.median(shares)), "{} %", most=25.0, shown=worst))  # fmt: skip
    result.append(
        figure("processor time of an identification, mean", float(np.mean([x["seconds"] for x in lines])), "{:.1f} s")
    )
    return Outcome(tuple(result), ("",), {"cases": lines})


def _watched(cases: int, seed: int, output: Path | None, show: Show) -> Outcome:
    from tempfile import TemporaryDirectory

    from benchmarks.valve.drawing import ValveKey
    from benchmarks.valve.watching import checks, watched

    found = list[dict[str, Any]]()
    for number in range(cases):
        with TemporaryDirectory() as temporary:
            found.append(watched(Path(temporary), ValveKey(number, "null", seed)))
        if output is not None:
            with output.open("a", encoding="utf-8") as file:
                file.write(json_text.dumps(found[-1]) + "\n")
        checks(found[-1:], show)
    return Outcome(tuple(checks(found, lambda line: None)), ("",), {"machines": found})
