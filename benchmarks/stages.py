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
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.attribution.judging import recordings_of
from benchmarks.attribution.verdicts import truth_vector
from benchmarks.targets import ARMS, Arm, Check, Outcome, Show, fact, rate, silent
from fitting.loop.session import Options, Session
from fitting.pipeline.results.stage_results import Residual, RigidBody, StageResults
from fitting.pipeline.stage_two import comparison
from fitting.pipeline.stages import STEPS
from fitting.progress import quiet
from sim_backends.plant.cases import simulate_case
from sim_backends.plant.truth import SensorQuality

#: What is compared, and what the comparison of a report calls it.
WAYS = {
    "two stages": "hierarchical",
    "one-shot": "one_shot",
    "one-shot, unloaded too": "one_shot_with_unloaded",
    "joint refit": "joint_refit",
}
KINDS = ("m", "K", "f_c", "f_v", "f_s", "base")


def stages(
    count: int, seed: int = 0, arms: tuple[Arm, ...] = ARMS, encoder_std: float | None = None, show: Show = silent
) -> Outcome:
    """Run ``count`` arms of each kind."""
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
            session = Session(case.machine, recordings_of(case.machine, case.recordings), Options(loop=False))
            design, fit = session.plain.design, session.base_model.fit
            truth = truth_vector(case.machine, case.truth, design)
            compared, results = compare_ways(session)
            rigid = results[RigidBody]
            estimates = (rigid.two_stage, rigid.one_shot, rigid.one_shot_with_unloaded, fit)
            for way, estimate in zip(WAYS, estimates, strict=True):
                assert estimate is not None
                conditions[way].append(compared["contenders"][WAYS[way]]["condition_number"])
                held_out[way].append(compared["contenders"][WAYS[way]]["overall"])
                for name, error in zip(design.parameters.names, estimate.theta - truth, strict=True):
                    errors[way, arm, name].append(float(error))
            inside = np.abs(fit.theta - truth) < 1.96 * fit.std
            for name, hit in zip(design.parameters.names, inside, strict=True):
                hits[kind_of(name)].append(bool(hit))
            show(f"{arm} {number}: {100 * np.mean(inside):.1f} % of {len(inside)} intervals hold the truth")
    notes = _notes(conditions, held_out, parameter_errors(errors))
    return Outcome((*_coverage(hits), *_hierarchy(conditions, held_out)), notes)


def kind_of(name: str) -> str:
    """Return ``K`` for ``joint1.K``, ``base`` for a base parameter's expression."""
    joint, _, kind = name.rpartition(".")
    return kind if joint and kind in KINDS else "base"


def compare_ways(session: Session) -> tuple[dict[str, Any], StageResults]:
    """Compare two stages with one on a session's recordings, with 95 % intervals; return the stages' results."""
    results = StageResults()
    for stage in ("check", "cylinder_stage", "rigid_body_stage", "residual"):
        results = results.having(STEPS[stage](session, results, quiet))
    return comparison(session, results[RigidBody], np.asarray(results[Residual].noise_floor)), results


def parameter_errors(errors: Mapping[tuple[str, str, str], list[float]]) -> dict[tuple[str, str], float]:
    """Compute per way and kind the median over parameters of RMS error over the joint refit's."""
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
    conditions: Mapping[str, list[float]], held_out: Mapping[str, list[float]], errors: Mapping[tuple[str, str], float]
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
