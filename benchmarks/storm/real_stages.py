"""``python -m benchmarks.storm.real_stages REQUEST.json STAGE``: real stages, as the service has them.

The process stays as :mod:`fitting.pipeline.stage_program` does, and the service gives it the stages of whatever job
comes next. Those of light identifications (:mod:`benchmarks.storm.stages`) it runs as such.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

from benchmarks.storm import stages
from fitting.pipeline import stage_program


def _real_ones(orders: Iterable[str]) -> Iterator[str]:
    """Yield the orders of real stages; what others ask for is done when it is their turn."""
    for order in orders:
        request, stage = json.loads(order)["arguments"]
        content = json.loads(Path(request).read_text(encoding="utf-8"))
        if stages.is_real(content):
            yield order
        else:
            print(json.dumps({"summary": stages.run_light(content, stage), "stays": True}), flush=True)


if __name__ == "__main__":
    sys.exit(stage_program.main(["--stay", *sys.argv[1:]], _real_ones(sys.stdin)))
