"""Ambiguous cases, closed by designed motions that the plant then makes: how many end in the single right name."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import count, islice

import numpy as np

from benchmarks.attribution.judging import Examined, findings_of, recordings_of
from benchmarks.attribution.making import BenchCase, make_case
from benchmarks.attribution.recipe import CaseKey, Selection, opened
from benchmarks.attribution.verdicts import verdict
from benchmarks.cases import Line
from benchmarks.targets import Check, rate
from daq.recordings.recording import Recording
from fitting.loop.closing import Asked, close, next_experiment, settled
from fitting.loop.session import Options, Session
from sim_backends.plant.cases import STEMS
from sim_backends.plant.motion import Motion
from sim_backends.plant.plant import record_beside_ideal
from sim_backends.undeclared import EffectSpec

#: Effects whose cases ended in sets in earlier runs of `attribution`: constant forces, friction that follows load,
#: pressure or speed, what follows an angle, what comes late.
ALIKE = (
    "pressure_offset",
    "load_dependent_friction",
    "quadratic_loss",
    "pressure_gain",
    "hose_stiffness",
    "pressure_dependent_friction",
    "asymmetric_friction",
    "actuator_inertia",
    "velocity_root_friction",
    "sensor_latency",
)
#: Sizes that leave a posterior with several names: of these classes in turn.
CLASSES = ("medium", "large")
TARGET, FORETOLD = 0.85, 0.95


@dataclass(frozen=True)
class PlantRecorder:
    """The plant of a case makes any motion: the effect's hidden shape is the same, the noise another."""

    case: BenchCase
    selection: Selection

    def __call__(self, asked: Asked, number: int) -> Recording:
        """Record a motion, as measured."""
        case = self.case
        _, plan, quality = opened(case.key, self.selection)
        names = tuple(asked.motion.columns)
        positions = np.stack([asked.motion.columns[name] for name in names], axis=1)
        motion = Motion(case.machine.name, asked.motion.rods, names, asked.motion.time, positions)
        table, _ = record_beside_ideal(
            case.machine, plan.truth, motion, quality=quality,
            undeclared=[EffectSpec(e.id, e.joint, e.size) for e in case.effects],
            rng=np.random.default_rng([plan.seed, 12, len(STEMS) + number]),
            shapes=np.random.default_rng([plan.seed, 13]),
        )  # fmt: skip
        (recording,) = recordings_of(case.machine, {f"{asked.role}-resolve-{number}": table})
        return recording


def keys(seed: int) -> Iterator[tuple[CaseKey, str]]:
    """Yield cases without end, each with its effect: effects and classes in turn, numbers rising."""
    for number in count():
        for kind in CLASSES:
            for effect in ALIKE:
                yield CaseKey(kind, number, seed), effect


def ambiguous(seed: int, seconds: float, bootstrap: int, most: int) -> Iterator[Line | None]:
    """Run at most so many cases in turn: the result of each, or None where nothing was ambiguous."""
    for key, effect in islice(keys(seed), most):
        yield _resolved(key, Selection(only=effect, seconds=seconds), bootstrap)


def _resolved(key: CaseKey, selection: Selection, bootstrap: int) -> Line | None:
    """Run one case; None if nothing in it is ambiguous (or nothing was found)."""
    line: Line = {"case": key.text, "seed": key.seed, "effect": selection.only}
    try:
        case = make_case(key, selection)
    except RuntimeError:  # invisible at any size
        return None
    session = Session(case.machine, recordings_of(case.machine, case.recordings), Options(bootstrap=bootstrap))
    started = time.process_time()
    first = Examined.of(session)
    if not first.found or settled(first.hypotheses):
        return None
    before = findings_of(first)
    line |= {"truth": [asdict(e) for e in case.effects], "before": _stated(first), "sets": before.sets}
    recorder = PlantRecorder(case, selection)
    last, steps = close(first, recorder)
    after = findings_of(last)
    outcome = verdict(key.kind, case.effects, after)
    line |= {
        "true_in_set": verdict(key.kind, case.effects, before).result in ("right", "in set"),
        "motions": [{"text": s.asked.text, "chance": s.asked.chance} for s in steps],
        "after": _stated(last),
        "result": outcome.result,
        "surplus": outcome.surplus,
        "settled": settled(last.hypotheses),
        "anyway": None if steps else _closed_anyway(first, recorder, case),
        "seconds": time.process_time() - started,
    }
    return dict(json.loads(json.dumps(line)))


def _closed_anyway(first: Examined, recorder: PlantRecorder, case: BenchCase) -> bool | None:
    """Test whether the best motion closes a set against all prediction; None where nothing was designed."""
    designed = next_experiment(first.session, first.attribution)
    best = None if designed is None else designed.options[0].motion
    if best is None:
        return None
    after = first.with_recording(recorder(Asked(best, "", (), 0.0), 1))
    outcome = verdict(case.key.kind, case.effects, findings_of(after))
    return settled(after.hypotheses) and outcome.result == "right" and not outcome.surplus


def _stated(found: Examined) -> list[Line]:
    names = [joint.name for joint in found.session.machine.joints]
    stated = []
    for one in found.hypotheses[:4]:
        terms = [[term.id, None if term.joint is None else names[term.joint]] for term in one.terms]
        stated.append({"terms": terms, "probability": round(one.probability, 3)})
    return stated


def checks(lines: Sequence[Line], looked_at: int) -> list[Check]:
    """Check how the ambiguous ones ended."""
    right = [line for line in lines if line["result"] == "right" and not line["surplus"]]
    there = [line for line in lines if line["true_in_set"]]
    closable = [line for line in lines if line["motions"]]
    left = [line for line in lines if line["anyway"] is not None]
    closed = sum(line in right for line in closable)
    foretold = [line for line in closable if line in right] + [line for line in left if not line["anyway"]]
    return [
        rate("ambiguous, of the cases looked at", len(lines), looked_at),
        rate("end in the single right name", len(right), len(lines)),
        rate("said to be closable", len(closable), len(lines)),
        rate("of those, end in the single right name", closed, len(closable), "at least", TARGET),
        rate(
            "closable or not, as the best motion then showed", len(foretold), len(closable + left), "at least", FORETOLD
        ),
        rate("the same, where the first set holds it", sum(line in right for line in there), len(there)),
        rate("end in a wrong name alone", sum(line["result"] == "wrong" for line in lines), len(lines)),
    ]


def text(line: Line) -> str:
    """Describe a case in a line: what is true, what was found, what was recorded, what is found then."""
    truth = " + ".join(f"{e['id']}@{e['reported'] or 'machine'} ({e['seen']:.1f})" for e in line["truth"])
    motions = "; ".join(motion["text"] for motion in line["motions"]) or "no motion helps"
    result = line["result"] + (" with surplus" if line["surplus"] else "")
    return (
        f"{line['case']:10s} {truth}: {_likely(line['before'])} -> [{motions}] -> {_likely(line['after'])}: {result}, "
        f"{line['seconds']:.0f} s"
    )


def _likely(stated: Sequence[Line]) -> str:
    parts = [
        f"{' + '.join(name for name, _ in h['terms']) or 'nothing'} {100 * h['probability']:.0f} %" for h in stated[:3]
    ]
    return ", ".join(parts)
