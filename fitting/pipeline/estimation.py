"""The ways to the parameters that were tried on one identification, what each leaves, and why one is handed out."""

from __future__ import annotations

from typing import Any

from fitting.arrays import FloatArray
from fitting.loop.session import Session
from fitting.loop.weighting import MOST_LOST, Weighed
from fitting.pipeline.results.stage_results import RigidBody
from fitting.regression.error_sizes import errors_of
from fitting.report.languages import NAMES


def estimation(session: Session, stage_two: RigidBody, final: Weighed) -> dict[str, Any]:
    """The table of ways, of the base model on the uncorrected recordings.

    Parameters
    ----------
    session, stage_two : with what the second stage found
    final : the fit with everything that was found

    Returns
    -------
    dict
        ``chosen``: the weights of base and final model, decided on the latter; ``ratio`` and ``final_ratio`` of the two
        (:mod:`fitting.loop.weighting`); ``tried``: per way ``name``, ``what``, ``training_error`` and
        ``held_out_error`` (relative: norm of the error over that of the effort; null without a validation motion),
        ``why`` in words.
    """
    base, design = session.handed_base, session.plain.design
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
        "why": why(final),
    }


def why(final: Weighed) -> str:
    """One sentence that says which weights the parameters have, and why."""
    percent = 100 * (final.ratio - 1)
    if final.weights == "whitened":
        return (
            "Rows are weighted by the measured noise: on the training motions that costs "
            f"{max(percent, 0.0):.1f} % of error against plain least squares, and the parameters are the most certain."
        )
    return (
        "All efforts count alike: weights by the measured noise would raise the error on the training "
        f"motions by {percent:.0f} %, more than the {100 * (MOST_LOST - 1):.0f} % that a right model allows, so what "
        "is left is an error of the model and not noise."
    )
