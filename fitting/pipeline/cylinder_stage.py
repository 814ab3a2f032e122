"""Stage 1: friction, stiffness and moving mass of each cylinder by recursive least squares.

With an `unloaded` recording ``F_l = 0`` and the rows of each cylinder hold its own parameters only. Without one, or
for a cylinder that stood still in it, the stage runs *in situ*: the rigid-body load on this joint is a nuisance
with columns of its own.

In situ the load may look like the drive (a stiffness like gravity, an offset like a constant moment). How much is
measured by the condition number of the drive's columns beside the load: with unit columns ``D`` and ``Q`` a basis of
the load's, the largest factor by which the load makes a deviation larger, ``1 / smallest singular value of
(I - Q Q') D``. Above :data:`MOST_CONDITION` the stage is refused for that joint, and it gets the joint fit's values.

Source of the limit: D. Belsley, E. Kuh and R. Welsch, *Regression Diagnostics*, 1980, ch. 3 (condition indices above
30 do damage).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fitting.estimators.covariance import hac_covariance
from fitting.estimators.recursive import RecursiveLeastSquares
from fitting.pipeline.results.stored_types import Numbers, stored
from fitting.regression.design import Design, NoiseModel, reduced_residual
from fitting.regression.prior import Prior
from fitting.regression.solving import Fit, factor

FloatArray = npt.NDArray[np.float64]

#: Whitened rows that a cylinder needs in `unloaded` recordings; fewer, and it is identified in situ.
LEAST_ROWS = 40
#: Condition number of a drive's columns beside the load above which stage 1 in situ is refused.
MOST_CONDITION = 30.0


@stored
@dataclass(frozen=True)
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
    condition : in situ, the condition number of the drive's columns beside the load; None otherwise
    refused : True where that is too large, and the values are the joint fit's
    """

    joint: str
    names: tuple[str, ...]
    theta: Numbers
    std: Numbers
    residual_std: float
    in_situ: bool
    rows: int
    covariance: Numbers | None = None
    condition: float | None = None
    refused: bool = False


@dataclass(frozen=True)
class InSitu:
    """What stage 1 needs where the load is a nuisance.

    Attributes
    ----------
    noise : weights of the rows
    joint_fit : fit of everything at once, whose values a joint gets where the stage is refused
    coloured : True where ``noise`` only scales rows, so that deviations have to know the residual's colour
    """

    noise: NoiseModel
    joint_fit: Fit
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
    in_situ : gives what joints without an unloaded recording need; None weighs them by ``noise`` and refuses none
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
    drive = design.parameters.drive_slice(joint)
    names = design.parameters.drive[joint]
    unloaded = design.indices("unloaded")
    A, b = _rows(design, noise, joint, unloaded)
    in_situ = len(b) < LEAST_ROWS
    used, condition, loaded = unloaded, None, None
    if in_situ:
        used = design.indices("train", "operation")
        loaded = needed() if needed is not None else None
        noise = noise if loaded is None else loaded.noise
        A, b = _rows(design, noise, joint, used)
        # Columns of the load that depend on each other would make the recursion lose all its digits.
        load = factor(A[:, design.parameters.base_slice]).Q if len(b) else np.zeros((0, 0))
        own = np.hstack([A[:, drive], load])
        condition = _condition(A[:, drive], load)
    else:
        own = A[:, drive]
    if len(b) == 0:  # it never moved: nothing is known, and nothing is made up
        nothing = np.zeros(len(names))
        return CylinderEstimate(
            design.machine.joints[joint].name, names, nothing, np.full(len(names), np.inf), 0.0, in_situ, 0
        )
    if condition is not None and condition > MOST_CONDITION and loaded is not None:
        return _from_joint_fit(design, joint, loaded.joint_fit, used, condition, len(b))
    mass = (names.index("m"), float(prior.mass[joint]), float(prior.std[joint])) if "m" in names else None
    theta, covariance = _recursively(own, b, forgetting, mass)
    if loaded is not None and loaded.coloured:
        covariance = hac_covariance(own, b - own @ theta)
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    full = np.zeros(len(design.parameters))
    full[drive] = theta[: len(names)]
    if in_situ:
        residual = float(np.std(b - own @ theta)) * noise.std[joint]
    else:
        parts = [reduced_residual(design, full, joint, i)[design.blocks[joint][i].keep] for i in used]
        residual = float(np.std(np.concatenate(parts)))
    own_covariance = covariance[: len(names), : len(names)]
    return CylinderEstimate(
        design.machine.joints[joint].name,
        names,
        theta[: len(names)],
        std[: len(names)],
        residual,
        in_situ,
        len(b),
        own_covariance,
        condition,
    )


def _recursively(
    own: FloatArray, b: FloatArray, forgetting: float, mass: tuple[int, float, float] | None
) -> tuple[FloatArray, FloatArray]:
    """Estimate (k,) and covariance (k, k) from whitened rows (m, k) and (m,), one row after the other.

    ``mass`` is the place of the moving mass with what is known of it before: value (NaN: nothing) and deviation, kg.
    """
    # The recursion works on unit columns; the estimate is scaled back.
    scale = np.linalg.norm(own, axis=0)
    scale[scale == 0] = 1.0
    recursion = RecursiveLeastSquares(own.shape[1], forgetting=forgetting)
    if mass is not None and np.isfinite(mass[1]):
        place, value, std = mass
        row = np.zeros(own.shape[1])
        row[place] = 1.0 / std / scale[place]
        recursion.update(row[None, :], np.array([value / std]))
    for row, value in zip(own / scale, b, strict=True):
        recursion.update(row[None, :], np.array([value]))
    # Whitened rows have unit noise; the recursion's own covariance is scaled by its residual variance.
    spread = recursion.covariance / max(recursion.residual_std**2, 1e-30)
    return recursion.theta / scale, spread / np.outer(scale, scale)


def _condition(drive: FloatArray, load: FloatArray) -> float:
    """Condition number of the drive's columns (R, k) beside the load's orthonormal ones (R, m)."""
    norms = np.linalg.norm(drive, axis=0)
    unit = drive[:, norms > 0] / norms[norms > 0]
    beside = unit - load @ (load.T @ unit)
    smallest = np.linalg.svd(beside, compute_uv=False).min(initial=1.0)
    return float(1.0 / max(smallest, 1e-16))


def _from_joint_fit(
    design: Design, joint: int, fit: Fit, used: tuple[int, ...], condition: float, rows: int
) -> CylinderEstimate:
    """The joint fit's values in the place of an estimate that was refused."""
    drive = design.parameters.drive_slice(joint)
    theta = fit.theta[: len(design.parameters)]
    parts = [reduced_residual(design, theta, joint, i)[design.blocks[joint][i].keep] for i in used]
    return CylinderEstimate(
        design.machine.joints[joint].name,
        design.parameters.drive[joint],
        theta[drive].copy(),
        fit.std[drive].copy(),
        float(np.std(np.concatenate(parts))),
        True,
        rows,
        fit.covariance[drive, drive].copy(),
        condition,
        True,
    )


def _rows(design: Design, noise: NoiseModel, joint: int, indices: tuple[int, ...]) -> tuple[FloatArray, FloatArray]:
    A, b = [np.zeros((0, len(design.parameters)))], [np.zeros(0)]
    for index in indices:
        block = design.blocks[joint][index]
        kept = noise.kept(joint, block.keep)
        A.append(noise.whiten(joint, block.reduced)[kept])
        b.append(noise.whiten(joint, block.reduced_target)[kept])
    return np.vstack(A), np.concatenate(b)
