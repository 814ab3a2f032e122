"""``python stages.py [--idle] REQUEST.json STAGE``: a stage that does nothing but take its time, and notes each run.

An identification that has a recording in the role ``train`` is a real one: this process becomes
:mod:`benchmarks.storm.real_stages`, whose stages leave no line.

A line of ``runs.txt``, beside the places of the stages, is the stage, when it began (UNIX time in ms) and the process.
It never answers from a result that is there already, so a finished stage that is run again shows. Standard library
only: it is started hundreds of times. With ``--idle`` it takes no time and notes nothing, but stays for the next stage.
"""

from __future__ import annotations

import json
import os
import sys
import time
from itertools import chain
from pathlib import Path
from typing import Any

#: Those of :mod:`fitting.pipeline.stages`, named here because this has to start quickly.
STAGES = ("check", "cylinder_stage", "rigid_body_stage", "residual", "attribution", "refit", "report")
WORK_S = 0.15
REPORT = {
    "schema": "hilfit/report/1",
    "loop": {"verdict": "nothing_missing"},
    "overall": {"before": 1.0, "after": 0.9, "change_percent": -10.0, "ci95_percent": [-12.0, -8.0]},
}


def is_real(request: dict[str, Any]) -> bool:
    """Test whether a request is one for the real stages."""
    return any(role == "train" for role, _ in request["recordings"])


def idle(request: str, stage: str) -> None:
    """Run a stage that takes nothing, then each that is asked for on standard input."""
    for place, name in chain([(request, stage)], (json.loads(line)["arguments"] for line in sys.stdin)):
        if name == STAGES[-1]:
            _write_report(Path(json.loads(Path(place).read_text())["output"]))
        print(json.dumps({"summary": {"stage": name}, "stays": True}), flush=True)


def main(request: Path, stage: str) -> None:
    """Run one stage."""
    content = json.loads(request.read_text())
    if is_real(content):
        os.execv(sys.executable, [sys.executable, "-P", "-m", "benchmarks.storm.real_stages", str(request), stage])
    print(json.dumps({"summary": run_light(content, stage)}), flush=True)


def run_light(request: dict[str, Any], stage: str) -> dict[str, Any]:
    """Run a stage that is not a real one; what it found."""
    output = Path(request["output"])
    with (output.parent / "runs.txt").open("a") as file:
        file.write(f"{stage} {time.time_ns() // 1_000_000} {os.getpid()}\n")
    for part in range(1, 4):
        time.sleep(WORK_S / 3)
        print(json.dumps({"fraction": part / 4, "text": f"{stage} {part}"}), flush=True)
    if stage == STAGES[-1]:
        _write_report(output)
    return {"stage": stage}


def _write_report(output: Path) -> None:
    partial = output / ".report.json.partial"
    partial.write_text(json.dumps(REPORT))
    partial.replace(output / "report.json")


if __name__ == "__main__":
    if sys.argv[1] == "--idle":
        idle(*sys.argv[2:4])
    else:
        main(Path(sys.argv[1]), sys.argv[2])
