"""Hierarchical against one-shot: the same machine, the same recordings, two orders of work, and what came out.

Compared are the two stages (friction from each cylinder alone, frozen, then the rigid body), the one-shot regression of
loaded recordings, the one-shot regression that also has the unloaded ones (so that order of work and amount of data do
not get mixed up), and the joint refit (generalised least squares of everything). Measured: how well each is
conditioned, what each leaves on a motion that none was fitted on, and how large each parameter's deviation is. Errors
of parameters need a truth, which no recording holds: ``benchmarks/stages.py`` measures those on simulated arms.

Beside it the weights that were tried: what each leaves, and why one is handed out.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from daq.messages import Sentence
from fitting.arm.base_parameters import condition_number
from fitting.arrays import FloatArray
from fitting.loop.session import Session
from fitting.loop.weighting import MOST_LOST, Weighed
from fitting.pipeline.results.stage_results import RigidBody, Stacked
from fitting.regression.design import Design, effort_errors
from fitting.regression.error_sizes import errors_of
from fitting.regression.flags import FLAG_PERCENT
from fitting.regression.solving import Fit
from fitting.report.languages import NAMES
from fitting.residual.confirmation.confirmation import overall_change


def cylinder_conditions(design: Design) -> dict[str, float]:
    """Compute the column-scaled condition number of each cylinder's regression; of stage 1's recordings."""
    conditions = {}
    used = design.indices("unloaded") or design.indices("train", "operation")
    for joint, name in enumerate(design.parameters.joints):
        part = design.parameters.drive_slice(joint)
        blocks = [design.blocks[joint][index] for index in used]
        W = np.vstack([block.reduced[block.keep, part] for block in blocks])
        if len(W) > W.shape[1]:
            conditions[name] = condition_number(W)
    return conditions


def compare(
    design: Design, contenders: Mapping[str, Stacked | Fit], floor: npt.ArrayLike, rng: np.random.Generator
) -> dict[str, Any]:
    """Return the comparison as plain JSON.

    Parameters
    ----------
    design : design of the uncorrected recordings, on which all were fitted
    contenders : ways to the parameters of the base model by name, with the condition number of the regression with the
        most columns that each has to solve; ``hierarchical`` and ``one_shot`` have to be among them, the latter with an
        unloaded recording in it as ``one_shot_with_unloaded``
    floor : (n,) noise floor per joint
    rng : of the intervals' bootstrap

    Returns
    -------
    dict
        ``contenders``: per name ``condition_number``, ``overall`` (error of all joints in noise floors), ``errors``
        (per joint, in its effort unit), ``flagged`` (how many parameters are poorly determined), ``untold``;
        ``role``: which motion these errors are of; ``against``: per one-shot regression ``change_percent`` of the
        error that the hierarchical way has over it, with ``ci95_percent``; ``deviation_ratio``: median over the
        parameters of the hierarchical deviation over the one-shot's; ``apart``: parameters in which the two
        differ by more than three deviations; ``said``: the outcome in words.
    """
    floor = np.asarray(floor, dtype=float)
    held_out = bool(design.indices("validate"))
    indices = design.indices("validate") if held_out else design.indices("train", "operation")
    errors = {name: effort_errors(design, c.theta, indices) for name, c in contenders.items()}

    def change(name: str) -> dict[str, Any]:
        return overall_change(errors[name], errors["hierarchical"], floor, design.bank.reduced_rate_hz, rng)

    changes = {name: change(name) for name in contenders}
    first, second = contenders["hierarchical"], contenders["one_shot"]
    both = first.determined & second.determined & (first.std > 0) & (second.std > 0)
    ratio = first.std[both] / second.std[both]
    apart = np.where(both, np.abs(first.theta - second.theta) / np.where(both, np.hypot(first.std, second.std), 1.0), 0)
    result: dict[str, Any] = {
        "role": "validate" if held_out else "train",
        "contenders": {
            name: {
                "condition_number": c.condition_number,
                "overall": changes[name]["before"],
                "errors": {
                    joint: float(np.std(own)) if len(own) else None
                    for joint, own in zip(design.parameters.joints, errors[name], strict=True)
                },
                "flagged": int(np.count_nonzero((c.std > FLAG_PERCENT / 100.0 * np.abs(c.theta)) & c.determined)),
                "untold": int(np.count_nonzero(~c.determined)),
            }
            for name, c in contenders.items()
        },
        "cylinder_condition_numbers": cylinder_conditions(design),
        "against": {
            name: {key: changes[name][key] for key in ("change_percent", "ci95_percent")}
            for name in contenders
            if name.startswith("one_shot")
        },
        "deviation_ratio": float(np.median(ratio)) if len(ratio) else None,
        "apart": [
            {
                "name": design.parameters.names[k],
                "hierarchical": float(first.theta[k]),
                "one_shot": float(second.theta[k]),
                "sigmas": float(apart[k]),
            }
            for k in np.flatnonzero(apart > 3.0)
        ],
    }
    return result | {"said": in_words(result)}


def in_words(result: Mapping[str, Any]) -> str:
    """Word the outcome: conditioning and held-out error, each for itself."""
    ways = result["contenders"]
    first, second = (ways[name]["condition_number"] for name in ("hierarchical", "one_shot"))
    better = "better" if first < second else "worse"
    sentences = [Sentence("fitting.two_stages_conditioned_shot", better=better, first=first, second=second)]
    motion = (
        Sentence("fitting.validation_motion") if result["role"] == "validate" else Sentence("fitting.motion_fitted")
    )
    against = result["against"]
    way, bounds = _way(against["one_shot"])
    if way is None:
        return Sentence("daq.sentences", sentences=[*sentences, Sentence("fitting.no_error_compare")])
    sentences.append(Sentence("fitting.their_error_shot_regression", motion=motion, way=way, bounds=bounds))
    if "one_shot_with_unloaded" in against:
        other, bounds = _way(against["one_shot_with_unloaded"])
        reason = _reason(way, other)
        sentences.append(Sentence("fitting.with_unloaded_one_shot", way=other, bounds=bounds, reason=reason))
    return Sentence("daq.sentences", sentences=sentences)


_SAME, _LESS, _MORE = "the same within its uncertainty as", "smaller than", "larger than"


def _way(change: Mapping[str, Any]) -> tuple[str | None, str]:
    """Compare the hierarchical error with another, and return the numbers."""
    value, interval = change["change_percent"], change["ci95_percent"]
    if value is None or interval is None:
        return None, ""
    way = _LESS if interval[1] < 0 else _MORE if interval[0] > 0 else _SAME
    return way, Sentence("fitting.percent_with_interval", percent=value, low=interval[0], high=interval[1])


def _reason(way: str | None, other: str | None) -> str:
    if other == _LESS:
        return Sentence("fitting.two_stage_fitting_better")
    if other == _MORE:
        return Sentence("fitting.two_stage_fitting_costs")
    if way == _LESS:
        return Sentence("fitting.helps_unloaded_recordings_not")
    return Sentence("fitting.two_stage_fitting_makes")


def stage_condition(cylinders: Mapping[str, float], rigid_body: float) -> float:
    """Return the hierarchical way's condition: the worst of its regressions."""
    return max((*cylinders.values(), rigid_body))


def estimation(session: Session, stage_two: RigidBody, final: Weighed) -> dict[str, Any]:
    """Tabulate the ways, of the base model on uncorrected recordings.

    Returns
    -------
    dict
        ``chosen``: the weights of base and final model, decided on the latter; ``ratio`` and ``final_ratio`` of the two
        (:mod:`fitting.loop.weighting`); ``tried``: per way ``name``, ``what``, ``training_error`` and
        ``held_out_error`` (relative: norm of the error over that of the effort; null without a validation motion),
        ``why`` in words.
    """
    base, design = session.weighted_base, session.plain.design
    ways: dict[str, FloatArray] = dict(base.tried)
    ways |= {"one_shot": stage_two.one_shot.theta, "two_stage": stage_two.two_stage.theta}
    tried = []
    for name, what in NAMES["ways"].items():
        if name not in ways:
            continue
        relative = errors_of(design, ways[name])[2]
        tried.append(
            {"name": name, "what": what, "training_error": relative["train"], "held_out_error": relative["validate"]}
        )
    return {
        "chosen": final.weights,
        "ratio": base.ratio,
        "final_ratio": final.ratio,
        "tried": tried,
        "why": _why(final),
    }


def _why(final: Weighed) -> str:
    """Word which weights the parameters have, and why."""
    percent = 100 * (final.ratio - 1)
    if final.weights == "whitened":
        return Sentence("fitting.rows_weighted_measured_noise", percent=max(percent, 0.0))
    return Sentence("fitting.all_efforts_count_alike", percent=percent, most_lost=100 * (MOST_LOST - 1))
