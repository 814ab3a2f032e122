"""How well a motion determines the base parameters, and the gradient of that with respect to the motion.

The information of a motion is ``G = W'W`` (efforts weighted alike); that of several motions is the sum. With
``C = D^-1/2 G D^-1/2``, ``D = diag G``, the condition number of the column-scaled observation matrix is
``sqrt(lambda_max(C) / lambda_min(C))``. It has kinks where eigenvalues meet, and the best motions are those
where they do; so what is minimised is a smooth bound of its logarithm,

    f_p = (log tr C^p + log tr C^-p) / (2 p)      >= log cond(W),   -> log cond(W) as p grows

or, for D-optimality, ``-log det G / (2 nb)``. The condition number does not care how large the signals are,
and alone it chooses slow motions with little to measure; a share of ``-log det D / (2 nb)``, the mean size of
the columns, is therefore added. The two together go over into D-optimality.

Derivatives: ``dG = dW'W + W'dW``, so with ``df = tr(M dG)``, ``df/dW = 2 W M``. ``W`` at a sample depends on that
sample's state only, so all samples' derivatives come from a few perturbed regressors per joint: differences,
exact in ``q''`` (linear) and ``q'`` (quadratic), good to 1e-8 in ``q``. (The adjoint recursion was tried:
three times the code, and no faster at the few hundred samples that are used here.)

Source: Swevers et al. 1997 (criteria); Boyd and Vandenberghe, *Convex Optimization*, A.4.1 (derivatives of
spectral functions).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from fitting.arm.dynamics import rigid_body_regressor, stacked
from fitting.arm.geometry import Geometry
from fitting.arrays import FloatArray, IntArray, unit_gram

Criterion = Literal["condition", "determinant"]

_STEP = 1e-4  # rad or m; a central difference of sines and products of sines is good to 1e-8
_PROBES = ((0, _STEP), (0, -_STEP), (1, 1.0), (1, -1.0), (2, 1.0))  # signal (q, q', q'') and by how much


def information(Y: FloatArray) -> FloatArray:
    """Compute ``W'W`` per sample, shape (nb, nb), of a regressor (N, n, nb)."""
    W = stacked(Y)
    return np.asarray(W.T @ W / Y.shape[0])


def condition_of_information(G: FloatArray) -> float:
    """Compute the column-scaled observation matrix's condition number, ``G = W'W``; infinite without rank."""
    values = np.linalg.eigvalsh(unit_gram(G)[0])
    return float(np.sqrt(values[-1] / values[0])) if values[0] > 1e-14 * values[-1] else float("inf")


def spectral_objective(
    G: FloatArray, criterion: Criterion, power: int, signal_share: float = 0.0
) -> tuple[float, FloatArray]:
    """Compute the criterion and its derivative ``M`` (symmetric, ``df = tr(M dG)``).

    Parameters
    ----------
    G : information, shape (nb, nb). Vanishing eigenvalues count as 1e-14 of the largest
    criterion : ``condition`` or ``determinant``
    power : ``p`` of the smooth condition number
    signal_share : share of the mean logarithm of the columns' sizes that is subtracted (``condition`` only)
    """
    size = len(G)
    scale = np.sqrt(np.maximum(np.diag(G), np.finfo(float).tiny))
    C = G / np.outer(scale, scale)
    values, vectors = np.linalg.eigh(C)
    values = np.maximum(values, 1e-14 * values[-1])
    if criterion == "determinant":
        value = -(np.log(values).sum() + 2 * np.log(scale).sum()) / (2 * size)
        # For log det the scaling drops out of the derivative.
        M = -(vectors / values) @ vectors.T / np.outer(scale, scale) / (2 * size)
        return float(value), np.asarray(M)
    up = (values / values[-1]) ** power
    down = (values[0] / values) ** power
    value = (np.log(values[-1] / values[0]) + (np.log(up.sum()) + np.log(down.sum())) / power) / 2
    value -= signal_share * np.log(scale).mean()
    slopes = (up / values / up.sum() - down / values / down.sum()) / 2  # df / d(lambda)
    M = (vectors * slopes) @ vectors.T / np.outer(scale, scale)
    # Through the scaling: dC_ij also holds -C_ij (dG_ii / G_ii + dG_jj / G_jj) / 2.
    M -= np.diag(((vectors**2) @ (slopes * values) + signal_share / (2 * size)) / scale**2)
    return float(value), np.asarray(M)


@dataclass(frozen=True)
class Probed:
    """A regressor ``Y`` (N, n, nb), and the same at perturbed states: all that derivatives at every sample need."""

    Y: FloatArray
    _perturbed: FloatArray  # (nb n, m probes, N)
    _moved: int

    def gradient(self, weight: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Differentiate ``sum(weight * Y)`` by every sample's state.

        Parameters
        ----------
        weight : shape (N, n, nb)

        Returns
        -------
        tuple of ndarray
            Derivatives with respect to ``q``, ``q'``, ``q''`` of the moved joints, each of shape (N, m).
        """
        samples = self.Y.shape[0]
        # The regressor's memory runs (column, joint, sample): contract in that order.
        against = np.ascontiguousarray(weight.transpose(2, 1, 0)).reshape(-1, samples)
        here = np.einsum("cs,cs->s", self.Y.transpose(2, 1, 0).reshape(-1, samples), against)
        values = np.einsum("cbs,cs->bs", self._perturbed, against).reshape(self._moved, len(_PROBES), samples)
        by_q = (values[:, 0] - values[:, 1]) / (2 * _STEP)
        by_qd = (values[:, 2] - values[:, 3]) / 2
        by_qdd = values[:, 4] - here
        return by_q.T, by_qd.T, by_qdd.T


def probed_regressor(
    geometry: Geometry,
    columns: IntArray,
    q: FloatArray,
    qd: FloatArray,
    qdd: FloatArray,
    moved: IntArray,
) -> Probed:
    """Compute the regressor with what its derivatives need, in one pass.

    Parameters
    ----------
    geometry : arm of ``n`` joints
    columns : the ``nb`` columns that are wanted
    q, qd, qdd : shape (N, n)
    moved : joints whose derivatives are wanted, ``m`` of them
    """
    samples = q.shape[0]
    states = np.tile(np.stack([q, qd, qdd]), (1, 1 + len(moved) * len(_PROBES), 1))
    for place, (j, (signal, step)) in enumerate((j, probe) for j in moved for probe in _PROBES):
        states[signal, (place + 1) * samples : (place + 2) * samples, j] += step
    together = rigid_body_regressor(geometry, *states, columns=columns).transpose(2, 1, 0)
    blocks = together.reshape(together.shape[0] * together.shape[1], -1, samples)
    Y = together[:, :, :samples].transpose(2, 1, 0)
    return Probed(Y, blocks[:, 1:], len(moved))
