"""Stage 2 (base parameters with the friction of stage 1 frozen) and the one-shot regression of everything at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fitting.cylinder_stage import CylinderEstimate
from fitting.estimators.ordinary import OrdinaryLeastSquares
from fitting.regression import Design

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class StackedEstimate:
    """Parameters of the whole arm from one stacked regression of joint efforts.

    Attributes
    ----------
    theta : (p,) all parameters in the design's order
    std : (p,) standard deviations; of stage 2 the drive parameters' are stage 1's
    condition_number : of the column-scaled regressor
    told : (p,) False where this motion says nothing of the parameter
    """

    theta: FloatArray
    std: FloatArray
    condition_number: float
    told: npt.NDArray[np.bool_]


def identify_rigid_body(design: Design, cylinders: Sequence[CylinderEstimate]) -> StackedEstimate:
    """Stage 2: ordinary least squares of ``r (F - F_cylinder) = Y_b beta`` over all joints and samples."""
    parameters = design.parameters
    theta, std = np.zeros(len(parameters)), np.zeros(len(parameters))
    for joint, cylinder in enumerate(cylinders):
        theta[parameters.drive_slice(joint)] = cylinder.theta
        std[parameters.drive_slice(joint)] = cylinder.std
    A, b, groups = _effort_rows(design, theta)
    base = parameters.base_slice
    estimate = OrdinaryLeastSquares().fit(A[:, base], b, groups=groups)
    theta[base], std[base] = estimate.theta, estimate.std
    told = np.ones(len(parameters), dtype=bool)
    told[base] = estimate.told
    return StackedEstimate(theta, std, float(estimate.condition_number), told)


def identify_one_shot(design: Design) -> StackedEstimate:
    """Drive and base parameters from the training motions at once, by ordinary least squares of joint efforts."""
    A, b, groups = _effort_rows(design, np.zeros(len(design.parameters)))
    estimate = OrdinaryLeastSquares().fit(A, b, groups=groups)
    return StackedEstimate(estimate.theta, estimate.std, float(estimate.condition_number), estimate.told)


def _effort_rows(design: Design, frozen: FloatArray) -> tuple[FloatArray, FloatArray, npt.NDArray[np.intp]]:
    """Filtered rows in joint effort over the training segments; ``frozen`` parameters are moved to the left."""
    rows, targets, groups = [], [], []
    for joint in range(len(design.machine.joints)):
        for index in design.indices("train", "operation"):
            segment, block = design.segments[index], design.blocks[joint][index]
            r = segment.r[:, joint]
            target = r * (block.target - block.columns @ frozen)
            reduced = design.bank.reduce(np.column_stack([target, block.columns * r[:, None]]))[block.keep]
            rows.append(reduced[:, 1:])
            targets.append(reduced[:, 0])
            groups.append(np.full(len(reduced), joint))
    return np.vstack(rows), np.concatenate(targets), np.concatenate(groups)
