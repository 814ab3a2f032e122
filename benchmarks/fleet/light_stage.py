"""``light_stage.py REQUEST.json STAGE``: a stage that takes nothing, and stays for the next; standard library only."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "storm"))
from stages import REPORT, STAGES  # type: ignore[import-not-found]


def _orders() -> Iterator[tuple[str, str]]:
    """Yield request and stage of every order: the first of the command line, the others from standard input."""
    yield sys.argv[1], sys.argv[2]
    for line in sys.stdin:
        request, stage = json.loads(line)["arguments"]
        yield request, stage


for request, stage in _orders():
    output = Path(json.loads(Path(request).read_text())["output"])
    if stage == STAGES[-1]:
        (output / "report.json").write_text(json.dumps(REPORT))
    print(json.dumps({"summary": {"stage": stage}, "stays": True}), flush=True)
