"""The plausible arm: a prior of the links and drives that is made from the machine file alone.

Least squares lets base parameters be any numbers. On a motion that does not tell all of them the next motion pays for
it. Here every link keeps a pseudo-inertia ``J_l`` (4 x 4, positive definite: a body that can exist), drawn toward a
plausible one ``J0_l`` by the entropic divergence, and no drive has a negative inertia, friction or stiffness::

    minimise  |A theta - b|^2 / 2  +  sum_i own_i f_i phi_i^2 / 2
              +  w sum_l [tr(J0_l^-1 J_l) - log det(J0_l^-1 J_l) - 4],      base parameters = P pi(J) + P_m phi_m

over the rows ``A, b`` of unit noise, the links' ``J_l``, the drives' parameters ``phi`` (``phi_m``: of motors that turn
with several joints) and whatever else has columns. ``own_i = sum_j |A_ij|^2 / |b_j|^2`` says that a contribution is no
larger than the joint's own effort; ``f_i`` is 1, and ``1 / r^2`` where a parameter that cannot be negative is below
zero. ``J0_l`` is a rod along the link; the mass of all rods together is what the measured efforts ask for.

Newton steps in ``J = L (1 + X) L'``, ``L`` the root of ``J``: in ``X`` the divergence has the gradient
``L' J0^-1 L - 1`` and the Hessian 1, so a step is one least-squares problem. At the optimum the prior is, to second
order, the Gaussian that :meth:`Optimum.rows` gives as rows of unit noise; beside them plain least squares has the same
solution, and whatever is made of rows (evidence, intervals, predicted deviations) knows the prior.

Sources: Lee, Wensing and Park, IEEE T-RO 36 (2020) 318 (divergence); Wensing, Kim and Slotine, IEEE RA-L 3 (2018) 60
(pseudo-inertia); Nocedal and Wright, *Numerical Optimization*, 2006, 3.1 (line search).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import linalg

from fitting.arm.base_parameters import BaseParameters
from fitting.arm.dynamics import standard_of_link
from fitting.arm.geometry import Geometry
from fitting.arrays import BoolArray, FloatArray
from fitting.regression.body_prior import pseudo_inertia
from fitting.regression.solving import factor

#: Weight of the divergence against a chi-square.
WEIGHT = 0.1
#: Weight that leaves of the divergence no more than that bodies exist.
ALONE = 1e-3
#: Standard deviation that a parameter below zero has, as a share of what the joint's own effort allows.
BELOW_ZERO = 0.003
#: Drives' parameters that cannot be negative.
NOT_NEGATIVE = frozenset({"J", "f_c", "f_v", "K"})
_THICK, _LEAST_LENGTH = 0.15, 0.2  # of a rod, as shares of its length and of the links' mean length
_LEAST_MASS = 0.3  # share of the efforts that the plausible arm explains at least
_STEPS, _CONVERGED, _ROUNDING = 60, 1e-10, 1e-13
#: Factor of the weight along the path, steps at each, what a step promises where it goes on, links where it begins.
_FACTOR, _ALONG, _NEAR, _HEAVY = 10.0, 8, 0.5, 100.0


def _basis() -> FloatArray:
    """Orthonormal basis (10, 4, 4) of the symmetric matrices."""
    out = np.zeros((10, 4, 4))
    for k, (i, j) in enumerate(zip(*np.triu_indices(4), strict=True)):
        out[k, i, j] = out[k, j, i] = 1.0 if i == j else np.sqrt(0.5)
    return out


def _of_body() -> FloatArray:
    """The ten parameters of a link from its pseudo-inertia, row by row: mass, first moments, ``tr(S) E - S``."""
    out = np.zeros((10, 4, 4))
    out[0, 3, 3] = 1.0
    for k in range(3):
        out[1 + k, k, 3] = out[1 + k, 3, k] = 0.5
    for k, (i, j) in enumerate(zip(*np.triu_indices(3), strict=True)):
        out[4 + k, i, j] -= 0.5
        out[4 + k, j, i] -= 0.5
        if i == j:
            out[4 + k, range(3), range(3)] += 1.0
    return out.reshape(10, 16)


_BASIS, _OF_BODY = _basis(), _of_body()


def rods(geometry: Geometry) -> FloatArray:
    """Pseudo-inertias (n, 4, 4) of rods along the links, 1 kg together, each as heavy as it is long."""
    starts, ends = geometry.ends
    lengths = np.linalg.norm(ends - starts, axis=1)
    lengths = np.maximum(lengths, max(_LEAST_LENGTH * float(np.mean(lengths)), 1e-3))
    bodies = []
    for start, end, length, mass in zip(starts, ends, lengths, lengths / lengths.sum(), strict=True):
        arm, thick = end - start, (_THICK * length) ** 2
        central = mass * ((arm @ arm / 12 + 2 * thick) * np.eye(3) - np.outer(arm, arm) / 12)
        bodies.append(pseudo_inertia(standard_of_link(mass, (start + end) / 2, central)))
    return np.array(bodies)


def link_map(root: FloatArray) -> FloatArray:
    """``pi_i`` (10,) from ``X`` (4, 4, row by row) with ``J = root X root'``: matrix (10, 16)."""
    return np.asarray(_OF_BODY @ np.kron(root, root))


@dataclass(frozen=True)
class PlausibleArm:
    """Prior of one machine's links and drives.

    Attributes
    ----------
    bodies : (n, 4, 4) pseudo-inertias of the plausible links
    own : (k,) precision of the drives' parameters, in the design's order, then of coupled motors; 0: nothing is known
    signed : (k,) True where a parameter cannot be negative
    drives : number of drive parameters before the base parameters
    regrouping : (nb, 10 n + motors) base parameters from standard ones
    below : standard deviation that a parameter below zero has, as a share of what ``own`` allows
    """

    bodies: FloatArray
    own: FloatArray
    signed: BoolArray
    drives: int
    regrouping: FloatArray
    below: float = BELOW_ZERO

    @property
    def width(self) -> int:
        """Number of columns that are drives' or base parameters'."""
        return self.drives + len(self.regrouping)

    @cached_property
    def inverse(self) -> FloatArray:
        """Inverses (n, 4, 4) of the plausible links' pseudo-inertias."""
        return np.asarray(np.linalg.inv(self.bodies))

    def optimum(
        self, A: FloatArray, b: FloatArray, start: Optimum | None = None, weight: float = WEIGHT, held: bool = True
    ) -> Optimum:
        """Most probable links and drives.

        Parameters
        ----------
        A, b : (R, p), (R,) rows of unit noise, or a triangle of them; drives, base, then free columns
        start : of rows that differ little
        weight : of the divergence
        held : whether parameters below zero are held there
        """
        rest, free = A[:, : self.width], factor(A[:, self.width :]).Q if A.shape[1] > self.width else None
        both = np.column_stack([rest, b])
        if free is not None and free.shape[1]:
            both = both - free @ (free.T @ both)
        problem = _Problem(self, np.asarray(np.linalg.qr(both, mode="r")), weight, held)
        if start is None:
            state = _State(np.sqrt(_HEAVY) * np.linalg.cholesky(self.bodies), np.zeros(len(self.own)))
            for barrier in problem.path(state):
                state = problem.solved(state, barrier, _NEAR * barrier)
        else:
            state = _State(start.roots, start.phi)
        state = problem.solved(state, weight)
        return Optimum(self, state.roots, state.phi, weight, held)

    def fields(self, roots: FloatArray) -> FloatArray:
        """Base parameters per ``X`` of every link in the orthonormal basis, (nb, 10 n)."""
        maps = [link_map(root) @ _BASIS.reshape(10, 16).T for root in roots]
        return np.hstack([self.regrouping[:, 10 * i : 10 * i + 10] @ T for i, T in enumerate(maps)])

    def slope(self, roots: FloatArray, weight: float, barrier: float) -> FloatArray:
        """Gradient of the weighted divergence in ``X`` of every link in the orthonormal basis, (10 n,)."""
        own = weight * (roots.transpose(0, 2, 1) @ self.inverse @ roots) - barrier * np.eye(4)
        return np.asarray(np.einsum("kij,lij->lk", _BASIS, own).ravel())

    @property
    def of_motors(self) -> FloatArray:
        """Base parameters per parameter of coupled motors, (nb, km)."""
        return self.regrouping[:, 10 * len(self.bodies) :]

    def theta(self, roots: FloatArray, phi: FloatArray) -> FloatArray:
        """Drives' and base parameters of links with these roots and of these drives."""
        bodies = roots @ roots.transpose(0, 2, 1)
        links = self.regrouping[:, : 10 * len(roots)] @ (bodies.reshape(-1, 16) @ _OF_BODY.T).ravel()
        return np.concatenate([phi[: self.drives], links + self.of_motors @ phi[self.drives :]])

    def precision(self, phi: FloatArray, held: bool) -> FloatArray:
        """``own f`` of every drive's parameter."""
        below = self.signed & (phi < 0) & held
        return np.asarray(self.own * np.where(below, self.below**-2, 1.0))


@dataclass(frozen=True)
class _State:
    roots: FloatArray
    phi: FloatArray


class _Problem:
    """One minimisation over a triangle ``[A b]`` of the drives' and base columns."""

    def __init__(self, arm: PlausibleArm, R: FloatArray, weight: float, held: bool) -> None:
        self.arm, self.weight, self.held = arm, weight, held
        self.A, self.b = R[:, :-1], R[:, -1]
        self.of_phi = np.hstack([self.A[:, : arm.drives], self.A[:, arm.drives :] @ arm.of_motors])
        self.unit = np.where(arm.own > 0, 1.0 / np.sqrt(np.where(arm.own > 0, arm.own, 1.0)), 1.0)

    def cost(self, state: _State, barrier: float) -> float:
        """The objective, with its own weight of the logarithm of the determinant."""
        missing = self.A @ self.arm.theta(state.roots, state.phi) - self.b
        own = state.roots.transpose(0, 2, 1) @ self.arm.inverse @ state.roots
        spread = self.weight * float(np.sum(np.trace(own, axis1=1, axis2=2) - 4.0))
        spread -= barrier * float(np.sum(np.linalg.slogdet(own)[1]))
        precision = self.arm.precision(state.phi, self.held)
        return float(missing @ missing) / 2 + float(precision @ state.phi**2) / 2 + spread

    def path(self, state: _State) -> list[float]:
        """Weights of the determinant by which the optimum is followed from a state down to its own weight (Nocedal and
        Wright, 19.6): near to a singular link a step is short, so links stay far from it until the rows ask for it.
        """
        first = self.cost(state, 0.0) / (10.0 * max(len(state.roots), 1))
        steps = int(np.ceil(np.log(max(first / self.weight, 1.0)) / np.log(_FACTOR)))
        return [self.weight * _FACTOR**k for k in range(steps, 0, -1)]

    def solved(self, state: _State, barrier: float, near: float = 0.0) -> _State:
        """Newton's method with a line search from a state, until a step promises no more than ``near``."""
        cost = self.cost(state, barrier)
        for _ in range(_ALONG if near else _STEPS):
            X, move, fall = self._step(state, barrier)
            if not fall > max(near, _CONVERGED * (1.0 + abs(cost))):
                break
            lowest = float(np.min(np.linalg.eigvalsh(X)))
            length = 1.0 if lowest > -0.9 else 0.9 / -lowest
            while length > 1e-8:
                roots = state.roots @ np.linalg.cholesky(np.eye(4) + length * X)
                new = _State(roots, state.phi + length * move)
                value = self.cost(new, barrier)
                if value <= cost - 1e-4 * length * fall:
                    break
                length /= 2
            else:
                break
            state, cost = new, value
        return state

    def _step(self, state: _State, barrier: float) -> tuple[FloatArray, FloatArray, float]:
        """Newton step: ``X`` (n, 4, 4), change of ``phi``, and what the slope along it promises."""
        arm = self.arm
        links = len(state.roots)
        missing = self.A @ arm.theta(state.roots, state.phi) - self.b
        g = arm.slope(state.roots, self.weight, barrier)
        root = np.sqrt(arm.precision(state.phi, self.held))
        M = np.hstack([self.A[:, arm.drives :] @ arm.fields(state.roots), self.of_phi * self.unit])
        count = 10 * links
        H = M.T @ M
        H[np.diag_indices(len(H))] += np.concatenate([np.full(count, barrier), (root * self.unit) ** 2])
        H[np.diag_indices(len(H))] += np.where(np.diag(H) > 0, 0.0, 1.0)  # a drive that no row shows stays at zero
        down = -M.T @ missing - np.concatenate([g, root**2 * state.phi * self.unit])
        # Squaring costs digits of the step, none of the place that it goes to: there the slope itself vanishes.
        size = np.sqrt(np.diag(H))
        scaled = H / np.outer(size, size)
        scaled[np.diag_indices(len(H))] += _ROUNDING
        z = linalg.cho_solve(linalg.cho_factor(scaled, check_finite=False), down / size, check_finite=False) / size
        return (
            np.einsum("lk,kij->lij", z[:count].reshape(links, 10), _BASIS),
            z[count:] * self.unit,
            float(down @ z),
        )


@dataclass(frozen=True)
class Optimum:
    """Links and drives that rows and prior together find most probable.

    Attributes
    ----------
    arm : the prior
    roots : (n, 4, 4) lower triangular, pseudo-inertias are ``L L'``
    phi : (k,) drives' parameters, then those of coupled motors
    weight : of the divergence
    held : whether parameters below zero were held
    """

    arm: PlausibleArm
    roots: FloatArray
    phi: FloatArray
    weight: float
    held: bool

    @property
    def theta(self) -> FloatArray:
        """Drives' and base parameters, (width,)."""
        return self.arm.theta(self.roots, self.phi)

    @property
    def bodies(self) -> FloatArray:
        """Pseudo-inertias (n, 4, 4) of the links."""
        return np.asarray(self.roots @ self.roots.transpose(0, 2, 1))

    @property
    def standard(self) -> FloatArray:
        """Standard parameters: ten of each link, then those of coupled motors."""
        links = (self.bodies.reshape(-1, 16) @ _OF_BODY.T).ravel()
        return np.concatenate([links, self.phi[self.arm.drives :]])

    @cached_property
    def rows(self) -> tuple[FloatArray, FloatArray]:
        """The prior about this point as rows of unit noise, (R, width) and (R,).

        ``beta ~ N(mu, P T T' P' / w + P_m diag(1 / (own f)) P_m')``, ``mu = beta* - P T g - P_m phi_m*``, and
        ``phi_i ~ N(0, 1 / (own_i f_i))`` of the drives.
        """
        arm, base = self.arm, self.theta[self.arm.drives :]
        fields = arm.fields(self.roots)
        g = arm.slope(self.roots, self.weight, self.weight)
        precision = arm.precision(self.phi, self.held)
        own, motors = precision[: arm.drives], precision[arm.drives :]
        known = motors > 0
        spread = arm.of_motors[:, known] / np.sqrt(motors[known])
        C = fields @ fields.T / self.weight + spread @ spread.T
        mean = base - fields @ g / self.weight - arm.of_motors @ self.phi[arm.drives :]
        size = np.sqrt(np.diag(C))
        root = linalg.cholesky(C / np.outer(size, size) + 1e-14 * np.eye(len(C)), lower=True)
        of_base = linalg.solve_triangular(root, np.diag(1.0 / size), lower=True)
        A = np.zeros((np.count_nonzero(own) + len(C), arm.width))
        A[np.arange(np.count_nonzero(own)), np.flatnonzero(own)] = np.sqrt(own[own > 0])
        A[np.count_nonzero(own) :, arm.drives :] = of_base
        return A, np.concatenate([np.zeros(np.count_nonzero(own)), of_base @ mean])


def plausible_arm(
    geometry: Geometry,
    base: BaseParameters,
    drives: Sequence[str],
    triangles: Sequence[FloatArray],
    drawing: FloatArray | None = None,
) -> PlausibleArm:
    """The prior for efforts as they were measured.

    Parameters
    ----------
    geometry, base : the arm
    drives : names of the drives' parameters, whose columns come first
    triangles : per joint a triangle (.., p + 1) of its effort rows ``[A b]``, N m or N
    drawing : (n, 4, 4) pseudo-inertias of links from drawings; rods along the links if None
    """
    count = len(drives)
    width = count + len(base)
    motors = base.regrouping[:, base.inertial_columns :]
    own = np.zeros(count + motors.shape[1])
    for R in triangles:
        effort = float(np.linalg.norm(R[:, width]))
        if effort > 0:
            columns = np.hstack([R[:, :count], R[:, count:width] @ motors])
            own += np.sum(columns**2, axis=0) / effort**2
    names = [*drives, *(("f_c", "f_v", "J") * (motors.shape[1] // 3))]
    signed = np.array([name in NOT_NEGATIVE for name in names], dtype=bool)
    bodies = drawing
    if bodies is None:
        bodies = rods(geometry) if base.inertial_columns else np.zeros((0, 4, 4))
        bodies = bodies * (_mass(base, bodies, count, np.vstack(triangles)[:, : width + 1]) if len(bodies) else 1.0)
    return PlausibleArm(bodies, own, signed, count, base.regrouping)


def _mass(base: BaseParameters, bodies: FloatArray, drives: int, rows: FloatArray) -> float:
    """Mass of all links together: the slope of the efforts on those of the arm at 1 kg, beside the drives' columns."""
    standard = (bodies.reshape(-1, 16) @ _OF_BODY.T).ravel()
    u, b = rows[:, drives:-1] @ (base.regrouping[:, : len(standard)] @ standard), rows[:, -1]
    Q = factor(rows[:, :drives]).Q if drives else np.zeros((len(rows), 0))
    beside, target = u - Q @ (Q.T @ u), b - Q @ (Q.T @ b)
    size, square = float(np.linalg.norm(u)), float(beside @ beside)
    least = _LEAST_MASS * float(np.linalg.norm(b)) / size if size > 0 else 1.0
    return max(float(beside @ target) / square if square > 0 else 0.0, least, 1e-6)
