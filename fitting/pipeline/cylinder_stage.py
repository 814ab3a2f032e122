"""Stage 1: friction, stiffness and moving mass of each cylinder by recursive least squares.

With an `unloaded` recording ``F_l = 0`` and the rows of each cylinder hold its own parameters only. Without one, or
for a cylinder that stood still in it, the stage runs *in situ*: the rigid-body load on this joint is a nuisance with
columns of its own. There the load may look like the drive (a stiffness like gravity, an offset like a constant moment),
and one joint's rows determine little of the links: so the recursion begins with the rows of the plausible arm
(:mod:`fitting.regression.plausible_arm`) at the point of the joint fit. Where the recordings refuse that arm, nothing
separates the two, and the joint gets the joint fit's values.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from fitting.arrays import FloatArray
from fitting.estimators.covariance import series_scores
from fitting.estimators.recursive import RecursiveLeastSquares
from fitting.pipeline.results.stored_types import Numbers, stored
from fitting.regression.design import Design, NoiseModel, reduced_errors, whitened_joint
from fitting.regression.prior import Prior, prior_row
from fitting.regression.solving import Fit, factor

#: Whitened rows that a cylinder needs in `unloaded` recordings; fewer, and it is identified in situ.
LEAST_ROWS = 40


@stored
class CylinderEstimate:
    """Stage 1's result for one joint.

    Attributes
    ----------
    joint : name
    names : parameters, ``m K f_c f_v f_s`` or those that a direct drive has
    theta, std : their values and standard deviations, SI; zero and infinite for a joint that never moved
    residual_std : of the filtered drive effort, N (or the joint's effort unit)
    in_situ : True if the load was a nuisance instead of zero
    rows : how many rows the recursion took
    covariance : (k, k) of the parameters, None where only their deviations are known
    refused : True where stage 1 in situ is, and the values are the joint fit's
    """

    joint: str
    names: tuple[str, ...]
    theta: Numbers
    std: Numbers
    residual_std: float
    in_situ: bool
    rows: int
    covariance: Numbers | None = None
    refused: bool = False


@dataclass(frozen=True)
class InSitu:
    """Input of stage 1 where the load is a nuisance.

    Attributes
    ----------
    noise : weights of the rows
    joint_fit : fit of everything at once, whose values a joint gets where the stage is refused
    prior : of links and drives, at the point of the joint fit
    coloured : True where ``noise`` only scales rows, so that deviations have to know the residual's colour
    """

    noise: NoiseModel
    joint_fit: Fit
    prior: Prior
    coloured: bool


def identify_cylinders(
    design: Design,
    noise: NoiseModel,
    prior: Prior,
    *,
    forgetting: float = 1.0,
    in_situ: Callable[[], InSitu] | None = None,
) -> tuple[CylinderEstimate, ...]:
    """Run stage 1 for every joint.

    Parameters
    ----------
    design, prior : as for any fit
    noise : whitening of each joint's rows
    forgetting : forgetting factor of the recursion; 1 forgets nothing
    in_situ : gives what joints without an unloaded recording need; None weighs them by ``noise`` beside ``prior``
    """
    return tuple(
        _identify(design, noise, prior, joint, forgetting, in_situ) for joint in range(len(design.machine.joints))
    )


def _identify(
    design: Design,
    noise: NoiseModel,
    prior: Prior,
    joint: int,
    forgetting: float,
    needed: Callable[[], InSitu] | None,
) -> CylinderEstimate:
    drive, name = design.parameters.drive_slice(joint), design.machine.joints[joint].name
    names = design.parameters.drive[joint]
    count, unloaded = len(names), design.indices("unloaded")
    rows = whitened_joint(design, noise, joint, unloaded)
    in_situ = len(rows.b) < LEAST_ROWS
    used, loaded = unloaded, None
    if in_situ:
        used = design.indices("train", "operation")
        loaded = needed() if needed is not None else None
        noise, prior = (noise, prior) if loaded is None else (loaded.noise, loaded.prior)
        rows = whitened_joint(design, noise, joint, used)
    A, b = rows.A, rows.b
    if len(b) == 0:  # it never moved: nothing is known, and nothing is made up
        return CylinderEstimate(name, names, np.zeros(count), np.full(count, np.inf), 0.0, in_situ, 0)
    if in_situ and prior.refused and loaded is not None:
        return _from_joint_fit(design, joint, loaded.joint_fit, used, len(b))
    places = np.arange(drive.start, drive.stop)
    if in_situ:
        places = np.concatenate([places, np.arange(design.parameters.base_slice.start, len(design.parameters))])
    known_A, known_b = _known_rows(design, prior, joint, in_situ)
    own = A[:, places]
    theta, covariance = _recursively(own, b, known_A[:, places], known_b, forgetting)
    if loaded is not None and loaded.coloured:
        covariance = _coloured(own, b, theta, known_A[:, places])
    full = np.zeros(len(design.parameters))
    full[drive] = theta[:count]
    if in_situ:
        residual = float(np.std(b - own @ theta)) * noise.std[joint]
    else:
        residual = _left(design, full, joint, used)
    covariance = covariance[:count, :count]
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return CylinderEstimate(name, names, theta[:count], std, residual, in_situ, len(b), covariance)


def _known_rows(design: Design, prior: Prior, joint: int, in_situ: bool) -> tuple[FloatArray, FloatArray]:
    """Return prior rows, (k, p) and (k,) of unit noise: the moving mass; in situ drive and links."""
    width = len(design.parameters)
    A, b = prior.arm_rows(width) if in_situ else (np.zeros((0, width)), np.zeros(0))
    others = np.ones(width, dtype=bool)
    others[design.parameters.drive_slice(joint)] = others[design.parameters.base_slice] = False
    mine = ~A[:, others].any(axis=1)
    row = prior_row(design.parameters, prior, joint, width)
    if row is None:
        return A[mine], b[mine]
    return np.vstack([A[mine], row[0]]), np.append(b[mine], row[1])


def _recursively(
    own: FloatArray, b: FloatArray, known_A: FloatArray, known_b: FloatArray, forgetting: float
) -> tuple[FloatArray, FloatArray]:
    """Estimate (k,) and covariance (k, k) from whitened rows (m, k) and (m,), one row after the other, what is known
    before them first.
    """
    # The recursion works on unit columns; the estimate is scaled back.
    scale = np.linalg.norm(np.vstack([own, known_A]), axis=0)
    scale[scale == 0] = 1.0
    recursion = RecursiveLeastSquares(own.shape[1], forgetting=forgetting)
    recursion.update(known_A / scale, known_b)
    for row, value in zip(own / scale, b, strict=True):
        recursion.update(row[None, :], np.array([value]))
    # Whitened rows have unit noise; the recursion's own covariance is scaled by its residual variance.
    spread = recursion.covariance / max(recursion.residual_std**2, 1e-30)
    return recursion.theta / scale, spread / np.outer(scale, scale)


def _coloured(own: FloatArray, b: FloatArray, theta: FloatArray, known_A: FloatArray) -> FloatArray:
    """Compute the covariance (k, k) beside prior rows of a coloured residual: a sandwich, the prior as it is."""
    root = factor(np.vstack([own, known_A])).root
    S = series_scores(own @ root, b - own @ theta, "hac", np.random.default_rng(20))
    closing = known_A @ root
    return np.asarray(root @ (S + closing.T @ closing) @ root.T)


def _from_joint_fit(design: Design, joint: int, fit: Fit, used: tuple[int, ...], rows: int) -> CylinderEstimate:
    """Put the joint fit's values in place of a rejected estimate."""
    drive = design.parameters.drive_slice(joint)
    theta = fit.theta[: len(design.parameters)]
    values = theta[drive].copy(), fit.std[drive].copy(), _left(design, theta, joint, used)
    name, names = design.machine.joints[joint].name, design.parameters.drive[joint]
    return CylinderEstimate(name, names, *values, True, rows, fit.covariance[drive, drive].copy(), refused=True)


def _left(design: Design, theta: FloatArray, joint: int, used: Sequence[int]) -> float:
    """Compute the standard deviation of a joint's reduced drive effort left by parameters (p,)."""
    return float(np.std(reduced_errors(design, theta, joint, used)))
