"""Physically consistent base parameters: those of bodies that can exist, and as near to the rows as such can be.

Least squares knows nothing of bodies; with noise it gives links whose inertia no distribution of mass has, and a
simulator or controller built on them can do the impossible. Here every link's pseudo-inertia is kept positive
definite (a linear matrix inequality) while the distance to the rows is minimised::

    minimise  |R (P pi) - z|^2 + gamma sum_i (tr J0_i^-1 J_i - log det J0_i^-1 J_i),    J_i(pi) > 0,   i = 1..n,

``P`` the regrouping from standard to base parameters, ``R, z`` what the rows say
(:mod:`fitting.estimators.information`), ``J0_i`` a body of the link's size. ``R`` and ``z`` have the covariance of
coloured residuals in them, so the distance is a chi-square: the price of consistency. The second term, with a ``gamma``
of a thousandth, weighs nothing against a chi-square; it keeps the links strictly inside what is possible, and of all
standard parameters that have the same base parameters it picks those nearest to the ``J0_i``. That choice is a belief,
not a measurement; a drawing given as prior takes the place of the ``J0_i``.

The covariance is that of the unconstrained fit: on the boundary it is too large rather than too small.

Sources: Sousa and Cortesao, Int. J. Robotics Research 33 (2014) 931 (base parameters and inequalities); Wensing, Kim
and Slotine, IEEE RA-L 3 (2018) 60 (pseudo-inertia); Lee, Wensing and Park, IEEE T-RO 36 (2020) 318 (divergence).
"""

from __future__ import annotations

import importlib.util
import warnings
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from daq.errors import HilfitError, InputError
from fitting.arm.base_parameters import BaseParameters
from fitting.arm.geometry import Geometry
from fitting.estimators.base import Estimate, FloatArray, check_rows
from fitting.estimators.context import StageTwo
from fitting.estimators.covariance import Colour
from fitting.estimators.information import Information, information
from fitting.estimators.least_squares import group_std
from fitting.estimators.weighted import weighted_by_group
from fitting.regression.body_prior import BodyPrior, pseudo_inertia, standard_of_link

#: Weights of the divergence against a chi-square, tried in turn: rows far from all bodies take a larger one to solve.
GAMMA = (1e-3, 1e-2, 1e-1, 1.0, 1e1, 1e2)
_RADIUS = 0.15  # of a scale body, as a share of the link's length


@dataclass(frozen=True)
class ConsistentFit:
    """Weighted least squares under the inequalities of all links.

    Attributes
    ----------
    base : base parameters that the columns belong to; None for no inequalities, which is weighted least squares
    geometry : the arm; its link lengths give the inequalities their scale
    prior : a drawing to choose the standard parameters by, or None
    colour : as in :class:`fitting.estimators.ordinary.OrdinaryLeastSquares`
    """

    base: BaseParameters | None = None
    geometry: Geometry | None = None
    prior: BodyPrior | None = None
    colour: Colour = "white"

    @property
    def name(self) -> str:
        """``consistent``."""
        return "consistent"

    def within(self, stage: StageTwo) -> ConsistentFit:
        """The same for the links of the stage's arm.

        Raises
        ------
        InputError
            If the solver is not installed.
        """
        missing = [name for name in ("cvxpy", "clarabel") if importlib.util.find_spec(name) is None]
        if missing:
            raise InputError(
                f"estimator 'consistent' needs {' and '.join(missing)}: install with pip install 'hilfit[consistent]'"
            )
        return replace(self, base=stage.base, geometry=stage.geometry, prior=stage.prior, colour=stage.colour)

    def fit(
        self,
        A: npt.ArrayLike,
        b: npt.ArrayLike,
        *,
        groups: npt.ArrayLike | None = None,
        weights: npt.ArrayLike | None = None,
    ) -> Estimate:
        """Fit rows; see :class:`fitting.estimators.base.Estimator`.

        ``details`` hold the price (``chi_square_price`` and the rise of each group's error in percent), the parameters
        that a constraint moved in standard deviations, and ``standard_parameters`` by name.

        Raises
        ------
        HilfitError
            If the solver finds no solution.
        """
        rows = weighted_by_group(check_rows(A, b, groups, weights))
        data = information(rows, self.colour)
        counted = rows.weights > 0
        leverage = data.solution.leverage[counted]

        def spread(theta: FloatArray) -> FloatArray:
            plain = (rows.b - rows.A @ theta)[counted]
            return group_std(plain, leverage, rows.group[counted], len(rows.labels))

        free = data.solution.theta
        theta, details = free, {}
        if self.base is not None and self.geometry is not None:
            if len(self.base) != len(free):
                raise ValueError(f"there are {len(self.base)} base parameters, the regressor has {len(free)} columns")
            bodies = scale_bodies(self.geometry, self.base, free, self.prior)
            standard = standard_parameters(data.rows, data.target, self.base, bodies)
            theta = self.base.regrouping @ standard
            details = _details(data, self.base, theta, standard)
            details["error_rise_percent"] = (100.0 * (spread(theta) / spread(free) - 1.0)).tolist()
        return Estimate(
            theta=theta,
            covariance=data.covariance,
            residual_std=spread(theta),
            groups=rows.labels,
            condition_number=data.solution.condition_number,
            told=data.solution.told,
            details=details,
        )


def _details(data: Information, base: BaseParameters, theta: FloatArray, standard: FloatArray) -> dict[str, Any]:
    free, std = data.solution.theta, np.sqrt(np.diag(data.covariance))
    moved = np.where(np.isfinite(std) & (std > 0), (theta - free) / np.where(std > 0, std, 1.0), 0.0)
    return {
        "chi_square_price": float(
            np.sum((data.rows @ theta - data.target) ** 2) - np.sum((data.rows @ free - data.target) ** 2)
        ),
        "moved_sigmas": {n: float(m) for n, m in zip(base.names, moved, strict=True)},
        "standard_parameters": {n: float(v) for n, v in zip(base.standard_names, standard, strict=True)},
        "smallest_eigenvalue": float(min(np.linalg.eigvalsh(pseudo_inertia(link)).min() for link in _links(standard))),
    }


def _links(standard: FloatArray) -> FloatArray:
    return standard[: len(standard) // 10 * 10].reshape(-1, 10)


def scale_bodies(geometry: Geometry, base: BaseParameters, theta: FloatArray, prior: BodyPrior | None) -> FloatArray:
    """Pseudo-inertias (n, 4, 4) of bodies of the links' size: a drawing's, or rods along the links.

    The rods' lengths are those of the table; one mass per length is common to all, the largest that a base parameter
    ``theta`` (nb,) asks for. Only orders of magnitude matter: they scale inequalities, and pick one of many answers.
    """
    links = base.inertial_columns // 10
    if prior is not None and prior.standard is not None:
        return np.array([pseudo_inertia(row) for row in prior.standard.reshape(-1, 10)])
    starts, ends = geometry.ends
    lengths = np.linalg.norm(ends - starts, axis=1)
    lengths = np.maximum(lengths, max(0.2 * float(np.mean(lengths)), 1e-3))
    mass = 0.0
    for column, value, unit in zip(base.independent, theta, base.units, strict=True):
        if column < base.inertial_columns:
            reach = lengths[column // 10] ** {"kg": 0, "kg m": 1, "kg m^2": 2}[unit]
            mass = max(mass, abs(float(value)) / reach)
    share = max(mass, 1e-3) * lengths / lengths.sum()
    bodies = []
    for i in range(links):
        arm = ends[i] - starts[i]
        thick = (_RADIUS * lengths[i]) ** 2
        central = share[i] * ((arm @ arm / 12 + 2 * thick) * np.eye(3) - np.outer(arm, arm) / 12)
        middle = (starts[i] + ends[i]) / 2
        bodies.append(pseudo_inertia(standard_of_link(share[i], middle, central[np.triu_indices(3)])))
    return np.array(bodies)


def standard_parameters(
    rows: FloatArray, target: FloatArray, base: BaseParameters, bodies: FloatArray, *, exactly: bool = False
) -> FloatArray:
    """Standard parameters (p,) of links that can exist, near to ``rows base = target`` of unit noise.

    Parameters
    ----------
    bodies : (n, 4, 4) pseudo-inertias that are the scale, and the choice among equals (:func:`scale_bodies`)
    exactly : True asks for those that keep the rows to the digit

    Raises
    ------
    HilfitError
        If the solver finds none; with ``exactly`` there may be none.
    """
    import cvxpy as cp

    variables = [cp.Variable((4, 4), PSD=True) for _ in bodies]
    parts = [
        link_map(root) @ cp.vec(X, order="C") for root, X in zip(np.linalg.cholesky(bodies), variables, strict=True)
    ]
    motors = base.regrouping.shape[1] - 10 * len(bodies)
    if motors:  # friction and drive inertia of motors: not negative
        parts.append(cp.Variable(motors, nonneg=True))
    pi = cp.hstack(parts)
    # Columns at unit norm: base parameters differ by the fifth power of a link's length.
    size = np.linalg.norm(rows, axis=0)
    size[size == 0] = 1.0
    missing = (rows / size) @ ((base.regrouping * size[:, None]) @ pi) - target
    divergence = sum(cp.trace(X) - cp.log_det(X) for X in variables)
    said = "none"
    for gamma in GAMMA[:1] if exactly else GAMMA:
        goal = divergence if exactly else cp.sum_squares(missing) / gamma + divergence
        problem = cp.Problem(cp.Minimize(goal), [missing == 0] if exactly else [])
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # an inaccurate solution is said by the status, which is looked at
                problem.solve(solver=cp.CLARABEL)
        except cp.SolverError as error:
            said = str(error)
            continue
        said = problem.status
        if said == "optimal":
            return np.asarray(pi.value)
    raise HilfitError(f"estimator 'consistent': the solver gave up ({said}); use 'wls'")


def link_map(root: FloatArray) -> FloatArray:
    """``pi_i`` (10,) from ``X`` (4, 4, row by row) with ``J = root X root'``: matrix (10, 16)."""
    columns = []
    for k in range(16):
        X = np.zeros(16)
        X[k] = 1.0
        J = root @ X.reshape(4, 4) @ root.T
        J = (J + J.T) / 2
        inertia = np.trace(J[:3, :3]) * np.eye(3) - J[:3, :3]
        columns.append([J[3, 3], *J[:3, 3], *inertia[np.triu_indices(3)]])
    return np.array(columns).T
