"""How often the loop is right: random arms, effects, joints and sizes from a plant that shares no code with the fit.

    python benchmarks/attribution.py [--nulls 20] [--effects 40] [--outside 8] [--seed 0]

The size of an effect is its visibility: lambda, the root of the chi-square that its true waveform adds after the base
model is projected out of all fitted recordings, whitened by the noise. The true waveform is the difference of two
simulations with the same noise, with the effect and without; the fit never sees it. Kinematic effects are measured in
noise widths of the gap between the two position sensors instead.

Prints a line a case and the table: right (effect and joint), in the set, silent or unexplained, wrong.
"""

from __future__ import annotations

import argparse
import os
import time
from collections import Counter
from dataclasses import dataclass

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from daq.recording import Recording
from fitting.loop import kinematic_findings, run_attribution
from fitting.residual.laws import Law
from fitting.session import Session
from sim_backends.cases import Case, simulate_case
from sim_backends.truth import SensorQuality
from sim_backends.undeclared import UNDECLARED

OUTSIDE = ("bent_guide", "threshold_spring", "neighbour_product_friction", "saturating_coupling", "dwell_stiction")
KINEMATIC = ("encoder_offset", "encoder_eccentricity", "linkage_geometry", "backlash")
#: Effects that the whole machine has, in the report with joint null.
MACHINE_WIDE = ("base_tilt", "payload")
#: Absorbed, or invisible, in what these arms can show; or not a force in the band (see docs/decisions).
LEFT_OUT = ("actuator_inertia", "supply_ripple", "backlash")
ROLES = {"unloaded": "unloaded", "train-1": "train", "train-2": "train", "repeat": "repeat", "validate": "validate"}


@dataclass(frozen=True)
class Outcome:
    """What came out for one case."""

    kind: str
    effect: str
    joint: str | None
    visibility: float
    result: str
    said: str
    seconds: float


def session_of(case: Case) -> Session:
    """A session on simulated recordings, without files."""
    recordings = []
    for stem, table in case.recordings.items():
        values = {name: np.asarray(column) for name, column in table.items() if name != "time"}
        recordings.append(
            Recording(
                case.machine.name, ROLES[stem], stem, stem, case.machine.rate_hz, np.asarray(table["time"]), values
            )
        )
    return Session(case.machine, recordings)


def visibility(bare: Session, case: Case, without: Case) -> float:
    """Lambda of what differs between a case and the same without its effect."""
    plain, fit = bare.plain, bare.base_model.fit
    total = 0.0
    stems = list(ROLES)
    for number, joint in enumerate(case.machine.joints):
        cylinder = joint.cylinder
        assert cylinder is not None
        parts = []
        for index in plain.fitted:
            segment = plain.design.segments[index]
            stem = stems[segment.recording]

            def force(tables: Case, stem: str = stem, joint_name: str = joint.name) -> np.ndarray:
                table = tables.recordings[stem]
                c = next(j for j in tables.machine.joints if j.name == joint_name).cylinder
                assert c is not None
                return (
                    np.asarray(table[f"{joint_name}.head_pressure"]) * c.head_area
                    - np.asarray(table[f"{joint_name}.rod_pressure"]) * c.rod_area
                )

            difference = plain.design.bank.trimmed(force(case) - force(without))
            kept = plain.noise.kept(number, plain.design.blocks[number][index].keep)
            parts.append(plain.noise.whiten(number, plain.design.bank.reduce(difference))[kept])
        white = np.concatenate(parts)
        q = fit.orthonormal[number][: len(white)]
        total += float(white @ white) - float(np.sum((q.T @ white) ** 2))
    return float(np.sqrt(max(total, 0.0)))


def judge(case: Case) -> tuple[str, str]:
    """Verdict on one case: (result, what was said)."""
    session = session_of(case)
    findings, corrections = kinematic_findings(session)
    found = run_attribution(session, corrections)
    names = [j.name for j in case.machine.joints]
    named: list[tuple[str, str | None]] = [(f.effect.id, names[f.joint]) for f in findings]
    sets = [{(f.effect.id, names[f.joint]), *((r, names[f.joint]) for r in f.rivals)} for f in findings]
    laws = []
    for item in found.accepted:
        term = item.score.term
        place = None if term.joint is None else names[term.joint]
        if isinstance(term.content, Law):
            laws.append((place, term.content.variable(tuple(names))))
            continue
        named.append((term.id, place))
        sets.append(
            {
                (term.id, place),
                *((r.term.id, None if r.term.joint is None else names[r.term.joint]) for r in item.rivals),
            }
        )
    said = "; ".join(
        ["|".join(f"{e}@{j}" for e, j in sorted(s, key=str)) for s in sets] + [f"law({v})@{j}" for j, v in laws]
    )
    truth = {(s.id, None if s.id in MACHINE_WIDE else s.joint) for s in case.undeclared}
    if not truth:
        return ("right" if not named and not laws else "accused"), said or "-"
    outside = {e for e, _ in truth} & set(OUTSIDE)
    if outside:
        if any(s for s in sets):
            return "wrong", said
        joints = {j for _, j in truth}
        return ("right" if laws and all(j in joints for j, _ in laws) else "wrong" if laws else "silent"), said or "-"
    wrong = [s for s in sets if not s & truth]
    if wrong:
        return "wrong", said
    if not sets:
        return "silent", said or "-"
    alone = all(len(s) == 1 for s in sets)
    surplus = len(sets) > len(truth) or laws
    return ("right" if alone else "in set") + ("+surplus" if surplus else ""), said


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--nulls", type=int, default=20)
    parser.add_argument("--effects", type=int, default=40)
    parser.add_argument("--outside", type=int, default=8)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", help="only this effect")
    arguments = parser.parse_args()
    rng = np.random.default_rng([77, arguments.seed])
    plan = ["null"] * arguments.nulls + ["effect"] * arguments.effects + ["outside"] * arguments.outside
    inside = [e for e in UNDECLARED if e not in OUTSIDE and e not in LEFT_OUT]
    outcomes: list[Outcome] = []
    for number, kind in enumerate(plan):
        arm = "folding" if rng.uniform() < 0.5 else "slewing"
        quality = SensorQuality()
        seed = 1000 * (arguments.seed + 1) + number
        started = time.process_time()
        bare_case = simulate_case(arm, seed, (), quality)
        if kind == "null":
            result, said = judge(bare_case)
            outcomes.append(Outcome(kind, "-", None, 0.0, result, said, time.process_time() - started))
            show(number, outcomes[-1])
            continue
        pool = inside if kind == "effect" else list(OUTSIDE)
        effect = arguments.only or pool[int(rng.integers(len(pool)))]
        joint = None if effect in MACHINE_WIDE else f"joint{rng.integers(1, 7)}"
        target = float(np.exp(rng.uniform(np.log(6.0), np.log(60.0))))
        if kind == "outside":
            target = float(np.exp(rng.uniform(np.log(12.0), np.log(80.0))))
        size = nominal_size(effect)
        bare = session_of(bare_case)
        try:
            case = simulate_case(arm, seed, [(effect, joint, size)], quality)
            lam = visibility(bare, case, bare_case)
            if effect not in KINEMATIC and lam > 0:
                for _ in range(2):
                    size *= target / lam
                    case = simulate_case(arm, seed, [(effect, joint, size)], quality)
                    lam = visibility(bare, case, bare_case)
                    if 0.7 < lam / target < 1.4:
                        break
            result, said = judge(case)
        except Exception as error:  # a size that the plant refuses is reported, not hidden
            result, said, lam = "error", f"{type(error).__name__}: {error}", 0.0
        outcomes.append(Outcome(kind, effect, joint, lam, result, said, time.process_time() - started))
        show(number, outcomes[-1], f" ({arm}, size {size:.4g}, seed {seed})")
    table(outcomes)


def nominal_size(effect: str) -> float:
    """A first size in the effect's own unit, to be scaled to the visibility asked for."""
    unit = UNDECLARED[effect].unit
    return {"N": 50.0, "N m": 20.0, "s": 0.01, "rad": 0.01, "m": 0.002, "kg": 5.0, "Pa": 5e4, "1": 0.02}.get(unit, 1.0)


def show(number: int, outcome: Outcome, more: str = "") -> None:
    """One line."""
    print(
        f"{number:3d} {outcome.kind:8s} {outcome.effect:28s} {outcome.joint or '-':7s} "
        f"lambda {outcome.visibility:7.1f} {outcome.result:12s} {outcome.seconds:5.1f} s {outcome.said}{more}",
        flush=True,
    )


def table(outcomes: list[Outcome]) -> None:
    """Confusion by class."""
    classes: dict[str, Counter[str]] = {}
    for o in outcomes:
        if o.kind != "effect":
            name = o.kind
        elif o.effect in KINEMATIC:
            name = "kinematic"
        else:
            name = "large (10-)" if o.visibility >= 10 else "medium (6-10)" if o.visibility >= 6 else "small (-6)"
        classes.setdefault(name, Counter())[o.result] += 1
    print()
    for name, counts in classes.items():
        print(f"{name:14s} n={sum(counts.values()):3d}  " + "  ".join(f"{k}: {v}" for k, v in sorted(counts.items())))


if __name__ == "__main__":
    main()
