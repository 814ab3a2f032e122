"""The sample recordings: what the identification says of each, beside what the plant really was.

    python benchmarks/samples.py [DIRECTORY] [--only CASE]

DIRECTORY holds one folder per case (machine file, five recordings, ``truth.yaml``); by default ``../shared/samples``
beside the repository. The plant behind them shares no code with this project. Targets:

- ``nothing-missing``: verdict ``nothing_missing``; validate error over noise floor at most 1.15 (root mean square over
  the joints); f_c within 5 % and K within 3 % of the truth on every cylinder
- ``position-friction-joint2``: that effect at that joint, alone; its validate error at most 1.2 noise floors afterwards
- every case: no effect is named whose set (the name and what it cannot be told from) does not hold the truth

Exit code 1 if a target is missed; 0 with a line that says so where there are no samples.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from fitting.session import Request
from fitting.stages import identify

SAMPLES = Path(__file__).resolve().parents[1].parent / "shared" / "samples"
ROLES = {"unloaded": "unloaded", "train-1": "train", "train-2": "train", "repeat": "repeat", "validate": "validate"}
CASES = (
    "nothing-missing",
    "position-friction-joint2",
    "load-friction-joint2",
    "latency-joint3",
    "bent-guide-joint1",
    "tilted-base",
)
#: Effects that the whole machine has: the report gives them no joint.
MACHINE_WIDE = ("base_tilt", "payload")

Checks = Iterator[tuple[str, bool | None]]


def identify_case(directory: Path) -> dict[str, Any]:
    """The report of one case."""
    files = tuple((role, directory / f"{name}.parquet") for name, role in ROLES.items())
    with tempfile.TemporaryDirectory(prefix="hilfit-samples-") as output:
        return identify(Request(directory / "machine.yaml", files, Path(output)))


def over_floor(report: dict[str, Any], when: str, joint: str | None = None) -> float:
    """Validate error over noise floor: of one joint, or the root mean square over all."""
    chosen = [report["errors"][joint]] if joint else list(report["errors"].values())
    return float(np.sqrt(np.mean([(e[when]["validate"] / e["noise_floor"]) ** 2 for e in chosen])))


def said(report: dict[str, Any]) -> str:
    """Verdict, effects with their sets, and laws."""
    loop = report["loop"]
    parts = [loop["verdict"]]
    for effect in loop["effects"]:
        rivals = "".join(f" | {r['id']}@{r['joint'] or 'machine'}" for r in effect["indistinguishable_from"])
        parts.append(f"{effect['id']}@{effect['joint'] or 'machine'}{rivals}")
    parts += [f"law of {law['variable']}@{law['joint']}" for law in loop["unexplained"]]
    return "; ".join(parts)


def true_effects(truth: dict[str, Any]) -> set[tuple[str, str | None]]:
    """What the plant had, as (id, joint); the id is None for what stands in no catalogue."""
    return {(e["name"], None if e["name"] in MACHINE_WIDE else e["joint"]) for e in truth["effects"]}


def checks(case: str, report: dict[str, Any], truth: dict[str, Any]) -> Checks:
    """Lines about one case, each with whether its target is met (None: there is no target)."""
    loop = report["loop"]
    before, after = (over_floor(report, when) for when in ("before", "after"))
    yield f"validate error over noise floor: {before:.2f} before, {after:.2f} after", None
    sets = [
        {(e["id"], e["joint"]), *((r["id"], r["joint"]) for r in e["indistinguishable_from"])} for e in loop["effects"]
    ]
    true = true_effects(truth)
    yield "no wrong name", all(members & true for members in sets)
    if case == "nothing-missing":
        yield "verdict nothing_missing", loop["verdict"] == "nothing_missing"
        yield f"error over noise floor {after:.3f}, at most 1.15", after <= 1.15
        for joint, true_values in truth["cylinders"].items():
            found = report["cylinders"][joint]["parameters"]
            for name, allowed in (("f_c", 5.0), ("K", 3.0)):
                off = 100 * (found[name]["value"] / true_values[name] - 1)
                yield f"{joint}.{name} {off:+.2f} %, at most {allowed:g} %", abs(off) <= allowed
    if case == "position-friction-joint2":
        yield "the effect at its joint, alone", loop["verdict"] == "effect_added" and sets == [true]
        before, after = (over_floor(report, when, "joint2") for when in ("before", "after"))
        yield f"joint2: error over noise floor {before:.2f} before, {after:.2f} after, at most 1.2", after <= 1.2


def main() -> int:
    """Run the cases and print their lines."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("directory", nargs="?", type=Path, default=SAMPLES)
    parser.add_argument("--only", choices=CASES, help="only this case")
    arguments = parser.parse_args()
    if not arguments.directory.is_dir():
        print(f"skipped: no sample recordings in {arguments.directory}")
        return 0
    missed = 0
    for case in [arguments.only] if arguments.only else CASES:
        directory = arguments.directory / case
        if not directory.is_dir():
            print(f"{case}: skipped, it is not in {arguments.directory}")
            continue
        started = time.perf_counter()
        report = identify_case(directory)
        seconds = time.perf_counter() - started
        print(f"{case}: {said(report)}  ({seconds:.1f} s, bandwidth {report['bandwidth_hz']:.2f} Hz)")
        truth = yaml.safe_load((directory / "truth.yaml").read_text(encoding="utf-8"))
        for line, met in checks(case, report, truth):
            print(f"  {'      ' if met is None else 'ok    ' if met else 'MISSED'} {line}")
            missed += met is False
    print(f"{missed} targets missed" if missed else "every target is met")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
