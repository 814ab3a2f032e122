"""Many cases: in processes of their own, appended line by line, continued where a run was interrupted."""

from __future__ import annotations

import json
import multiprocessing
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchmarks.attribution.case_files import stored_apart, stored_case
from benchmarks.attribution.coverage import intervals, true_values
from benchmarks.attribution.judging import judge, recordings_of
from benchmarks.attribution.making import make_case
from benchmarks.attribution.recipe import KINDS, CaseKey, Selection
from benchmarks.attribution.verdicts import verdict
from benchmarks.one_thread import one_blas_thread
from daq.errors import InputError
from fitting.loop.session import Options

Line = dict[str, Any]


@dataclass(frozen=True)
class Order:
    """One case to do, judged without the recordings of one role if that is said, and at so many bands."""

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
    """Read results of a file; drop a last line that an interruption cut off.

    Raises
    ------
    InputError
        If a line before the last is no result.
    """
    texts = path.read_text(encoding="utf-8").splitlines()
    lines: list[Line] = []
    for number, text in enumerate(texts, start=1):
        try:
            line = json.loads(text)
            if not isinstance(line, dict) or not {"kind", "number", "seed", "result"} <= line.keys():
                raise ValueError("no result")
            lines.append(line)
        except ValueError:
            if number == len(texts):
                break
            raise InputError(
                f"{path}: line {number} is no result of 'hilfit bench attribution'; give another file"
            ) from None
    return lines


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
        said, *others = judge(case.machine, recordings, order.bootstrap, order.bands)
    except Exception as error:  # whatever the fit throws is how this case came out
        return line | {"error": f"{type(error).__name__}: {error}", "seconds": time.process_time() - made}
    seconds = time.process_time() - made
    outcome = verdict(key.kind, case.effects, said)
    line |= asdict(outcome)
    line["said"] = {
        "sets": said.sets,
        "laws": said.laws,
        "stated": said.stated,
        "unknown": said.unknown,
        "nothing": said.nothing,
    }
    line["seconds"] = seconds / len(order.bands)
    if others:
        line["bands"] = {
            f"{band:g}": [one.verdict, one.sets, one.laws, one.depends]
            for band, one in zip(order.bands, (said, *others), strict=True)
        }
    if outcome.result == "right" and not outcome.surplus:
        estimates = intervals(said.values, true_values(case.machine, case.truth))
        line["parameters"] = {i.name: [i.value, i.std, i.truth] for i in estimates}
    return dict(json.loads(json.dumps(line)))  # as it is read back: lists for tuples


def run_cases(orders: Sequence[Order], workers: int) -> Iterator[Line]:
    """Yield results as they come. Each worker is a process with one BLAS thread."""
    one_blas_thread()
    if workers <= 1 or len(orders) <= 1:
        yield from map(run_case, orders)
        return
    # Spawned, so that the environment holds before numpy is loaded; few orders ahead, so that Ctrl-C is quick.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context) as pool:
        waiting: set[Future[Line]] = set()
        rest = iter(orders)
        try:
            while True:
                for order in rest:
                    waiting.add(pool.submit(run_case, order))
                    if len(waiting) >= workers + 1:
                        break
                if not waiting:
                    return
                done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                for future in done:
                    yield future.result()
        finally:
            for future in waiting:
                future.cancel()


def run(
    orders: Iterable[Order], workers: int, output: Path | None, show: Callable[[Line], None] = lambda line: None
) -> list[Line]:
    """Run what is not in ``output`` yet, append it there, and return all orders' results in their order."""
    orders = list(orders)
    known = {}
    if output is not None and output.exists():
        known = {key_of(line): line for line in read_lines(output)}
        # An interruption may have cut the last line: start clean, or the next one would be glued to it.
        text = "".join(json.dumps(line) + "\n" for line in known.values())
        part = output.with_name(output.name + ".part")
        part.write_text(text, encoding="utf-8")
        part.replace(output)
        wanted = {
            order.key: (order.selection.as_json(), order.bootstrap, order.without, order.bands) for order in orders
        }
        for key, line in known.items():
            asked = line.get("selection"), line.get("bootstrap", Options.bootstrap), line.get("without")
            own = (*asked, tuple(line.get("at", (1.0,))))
            if key in wanted and own != wanted[key]:
                raise InputError(
                    f"{output}: has {key.text} from a run with other restrictions; give another file to -o"
                )
    results = {order.key: known[order.key] for order in orders if order.key in known}
    for line in run_cases([order for order in orders if order.key not in known], workers):
        results[key_of(line)] = line
        if output is not None:
            with output.open("a", encoding="utf-8") as file:
                file.write(json.dumps(line) + "\n")
        show(line)
    return [results[order.key] for order in orders]
