"""Stage 1: friction, stiffness and moving mass of each cylinder by recursive least squares.

With an `unloaded` recording ``F_l = 0`` and the rows of each cylinder hold its own parameters only. Without one, or
for a cylinder that stood still in it, the stage runs *in situ*: the rigid-body load on this joint is a nuisance
with columns of its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fitting.estimators.recursive import RecursiveLeastSquares
from fitting.prior import Prior
from fitting.regression import Design, NoiseModel, reduced_residual

FloatArray = npt.NDArray[np.float64]

#: Whitened rows that a cylinder needs in `unloaded` recordings; fewer, and it is identified in situ.
LEAST_ROWS = 40


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
    """

    joint: str
    names: tuple[str, ...]
    theta: FloatArray
    std: FloatArray
    residual_std: float
    in_situ: bool
    rows: int
    covariance: FloatArray | None = None


def identify_cylinders(
    design: Design, noise: NoiseModel, prior: Prior, *, forgetting: float = 1.0
) -> tuple[CylinderEstimate, ...]:
    """Run stage 1 for every joint."""
    return tuple(_identify(design, noise, prior, joint, forgetting) for joint in range(len(design.machine.joints)))


def _identify(design: Design, noise: NoiseModel, prior: Prior, joint: int, forgetting: float) -> CylinderEstimate:
    drive = design.parameters.drive_slice(joint)
    names = design.parameters.drive[joint]
    unloaded = design.indices("unloaded")
    A, b = _rows(design, noise, joint, unloaded)
    in_situ = len(b) < LEAST_ROWS
    used = unloaded
    if in_situ:
        used = design.indices("train", "operation")
        A, b = _rows(design, noise, joint, used)
        body = A[:, design.parameters.base_slice]
        own = np.hstack([A[:, drive], body[:, np.linalg.norm(body, axis=0) > 0]])
    else:
        own = A[:, drive]
    if len(b) == 0:  # it never moved: nothing is known, and nothing is made up
        nothing = np.zeros(len(names))
        return CylinderEstimate(
            design.machine.joints[joint].name, names, nothing, np.full(len(names), np.inf), 0.0, in_situ, 0
        )
    # The recursion works on unit columns; the estimate is scaled back.
    scale = np.linalg.norm(own, axis=0)
    scale[scale == 0] = 1.0
    recursion = RecursiveLeastSquares(own.shape[1], forgetting=forgetting)
    if "m" in names and np.isfinite(prior.mass[joint]):
        row = np.zeros(own.shape[1])
        row[names.index("m")] = 1.0 / prior.std[joint] / scale[names.index("m")]
        recursion.update(row[None, :], np.array([prior.mass[joint] / prior.std[joint]]))
    for row, value in zip(own / scale, b, strict=True):
        recursion.update(row[None, :], np.array([value]))
    theta = recursion.theta / scale
    # Whitened rows have unit noise; the recursion's own covariance is scaled by its residual variance.
    spread = recursion.covariance / max(recursion.residual_std**2, 1e-30)
    covariance = spread / np.outer(scale, scale)
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
    )


def _rows(design: Design, noise: NoiseModel, joint: int, indices: tuple[int, ...]) -> tuple[FloatArray, FloatArray]:
    A, b = [np.zeros((0, len(design.parameters)))], [np.zeros(0)]
    for index in indices:
        block = design.blocks[joint][index]
        kept = noise.kept(joint, block.keep)
        A.append(noise.whiten(joint, block.reduced)[kept])
        b.append(noise.whiten(joint, block.reduced_target)[kept])
    return np.vstack(A), np.concatenate(b)
