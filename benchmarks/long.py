"""Hours of simulated recordings with the loop: time, memory, and whether it names what is there.

Every stretch of ten minutes is a motion of its own with noise of its own, simulated by the project's plant at 50 Hz and
laid end to end (each starts and ends at rest in mid-travel), so hours hold as much information as they seem to. Planted
are

``friction``
    friction of one cylinder that depends on its piston's position, all the time;
``payload``
    a mass that the arm picks up after seven twelfths of the recording (70 minutes of two hours) and keeps.

Targets: at most 500 MB; a minute added at the end takes at most 1.3 times one added at the beginning; the planted
effect is named, or in the set, and nothing else; the moment is right to two minutes; errors on `validate` fall.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.samples import named
from benchmarks.speed import FloatTable, identified, joined, linear, memory
from benchmarks.targets import Check, Outcome, Show, figure, silent
from fitting.arrays import FloatArray
from sim_backends.plant.cases import CasePlan, plan_case, write_tables
from sim_backends.plant.motion import random_motion
from sim_backends.plant.plant import record_beside_ideal
from sim_backends.undeclared import EffectSpec

MINUTES = (10.0, 30.0, 60.0)
#: Length of the stretches that recordings are made of, s; of `validate`, min; and when the payload comes, share.
_STRETCH, _VALIDATE, _PICKED_UP = 600.0, 10.0, 7.0 / 12.0
FRICTION = EffectSpec("position_dependent_friction", "joint2", 75.0)
PAYLOAD = EffectSpec("payload", None, 5.0)
#: s by which the moment of a change may be off: pieces are half a minute long.
_MOMENT = 120.0


def long(
    minutes: Sequence[float] = MINUTES,
    effect_minutes: float = 120.0,
    *,
    seed: int = 3,
    show: Show = silent,
) -> Outcome:
    """Identify long recordings with the loop.

    Parameters
    ----------
    minutes : lengths of training recordings with the friction, rising; two at least to see whether cost is linear
    effect_minutes : length of the recording in which the payload comes; 0 leaves it out
    seed : of arm, motions and noise
    show : gets a line for each identification
    """
    checks: list[Check] = []
    with tempfile.TemporaryDirectory(prefix="hilfit-long-") as name:
        folder = Path(name)
        plan = plan_case("slewing", seed)

        def one(what: str, train: FloatTable, also: Sequence[EffectSpec]) -> tuple[dict[str, float], dict[str, Any]]:
            tables = {
                "unloaded": record(plan, plan.motions["unloaded"].duration, also, 1000, unloaded=True),
                "train": train,
                "validate": joined([record(plan, _STRETCH, also, 2000 + k) for k in range(round(_VALIDATE / 10))]),
            }
            files = write_tables(folder, plan.machine, tables)
            took = identified(folder / "machine.yaml", files, folder / "out", loop=True, warm=False)
            report = json.loads((folder / "out" / "timed" / "report.json").read_text(encoding="utf-8"))
            show(f"{what}: {took['cpu']:.0f} s of CPU, {took['megabytes']:.0f} MB; {_found(report)}")
            checks.append(memory(what, took["megabytes"]))
            return took, report

        times = []
        for length in minutes:
            took, report = one(f"{length:g} minutes with {FRICTION.id}", training(plan, length, FRICTION), [FRICTION])
            times.append(took["cpu"])
            checks += _named(report, f"{length:g} minutes", FRICTION)
        if len(minutes) > 1:
            checks.append(linear(minutes, times))
        if effect_minutes:
            what = f"{effect_minutes:g} minutes with a payload"
            _, report = one(what, picked_up(plan, effect_minutes), [])
            checks += _named(report, f"{effect_minutes:g} minutes", PAYLOAD)
            checks.append(_moment(report, 60.0 * effect_minutes * _PICKED_UP))
    return Outcome(tuple(checks))


def record(
    plan: CasePlan, seconds: float, effects: Sequence[EffectSpec], number: int, *, unloaded: bool = False
) -> dict[str, FloatArray]:
    """Record a motion of its own, with noise of its own; ``number`` distinguishes them."""
    motion = random_motion(
        plan.machine,
        np.random.default_rng([plan.seed, 60, number]),
        seconds,
        rods="unpinned" if unloaded else "pinned",
    )
    return record_beside_ideal(
        plan.machine,
        plan.truth,
        motion,
        undeclared=effects,
        rng=np.random.default_rng([plan.seed, 50, number]),
        shapes=np.random.default_rng([plan.seed, 13]),
    )[0]


def training(plan: CasePlan, minutes: float, *effects: EffectSpec) -> FloatTable:
    """Make a training recording of so many minutes."""
    count = max(1, round(minutes * 60.0 / _STRETCH))
    return joined([record(plan, minutes * 60.0 / count, effects, k) for k in range(count)])


def picked_up(plan: CasePlan, minutes: float) -> FloatTable:
    """Make a training recording in which a payload comes, else one motion: the plant picks up once in each."""
    before = training(plan, minutes * _PICKED_UP)
    return joined([before, record(plan, 60.0 * minutes * (1 - _PICKED_UP), [PAYLOAD], 500)])


def _found(report: Mapping[str, Any]) -> str:
    overall, loop = report["overall"], report["loop"]
    names = [f"{e['id']} ({e['joint'] or 'machine'})" for e in loop["effects"]]
    names += [f"a law of {law['variable']} ({law['joint']})" for law in loop["unexplained"]]
    return (
        f"{', '.join(names) or 'nothing'}; {overall['before']:.2f} to {overall['after']:.2f} noise floors on "
        f"{overall['role']}"
    )


def _named(report: Mapping[str, Any], what: str, effect: EffectSpec) -> list[Check]:
    """Check that the effect, and nothing else, was named or is in the set; and its gain on `validate`."""
    found = report["loop"]["effects"]
    right = any((effect.id, effect.joint) in own for own in named(report))
    surplus = len(found) + len(report["loop"]["unexplained"]) - int(right)
    change = report["overall"]["change_percent"]
    return [
        Check(f"{what}, effect named or in the set", float(right), _found(report), "at least", 1.0, "named"),
        Check(f"{what}, effects that are not there", float(surplus), f"{surplus}", "at most", 0.0, "none"),
        Check(f"{what}, error on validate", change, f"{change:+.1f} %", "at most", 0.0, "not higher"),
    ]


def _moment(report: Mapping[str, Any], true: float) -> Check:
    """Check the moment of the payload against the true one, which lies 15 to 35 s after ``true``."""
    moments = [e["parameters"]["t_0"]["value"] for e in report["loop"]["effects"] if e["id"] == PAYLOAD.id]
    off = min((abs(moment - true - 25.0) for moment in moments), default=float("inf"))
    return figure("moment of the payload", off, "{:g} s", most=_MOMENT, shown=f"{off:.0f} s off")
