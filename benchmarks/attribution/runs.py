"""One case from its key to a line of results, and all cases of a run."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from benchmarks import cases
from benchmarks.attribution.apart import stored_apart
from benchmarks.attribution.judging import judge, recordings_of
from benchmarks.attribution.making import make_case, stored_case
from benchmarks.attribution.recipe import KINDS, CaseKey, Selection
from benchmarks.attribution.verdicts import true_values, verdict
from benchmarks.cases import Line
from daq.errors import InputError
from fitting.loop.session import Options

#: What every line of results has.
RESULT = {"kind", "number", "seed", "result"}


@dataclass(frozen=True)
class Order:
    """One case to do, judged without the recordings of one role if there is one, and at so many bands."""

    key: CaseKey
    selection: Selection
    cache: Path | None
    only_make: bool = False
    apart: bool = False
    bootstrap: int = Options.bootstrap
    without: str | None = None
    bands: tuple[float, ...] = (1.0,)


def plan_of(counts: dict[str, int], seed: int) -> list[CaseKey]:
    """List the cases of a run, classes interleaved so that an interrupted run has some of each."""
    keys = [
        (number / max(count, 1), KINDS.index(kind), CaseKey(kind, number, seed))
        for kind, count in counts.items()
        for number in range(count)
    ]
    return [key for _, _, key in sorted(keys, key=lambda item: item[:2])]


def read_lines(path: Path) -> list[Line]:
    """Read results of a file."""
    return cases.read_lines(path, RESULT, "attribution")


def key_of(line: Line) -> CaseKey:
    """Return which case a line is about."""
    return CaseKey(str(line["kind"]), int(line["number"]), int(line["seed"]))


def run_case(order: Order) -> Line:
    """Make one case and judge it; failures are results, not hidden."""
    key = order.key
    line: Line = {"kind": key.kind, "number": key.number, "seed": key.seed}
    line |= {"selection": order.selection.as_json(), "bootstrap": order.bootstrap}
    line |= {"without": order.without, "at": order.bands, "recipe": order.selection.recipe, "result": "error"}
    started = time.process_time()
    try:
        if order.cache is not None:
            case = stored_case(order.cache, key, order.selection)
        else:
            case = make_case(key, order.selection)
    except (RuntimeError, InputError) as error:  # invisible at any size, or pressures beyond their range
        return line | {"result": "not made", "error": str(error)}
    made = time.process_time()
    line |= {
        "arm": case.machine.name,
        "quality": asdict(case.quality),
        "effects": [asdict(e) for e in case.effects],
        "redrawn": [asdict(r) for r in case.redrawn],
        "make_seconds": made - started,
    }
    if order.apart:
        found = stored_apart(order.cache, case, order.selection)
        line["apart"] = None if found is None else asdict(found)
        made = time.process_time()
    if order.only_make:
        return line | {"result": "made"}
    try:
        recordings = [r for r in recordings_of(case.machine, case.recordings) if r.role != order.without]
        findings, *others = judge(case.machine, recordings, order.bootstrap, order.bands)
    except Exception as error:  # whatever the fit throws is how this case came out
        return line | {"error": f"{type(error).__name__}: {error}", "seconds": time.process_time() - made}
    seconds = time.process_time() - made
    outcome = verdict(key.kind, case.effects, findings)
    line |= asdict(outcome)
    line["said"] = {key: getattr(findings, key) for key in ("sets", "laws", "stated", "unknown", "nothing")}
    line["seconds"] = seconds / len(order.bands)
    if others:
        line["bands"] = {
            f"{band:g}": [one.verdict, one.sets, one.laws, one.depends]
            for band, one in zip(order.bands, (findings, *others), strict=True)
        }
    if outcome.result == "right" and not outcome.surplus:
        truth = true_values(case.machine, case.truth)
        known = ((name, estimate) for name, estimate in findings.values.items() if name in truth)
        line["parameters"] = {name: [*estimate, truth[name]] for name, estimate in known}
    return dict(json.loads(json.dumps(line)))  # as it is read back: lists for tuples


def run(
    orders: Sequence[Order], workers: int, output: Path | None, show: Callable[[Line], None] = lambda line: None
) -> list[Line]:
    """Run what is not in ``output`` yet, append it there, and return all orders' results in their order.

    Raises
    ------
    InputError
        If ``output`` has one of these cases from a run with other restrictions.
    """
    results = {key_of(line): line for line in cases.resumed(output, RESULT, "attribution")}
    for order in orders:
        line = results.get(order.key)
        if line is None:
            continue
        asked = (line.get("selection"), line.get("bootstrap", Options.bootstrap), line.get("without"))
        own = (order.selection.as_json(), order.bootstrap, order.without, order.bands)
        if (*asked, tuple(line.get("at", (1.0,)))) != own:
            raise InputError(
                f"{output}: has {order.key.text} from a run with other restrictions; give another file to -o"
            )
    missing = [order for order in orders if order.key not in results]
    for line in cases.in_processes(run_case, missing, workers):
        results[key_of(line)] = line
        cases.append(output, line)
        show(line)
    return [results[order.key] for order in orders]
