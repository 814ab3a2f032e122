"""A stage program for tests: ``python fake_stages.py REQUEST.json STAGE``.

It is steered by the request's options, or by ``steer.json`` in the data directory.

``block``: this stage waits until the file ``go``, or ``go-<its process>``, is beside the output directory.
``signed``: the report names the process that wrote it. ``fail``: ``[stage, exit code, text]``.
The stage ``valve`` of an identification of valves leaves the report ``VALVE`` and an inverse in C and ST.
``crash``: this stage kills itself. ``silent``: this stage ends without a result. ``no_report``: the last one
writes none.
Every run of a stage leaves a line in ``ran.txt`` beside the output directory; a stage that finished answers from its
stored summary.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from pathlib import Path
from typing import Any

STAGES = ("check", "cylinder_stage", "report")
REPORT: dict[str, Any] = {
    "schema": "hilfit/report/1",
    "loop": {"verdict": "nothing_missing"},
    "overall": {"before": 1.0, "after": 0.9, "change_percent": -10.0, "ci95_percent": [-12.0, -8.0]},
}
#: Of the report of valves what the service reads.
VALVE: dict[str, Any] = {
    "schema": "hilfit/valve/1",
    "machine": "lever",
    "created": "2026-01-01T00:00:00+00:00",
    "software": {},
    "axes": {
        "joint1": {
            "verdict": "effect_added",
            "handed_out": "model",
            "errors": {"before": 0.05, "handed_out": 0.031, "role": "validate", "unit": "of the speed's RMS"},
            "delay": {"value": 0.16, "std": 0.002, "unit": "s"},
            "model": {"schema": "hilfit/valve-model/1"},
            "directions": {
                "extend": {
                    "moves": True,
                    "edge_at_2_percent": {"value": 0.056},
                    "speed_at_largest": {"value": 0.21},
                },
                "retract": {"moves": False},
            },
            "effects": [{"id": "spool_hysteresis", "probability": 0.99}],
        }
    },
}


def say(**content: Any) -> None:
    print(json.dumps(content), flush=True)


def wait_for(*paths: Path) -> None:
    """At most a minute, so that nothing stays behind whatever a test does."""
    deadline = time.monotonic() + 60
    while not any(path.exists() for path in paths):
        if time.monotonic() > deadline:
            sys.exit(1)
        time.sleep(0.02)


def main(request_file: Path, stage: str) -> int:
    request = json.loads(request_file.read_text())
    output, options = Path(request["output"]), request["options"]
    steer = output.parents[2] / "steer.json"
    if steer.exists():
        options |= json.loads(steer.read_text())
    stored = output / f"summary-{stage}.json"
    if stored.exists():
        say(summary=json.loads(stored.read_text()))
        return 0
    print("a library that prints to standard output")
    with (output.parent / "ran.txt").open("a") as file:
        file.write(f"{stage} {os.getpid()} {os.nice(0)}\n")
    say(fraction=0.5, text=f"Half of {stage}")  # last: whoever hears it may look into the file
    if options.get("block") == stage:
        wait_for(output.parent / "go", output.parent / f"go-{os.getpid()}")
    if options.get("fail", [None])[0] == stage:
        _, code, text = options["fail"]
        print("details for the log", file=sys.stderr)
        say(error=text.replace("{output}", str(output)))
        return int(code)
    if options.get("crash") == stage:
        os.kill(os.getpid(), signal.SIGKILL)
    if options.get("silent") == stage:
        return 0
    if stage == "report" and not options.get("no_report"):
        loop = REPORT["loop"] | {"looked": options.get("looked", True)}
        content: dict[str, Any] = REPORT if loop["looked"] else REPORT | {"loop": loop}
        if options.get("signed"):
            content = content | {"process": os.getpid()}
        (output / "report.json").write_text(json.dumps(content))
        if options.get("next_experiment"):
            (output / "next-experiment.csv").write_text("# schema: hilfit/motion/1\n")
        (output / "report.html").write_text("<!doctype html><title>report</title>")
        if not options.get("english_only"):  # as an earlier version
            (output / "report.de.html").write_text("<!doctype html><title>Bericht</title>")
    if stage == "valve" and not options.get("no_report"):
        (output / "inverse").mkdir()
        for name in options.get("inverses", ["valve_joint1.c", "valve_joint1.h", "valve_joint1.st"]):
            (output / "inverse" / name).write_text(f"text of {name}")
        (output / "valve.json").write_text(json.dumps(VALVE))
    stored.write_text(json.dumps({"stage": stage}))
    say(summary={"stage": stage})
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), sys.argv[2]))
