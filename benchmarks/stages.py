"""Two stages against one, and what the intervals of parameters are worth, where the truth is known.

Arms of both kinds without any undeclared effect. Truth is read here, after the fits, and never by them:

- 95 % intervals of the joint refit: how many hold the truth, by kind of parameter (target 92 to 98 % altogether; the
  moving mass has a prior as wide as 40 %, so its intervals hold more)
- two stages, one-shot, one-shot with the unloaded recordings too, joint refit: condition number, error on the
  validation motion in noise floors, and error of the parameters over that of the joint refit (median over parameters of
  the root mean square over arms)
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Literal

import numpy as np

from benchmarks.attribution.judging import recordings_of
from benchmarks.targets import Check, Outcome, fact, rate
from fitting.arrays import FloatArray
from fitting.loop.session import Session
from fitting.pipeline.comparison import cylinder_conditions, stage_condition
from fitting.pipeline.cylinder_stage import identify_cylinders
from fitting.pipeline.rigid_body_stage import identify_one_shot, identify_rigid_body
from fitting.regression.design import Design, effort_errors
from fitting.regression.noise import effort_floor
from sim_backends.plant.cases import Case, simulate_case
from sim_backends.plant.truth import SensorQuality

Arm = Literal["folding", "slewing"]

ARMS: tuple[Arm, ...] = ("folding", "slewing")
WAYS = ("two stages", "one-shot", "one-shot, unloaded too", "joint refit")
KINDS = ("m", "K", "f_c", "f_v", "f_s", "base")


def stages(
    count: int,
    seed: int = 0,
    arms: tuple[Arm, ...] = ARMS,
    encoder_std: float | None = None,
    show: Callable[[str], None] = lambda line: None,
) -> Outcome:
    """Run ``count`` arms of each kind.

    Parameters
    ----------
    count, seed : seeds are ``seed``, ``seed + 1``, ...
    arms : which kinds
    encoder_std : noise of both position sensors, rad and m, instead of good ones'
    show : takes a line per arm
    """
    quality = SensorQuality()
    if encoder_std is not None:
        quality = replace(quality, encoder_std=encoder_std, piston_std=encoder_std)
    hits: dict[str, list[bool]] = defaultdict(list)
    conditions: dict[str, list[float]] = defaultdict(list)
    held_out: dict[str, list[float]] = defaultdict(list)
    errors: dict[tuple[str, str, str], list[float]] = defaultdict(list)
    for arm in arms:
        for number in range(seed, seed + count):
            case = simulate_case(arm, number, (), quality)
            session = Session(case.machine, recordings_of(case.machine, case.recordings))
            design, fit = session.plain.design, session.base_model.fit
            truth = truth_vector(case, design)
            ways = _ways(session)
            conditions["joint refit"].append(fit.condition_number)
            for way, (condition, _) in ways.items():
                conditions[way].append(condition)
            ways["joint refit"] = (fit.condition_number, fit.theta)
            floor = effort_floor(design, fit.theta, session.plain.pairs)
            for way, (_, theta) in ways.items():
                left = effort_errors(design, theta, design.indices("validate"))
                held_out[way].append(
                    float(np.sqrt(np.mean([(np.std(e) / f) ** 2 for e, f in zip(left, floor, strict=True)])))
                )
                for name, error in zip(design.parameters.names, theta - truth, strict=True):
                    errors[way, arm, name].append(float(error))
            inside = np.abs(fit.theta - truth) < 1.96 * fit.std
            for name, hit in zip(design.parameters.names, inside, strict=True):
                hits[kind_of(name)].append(bool(hit))
            show(f"{arm} {number}: {100 * np.mean(inside):.1f} % of {len(inside)} intervals hold the truth")
    return Outcome(
        (*_coverage(hits), *_hierarchy(conditions, held_out)), _notes(conditions, held_out, parameter_errors(errors))
    )


def truth_vector(case: Case, design: Design) -> FloatArray:
    """True drive and base parameters (p,) of a simulated case, in the design's order."""
    drive: list[float] = []
    for joint, names in zip(case.machine.joints, design.parameters.drive, strict=True):
        if joint.cylinder is not None:
            own: Mapping[str, float] = vars(case.truth.cylinders[joint.name])
        else:
            direct = case.truth.drives[joint.name]
            own = {"J": direct.inertia, "f_c": direct.f_c, "f_v": direct.f_v}
        drive += [own[name] for name in names]
    pi = np.array([link.as_list() for link in case.truth.links])
    return np.concatenate([drive, design.parameters.base.from_standard(pi)])


def kind_of(name: str) -> str:
    """``K`` for ``joint1.K``, ``base`` for a base parameter's expression."""
    joint, _, kind = name.rpartition(".")
    return kind if joint and kind in KINDS else "base"


def _ways(session: Session) -> dict[str, tuple[float, FloatArray]]:
    """Condition number and parameters of each way but the joint refit."""
    prepared = session.plain
    design = prepared.design
    two = identify_rigid_body(design, identify_cylinders(design, prepared.noise, session.prior))
    worst = stage_condition(cylinder_conditions(design), two.condition_number)
    one, more = identify_one_shot(design), identify_one_shot(design, unloaded=True)
    return {
        "two stages": (two.condition_number if worst is None else worst, two.theta),
        "one-shot": (one.condition_number, one.theta),
        "one-shot, unloaded too": (more.condition_number, more.theta),
    }


def parameter_errors(errors: Mapping[tuple[str, str, str], list[float]]) -> dict[tuple[str, str], float]:
    """Per way and kind: median over parameters of root mean square error over the joint refit's."""
    ratios: dict[tuple[str, str], list[float]] = defaultdict(list)
    for (way, arm, name), own in errors.items():
        reference = np.sqrt(np.mean(np.square(errors["joint refit", arm, name])))
        if reference > 0:
            ratios[way, kind_of(name)].append(float(np.sqrt(np.mean(np.square(own))) / reference))
    return {key: float(np.median(values)) for key, values in ratios.items()}


def _coverage(hits: Mapping[str, list[bool]]) -> list[Check]:
    every = [hit for own in hits.values() for hit in own]
    checks = [
        rate("95 % intervals that hold the truth", sum(every), len(every), "at least", 0.92),
        rate("95 % intervals that hold the truth", sum(every), len(every), "at most", 0.98),
    ]
    return checks + [rate(f"of {kind}", sum(hits[kind]), len(hits[kind])) for kind in KINDS if hits.get(kind)]


def _hierarchy(conditions: Mapping[str, list[float]], held_out: Mapping[str, list[float]]) -> list[Check]:
    def better(table: Mapping[str, list[float]], other: str) -> tuple[int, int]:
        pairs = list(zip(table["two stages"], table[other], strict=True))
        return sum(a < b for a, b in pairs), len(pairs)

    checks = []
    for other in ("one-shot", "one-shot, unloaded too"):
        checks.append(rate(f"two stages better conditioned than {other}", *better(conditions, other)))
        checks.append(rate(f"two stages smaller validation error than {other}", *better(held_out, other)))
    finite = all(np.isfinite(values).all() for values in held_out.values())
    return [*checks, fact("every way gave numbers", finite, "yes" if finite else "no")]


def _notes(
    conditions: Mapping[str, list[float]],
    held_out: Mapping[str, list[float]],
    errors: Mapping[tuple[str, str], float],
) -> tuple[str, ...]:
    lines = [
        "error of parameters over the joint refit's (median over parameters), condition number and validation error in "
        "noise floors (means over arms)",
        f"{'':24s}{'condition':>10s}{'validate':>10s}" + "".join(f"{kind:>8s}" for kind in KINDS),
    ]
    for way in WAYS:
        own = "".join(f"{errors[way, kind]:8.2f}" if (way, kind) in errors else f"{'-':>8s}" for kind in KINDS)
        lines.append(f"{way:24s}{np.mean(conditions[way]):10.1f}{np.mean(held_out[way]):10.3f}{own}")
    return tuple(lines)
