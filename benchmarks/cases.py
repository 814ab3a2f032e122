"""Cases of a benchmark: run in turn or in processes, a line of JSON for each, continued where a run was interrupted."""

from __future__ import annotations

import json
import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from collections.abc import Set as AbstractSet
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any, TypeVar

from daq.errors import InputError
from daq.whole_files import write_whole

Line = dict[str, Any]
Order = TypeVar("Order")


def one_blas_thread() -> None:
    """Give this process (before it loads numpy) and its children one BLAS thread: processor times mean something."""
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[variable] = "1"


def in_processes(work: Callable[[Order], Line], orders: Sequence[Order], workers: int) -> Iterator[Line]:
    """Yield the line of each case as it comes; with several workers each is a process with one BLAS thread."""
    one_blas_thread()
    if workers <= 1 or len(orders) <= 1:
        yield from map(work, orders)
        return
    # Spawned, so that the environment holds before numpy is loaded; what has not begun is dropped, so Ctrl-C is quick.
    pool = ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn"))
    try:
        for future in as_completed([pool.submit(work, order) for order in orders]):
            yield future.result()
    finally:
        pool.shutdown(cancel_futures=True)


def append(output: Path | None, line: Line) -> None:
    """Add a line to the results, where they are kept."""
    if output is not None:
        with output.open("a", encoding="utf-8") as file:
            file.write(json.dumps(line) + "\n")


def refuse_existing(output: Path | None) -> None:
    """Refuse results of an earlier run, which a benchmark that cannot go on would mix with its own."""
    if output is not None and output.exists():
        raise InputError(f"{output}: is there already; give another file to -o")


def read_lines(path: Path, keys: AbstractSet[str], benchmark: str) -> list[Line]:
    """Read results of a file, each with ``keys``; drop a last line that an interruption cut off.

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
            if not isinstance(line, dict) or not keys <= line.keys():
                raise ValueError("no result")
            lines.append(line)
        except ValueError:
            if number == len(texts):
                break
            message = f"{path}: line {number} is no result of 'hilfit bench {benchmark}'; give another file"
            raise InputError(message) from None
    return lines


def resumed(output: Path | None, keys: AbstractSet[str], benchmark: str) -> list[Line]:
    """Read what an earlier run left in ``output``, and clear a cut last line, or the next one would be glued to it."""
    if output is None or not output.exists():
        return []
    lines = read_lines(output, keys, benchmark)
    write_whole(output, "".join(json.dumps(line) + "\n" for line in lines).encode())
    return lines
