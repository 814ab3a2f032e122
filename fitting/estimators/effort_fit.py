"""Least squares of joint efforts: every row of every joint counts alike, whatever the noise is like.

Rows are filtered joint efforts (N m or N) over all fitted recordings, ``unloaded`` ones at the joint's mean lever arm::

    r (p1 A1 - p2 A2 - c v)  =  r D_i(x, v, a) theta_i  +  Y_b(q, q', q'') beta  +  r E eta

What is minimised is what a user sees: the error of the effort. It does not ask for a right model, as weights by a noise
spectrum do. Rows are folded into one triangle per joint (:func:`fitting.regression.streamed.triangle`), so that
recordings of any length and any scale per joint are solved from it. Deviations are those of a sandwich (``hac``, see
:mod:`fitting.estimators.covariance`): the residual of a model that is not whole is neither white nor of one size.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt
from scipy import stats

from fitting.estimators.covariance import series_scores
from fitting.regression.design import Design, Extra
from fitting.regression.prior import Prior, prior_row
from fitting.regression.solving import Factor, Fit, factor
from fitting.regression.streamed import triangle

FloatArray = npt.NDArray[np.float64]


class EffortRows:
    """Joint-effort rows of some segments, as one triangle per joint.

    Attributes
    ----------
    triangles : per joint ``R`` (at most p + 1, p + 1) with ``R'R = [A b]'[A b]`` over its rows
    rows : (n,) how many rows each joint has
    """

    def __init__(self, design: Design, indices: Sequence[int], extra: Extra | None = None) -> None:
        self._design, self._indices, self._extra = design, tuple(indices), extra
        self._levers = mean_levers(design)
        joints = range(len(design.machine.joints))
        self.rows = np.zeros(len(joints), dtype=int)
        self.triangles = []
        for joint in joints:
            parts = []
            for A, b in self.parts(joint):
                self.rows[joint] += len(b)
                parts.append(np.column_stack([A, b]))
            self.triangles.append(triangle(parts))

    @property
    def columns(self) -> int:
        """Number of parameters: drive, base, effects."""
        return int(self.triangles[0].shape[1]) - 1

    def parts(self, joint: int) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Columns (M, p) and target (M,) of one joint, segment by segment, rows at rest left out."""
        design, extra = self._design, self._extra
        for index in self._indices:
            segment, block = design.segments[index], design.blocks[joint][index]
            r = segment.r[:, joint] if segment.loaded else np.full(len(segment), self._levers[joint])
            target, columns = block.effort(design.bank, r)
            if extra is not None and extra.names:
                own = extra.columns[joint][index]
                more = np.zeros((len(target), len(extra.names)))
                columns = np.hstack([columns, more if own is None else design.bank.reduce(own * r[:, None])])
            yield columns[block.keep], target[block.keep]

    def errors(self, theta: FloatArray) -> FloatArray:
        """Root mean square of each joint's error (n,), N m or N, not a number where a joint has no rows."""
        sums = np.array([np.sum((R[:, -1] - R[:, :-1] @ theta) ** 2) for R in self.triangles])
        return np.asarray(np.sqrt(sums / np.where(self.rows > 0, self.rows, np.nan)))

    def solve(self, prior: Prior, scale: FloatArray | None = None) -> tuple[FloatArray, Factor]:
        """Parameters (p,) of least squares with each joint's rows divided by ``scale`` (n,); ones if None."""
        joints = len(self.triangles)
        scale = np.ones(joints) if scale is None else scale
        stacked = np.vstack([R / s for R, s in zip(self.triangles, scale, strict=True)])
        theta = self._solved(stacked)[0]
        closing = self._prior_rows(prior, self.errors(theta) / scale)
        return self._solved(np.vstack([stacked, *closing])) if closing else self._solved(stacked)

    def _solved(self, stacked: FloatArray) -> tuple[FloatArray, Factor]:
        found = factor(stacked[:, :-1], 0 if self._extra is None else len(self._extra.names))
        return found.root @ (found.Q.T @ stacked[:, -1]), found

    def _prior_rows(self, prior: Prior, spread: FloatArray) -> list[FloatArray]:
        """Rows ``[A b]`` of what is known beforehand, in the unit of rows whose error is ``spread`` (n,)."""
        parameters, rows = self._design.parameters, []
        for joint, weight in enumerate(spread):
            row = prior_row(parameters, prior, joint, self.columns)
            if row is not None and np.isfinite(weight) and weight > 0:
                rows.append(weight * np.append(row[0], row[1])[None, :])
        return rows

    def fit(self, prior: Prior) -> Fit:
        """Least squares with equal weights, deviations of a sandwich."""
        theta, found = self.solve(prior)
        told = np.zeros(self.columns, dtype=bool)
        told[found.told] = True
        rng = np.random.default_rng(20)
        rank = found.root.shape[1]
        S, residual = np.zeros((rank, rank)), []
        for joint in range(len(self.triangles)):
            own = []
            for A, b in self.parts(joint):
                e = b - A @ theta
                own.append(e)
                if len(e):
                    S += series_scores(A @ found.root, e, "hac", rng)
            residual.append(np.concatenate(own) if own else np.zeros(0))
        count = int(self.rows.sum())
        S *= count / max(count - rank, 1)
        return Fit(
            theta=theta,
            covariance=found.root @ S @ found.root.T,
            told=told,
            orthonormal=tuple(np.zeros((len(e), 0)) for e in residual),
            residual=tuple(residual),
            condition_number=found.condition_number,
            extra_names=() if self._extra is None else self._extra.names,
        )


def mean_levers(design: Design) -> FloatArray:
    """Root mean square of each joint's lever arm over the loaded segments, (n,), m/rad; 1 where it has none."""
    joints = len(design.machine.joints)
    loaded = [s for s in design.segments if s.loaded]
    if not loaded:
        return np.ones(joints)
    squares = np.sum([np.sum(s.r**2, axis=0) for s in loaded], axis=0)
    return np.asarray(np.sqrt(squares / sum(len(s) for s in loaded)))


def parameter_error(rows: EffortRows, fit: Fit, floor: FloatArray, chance: float = 1e-3) -> float:
    """Error that the uncertainty of a fit's parameters makes on some rows at most, in noise floors.

    Root mean square over the joints of each joint's error in its floor. With ``C`` the covariance and ``X_j`` a joint's
    rows, its square is ``e' G e`` of a normal ``e``, ``G = C^(1/2)' (sum_j X_j'X_j / (N_j f_j^2 n)) C^(1/2)``: about a
    chi-square of ``tr(G)^2 / tr(G^2)`` degrees of freedom (Satterthwaite, Biometrics Bulletin 2, 1946).

    Parameters
    ----------
    rows : of the motion that is predicted
    fit : parameters and their covariance
    floor : (n,) noise floor of each joint
    chance : that a right fit exceeds it
    """
    there = [j for j, count in enumerate(rows.rows) if count and floor[j] > 0]
    if not there:
        return 0.0
    grams = [rows.triangles[j][:, :-1].T @ rows.triangles[j][:, :-1] / (rows.rows[j] * floor[j] ** 2) for j in there]
    G = fit.covariance @ (np.sum(grams, axis=0) / len(there))
    mean, square = float(np.trace(G)), float(np.sum(G * G.T))
    if not mean > 0 or not square > 0:
        return 0.0
    freedom = mean**2 / square
    return float(np.sqrt(mean * stats.chi2.isf(chance, freedom) / freedom))
