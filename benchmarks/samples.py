"""The sample recordings: what the identification finds in each, beside what the plant really was.

A directory holds one folder per case (machine file, five recordings, ``truth.yaml``); by default ``../shared/samples``
beside the repository. The plant behind them shares no code with this project. Targets:

- ``nothing-missing``: verdict ``nothing_missing``; validate error over noise floor at most 1.15 (root mean square over
  the joints); f_c within 5 % and K within 3 % of the truth on every cylinder
- an effect of the catalogue: named at its joint, alone or in a set of at most three; ``position-friction-joint2``
  and ``latency-joint3`` alone; the joint's validate error at most 1.2 noise floors afterwards
- ``bent-guide-joint1``, in no catalogue: no name, a law of the piston position on that joint
- the delay of ``latency-joint3`` within 1 ms, and less than 0.4 of the joint's error left; the angle of ``tilted-base``
  within 20 %, and every joint below 1.5 noise floors; an ambiguous answer comes with an experiment that separates
- no joint is worse on the validate recording than before (by 1 % and 0.05 noise floors); every candidate has a reason,
  every detection limit a size
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

import hilfit
from benchmarks.targets import Check, Outcome, Show, fact, figure
from sim_backends.plant.cases import STEMS

SAMPLES = Path(__file__).resolve().parents[1].parent / "shared" / "samples"
CASES = (
    "nothing-missing",
    "position-friction-joint2",
    "load-friction-joint2",
    "latency-joint3",
    "bent-guide-joint1",
    "tilted-base",
)
ALONE = ("position-friction-joint2", "latency-joint3")
#: Effects that the whole machine has: the report gives them no joint.
MACHINE_WIDE = ("base_tilt", "payload")

Report = dict[str, Any]


def samples(directory: Path, only: str | None, show: Show) -> Outcome:
    """Identify every case of a directory; nothing to check where there is none."""
    found: list[Check] = []
    for case in [only] if only else CASES:
        place = directory / case
        if not place.is_dir():
            show(f"{case}: skipped, it is not in {directory}")
            continue
        started = time.process_time()
        report = identified(place).report
        seconds = time.process_time() - started
        truth = yaml.safe_load((place / "truth.yaml").read_text(encoding="utf-8"))
        show(f"{case}: {_findings_text(report)}  ({seconds:.1f} s of CPU, bandwidth {report['bandwidth_hz']:.2f} Hz)")
        found += [*checks(case, report, truth), *of_sizes(case, report, truth), *complete(case, report)]
    return Outcome(tuple(found))


def identified(directory: Path, *, loop: bool = True) -> hilfit.Result:
    """Identify a case from its machine file and the recordings beside it, with the loop or without it."""
    files: dict[str, Any] = defaultdict(list)
    for stem in STEMS:
        files[stem.partition("-")[0]].append(directory / f"{stem}.parquet")
    return hilfit.identify(directory / "machine.yaml", **files, loop=loop)


def _over_floor(report: Report, when: str, joint: str | None = None) -> float:
    """Compute validation error over noise floor: of one joint, or the root mean square over all."""
    chosen = [report["errors"][joint]] if joint else list(report["errors"].values())
    return float(np.sqrt(np.mean([(e[when]["validate"] / e["noise_floor"]) ** 2 for e in chosen])))


def named(report: Mapping[str, Any]) -> list[list[tuple[str, str | None]]]:
    """List what the loop names: each effect's id and joint, and those inseparable from it."""
    effects = report["loop"]["effects"]
    return [[(own["id"], own["joint"]) for own in (effect, *effect["indistinguishable_from"])] for effect in effects]


def _findings_text(report: Report) -> str:
    """Describe verdict, effects with their sets, and laws."""
    loop = report["loop"]
    parts = [loop["verdict"]]
    parts += [" | ".join(f"{id}@{joint or 'machine'}" for id, joint in own) for own in named(report)]
    parts += [f"law of {law['variable']}@{law['joint']}" for law in loop["unexplained"]]
    return "; ".join(parts)


def checks(case: str, report: Report, truth: dict[str, Any]) -> Iterator[Check]:
    """Check what has to be so of one case."""
    loop, sets = report["loop"], named(report)
    # The id is None for what is in no catalogue.
    true = [(e["name"], None if e["name"] in MACHINE_WIDE else e["joint"]) for e in truth["effects"]]
    before, after = (_over_floor(report, when) for when in ("before", "after"))
    yield Check(f"{case}: validate over noise floor", after, f"{before:.2f} before, {after:.2f} after")
    if not true:
        yield fact(f"{case}: verdict nothing_missing", loop["verdict"] == "nothing_missing", loop["verdict"])
        yield figure(f"{case}: error over noise floor", after, "{:.3f}", most=1.15)
        for name, allowed in (("f_c", 5.0), ("K", 3.0)):
            off = {
                joint: 100 * (report["cylinders"][joint]["parameters"][name]["value"] / values[name] - 1)
                for joint, values in truth["cylinders"].items()
            }
            joint, worst = max(off.items(), key=lambda item: abs(item[1]))
            shown = f"{worst:+.2f} % at {joint}"
            yield figure(f"{case}: {name}, worst cylinder", abs(worst), "{:g} %", most=allowed, shown=shown)
        return
    if true[0][0] is None:
        joint = str(truth["effects"][0]["joint"])
        laws = {(law["joint"], law["variable"]) for law in loop["unexplained"]}
        fits = not sets and bool(laws) and all(j == joint for j, _ in laws) and (joint, "piston_position") in laws
        yield fact(f"{case}: a law of the piston position on {joint}, no name", fits, _findings_text(report))
        return
    right = len(sets) == 1 and true[0] in sets[0] and len(sets[0]) <= (1 if case in ALONE else 3)
    how = "alone" if case in ALONE else "alone or in a set of three"
    yield fact(f"{case}: named, {how}", right and not loop["unexplained"], _findings_text(report))
    if true[0][1] is not None:
        before, after = (_over_floor(report, when, true[0][1]) for when in ("before", "after"))
        shown = f"{before:.2f} before, {after:.2f} after"
        yield figure(f"{case}: {true[0][1]} over its noise floor", after, most=1.2, shown=shown)


def complete(case: str, report: Report) -> Iterator[Check]:
    """Check what every report has to hold, and what no loop may do."""
    loop = report["loop"]
    if loop["verdict"] != "unexplained":
        worst = max(
            e["after"]["validate"] / (1.01 * e["before"]["validate"] + 0.05 * e["noise_floor"])
            for e in report["errors"].values()
        )
        yield figure(f"{case}: worst joint, after over before", worst, "{:.3f}", most=1.0)
    whole = all(c["reason"] for c in loop["candidates"]) and all(e["smallest"] > 0 for e in loop["detection_limits"])
    whole = whole and bool(loop["candidates"]) and bool(loop["detection_limits"])
    counts = f"{len(loop['candidates'])} candidates, {len(loop['detection_limits'])} limits"
    yield fact(f"{case}: candidates have reasons, limits have sizes", whole, counts)
    if loop["verdict"] == "ambiguous":
        experiment = loop["next_experiment"]
        yield fact(f"{case}: an experiment separates the set", bool(experiment["separates"]), _findings_text(report))


def of_sizes(case: str, report: Report, truth: dict[str, Any]) -> Iterator[Check]:
    """Check parameters against the truth, for the effects whose size is one of them."""
    for effect in report["loop"]["effects"]:
        size, own = float(truth["effects"][0]["size"]), effect["parameters"]
        if effect["id"] == "sensor_latency":
            off, joint = 1e3 * abs(own["tau"]["value"] - size), report["errors"][effect["joint"]]
            yield figure(f"{case}: delay", off, "{:g} ms", most=1.0, shown=f"{off:.2f} ms off")
            left = joint["after"]["validate"] / joint["before"]["validate"]
            yield figure(f"{case}: error left at {effect['joint']}", left, "{:.2f}", most=0.4)
        if effect["id"] == "base_tilt":
            # To first order in an angle of two degrees; its direction is not known.
            angle = float(np.hypot(own["tilt_1"]["value"], own["tilt_2"]["value"]))
            off = 100 * abs(angle / size - 1)
            yield figure(f"{case}: angle of the base", off, "{:g} %", most=20.0, shown=f"{off:.1f} % off")
            most = max(e["after"]["validate"] / e["noise_floor"] for e in report["errors"].values())
            yield figure(f"{case}: joint farthest over its floor", most, "{:.2f}", most=1.5)
