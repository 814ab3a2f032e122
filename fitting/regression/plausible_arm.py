"""The plausible arm: a prior of the links and drives that is made from the machine file alone.

Least squares lets base parameters be any numbers. On a motion that does not determine all of them the next motion
pays for it. Here every link keeps a pseudo-inertia ``J_l`` (4 x 4, positive definite: a body that can exist), drawn
toward a plausible one ``J0_l`` by the entropic divergence, and no drive has a negative inertia, friction or stiffness::

    minimise  |A theta - b|^2 / 2  +  sum_i own_i f_i phi_i^2 / 2
              +  w sum_l [tr(J0_l^-1 J_l) - log det(J0_l^-1 J_l) - 4],      base parameters = P pi(J) + P_m phi_m

over the rows ``A, b`` of unit noise, the links' ``J_l``, the drives' parameters ``phi`` (``phi_m``: of motors that turn
with several joints) and whatever else has columns. ``own_i = sum_j |A_ij|^2 / |b_j|^2`` states that a contribution is
no larger than the joint's own effort; ``f_i`` is 1, and ``1 / r^2`` where a parameter that cannot be negative is below
zero. ``J0_l`` is a rod along the link; the mass of all rods together is what the measured efforts ask for.

A primal-dual interior-point method finds it: beside every link its dual ``Z_l`` (4 x 4, positive definite) with
``J Z = mu 1``, ``mu`` falling to ``w``. In the coordinates ``J = G (D + X) G'`` in which link and dual are the same
diagonal matrix ``D`` (Nesterov and Todd), a step is one least-squares problem in which the logarithm has the Hessian 1,
also where the rows press a link against what can exist. At the optimum, in ``J = L (1 + X) L'`` with ``L`` the root of
``J``, the divergence has the gradient ``L' J0^-1 L - 1`` and the Hessian 1, so the prior is, to second order, the
Gaussian that :meth:`Optimum.rows` gives as rows of unit noise; beside them plain least squares has the same solution,
and whatever is made of rows (evidence, intervals, predicted deviations) knows the prior.

Sources: Lee, Wensing and Park, IEEE T-RO 36 (2020) 318 (divergence); Wensing, Kim and Slotine, IEEE RA-L 3 (2018) 60
(pseudo-inertia); Nesterov and Todd, SIAM J. Optimization 8 (1998) 324 (scaling); Nocedal and Wright, *Numerical
Optimization*, 2006, 3.1 (line search), 14.2 (step to the boundary, how fast ``mu`` falls).
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
#: ``mu`` of the first step as a share of the slope in a link, and the share of the way to the boundary that is taken.
_FIRST, _SHARE = 1.0, 0.95


def _basis() -> FloatArray:
    """Return an orthonormal basis (10, 4, 4) of symmetric matrices."""
    out = np.zeros((10, 4, 4))
    for k, (i, j) in enumerate(zip(*np.triu_indices(4), strict=True)):
        out[k, i, j] = out[k, j, i] = 1.0 if i == j else np.sqrt(0.5)
    return out


def _of_body() -> FloatArray:
    """Compute a link's ten parameters from its pseudo-inertia by row: mass, first moments, ``tr(S) E - S``."""
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
    """Compute pseudo-inertias (n, 4, 4) of rods along the links, 1 kg together, each weighed by its length."""
    stretches = geometry.stretches
    sizes = [np.array([np.linalg.norm(end - start) for start, end in own]) for own in stretches]
    lengths = np.array([own.sum() for own in sizes])
    lengths = np.maximum(lengths, max(_LEAST_LENGTH * float(np.mean(lengths)), 1e-3))
    bodies = np.zeros((len(lengths), 4, 4))
    for body, own, size, length in zip(bodies, stretches, sizes, lengths, strict=True):
        shares = size / size.sum() if size.any() else np.ones(len(size)) / len(size)
        for (start, end), mass in zip(own, shares * length / lengths.sum(), strict=True):
            arm, thick = end - start, (_THICK * length) ** 2
            central = mass * ((arm @ arm / 12 + 2 * thick) * np.eye(3) - np.outer(arm, arm) / 12)
            body += pseudo_inertia(standard_of_link(mass, (start + end) / 2, central))
    return bodies


def standard_of_bodies(bodies: FloatArray) -> FloatArray:
    """Compute links' standard parameters (10 n,) from pseudo-inertias (n, 4, 4)."""
    return np.asarray((bodies.reshape(-1, 16) @ _OF_BODY.T).ravel())


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

    def optimum(self, A: FloatArray, b: FloatArray, start: Optimum | None = None, weight: float = WEIGHT) -> Optimum:
        """Find the most probable links and drives.

        Parameters
        ----------
        A, b : (R, p), (R,) rows of unit noise, or a triangle of them; drives, base, then free columns
        start : of rows that differ little
        weight : of the divergence
        """
        rest, free = A[:, : self.width], factor(A[:, self.width :]).Q if A.shape[1] > self.width else None
        both = np.column_stack([rest, b])
        if free is not None and free.shape[1]:
            both = both - free @ (free.T @ both)
        problem = _Problem(self, np.asarray(np.linalg.qr(both, mode="r")), weight)
        if start is None:
            state = problem.solved(_State(np.asarray(np.linalg.cholesky(self.bodies)), np.zeros(len(self.own))))
        else:
            state = problem.solved(_State(start.roots, start.phi))
        return Optimum(self, state.roots, state.phi, weight)

    def fields(self, roots: FloatArray) -> FloatArray:
        """Compute base parameters per ``X`` of each link in orthonormal basis, (nb, 10 n)."""
        bodies = roots[:, None] @ _BASIS @ roots[:, None].transpose(0, 1, 3, 2)
        links = bodies.reshape(-1, 10, 16) @ _OF_BODY.T
        of_links = self.regrouping[:, : 10 * len(roots)].reshape(-1, len(roots), 10).transpose(1, 0, 2)
        return np.asarray((of_links @ links.transpose(0, 2, 1)).transpose(1, 0, 2).reshape(-1, 10 * len(roots)))

    def slope(self, roots: FloatArray, weight: float, log: FloatArray) -> FloatArray:
        """Compute the divergence's weighted gradient in ``X`` of each link in orthonormal basis, (10 n,).

        ``log`` (n, 4) is that of the weighted logarithm of the determinant, which is diagonal in these coordinates.
        """
        own = weight * (roots.transpose(0, 2, 1) @ self.inverse @ roots) - log[:, :, None] * np.eye(4)
        return np.asarray(np.einsum("kij,lij->lk", _BASIS, own).ravel())

    @property
    def of_motors(self) -> FloatArray:
        """Base parameters per parameter of coupled motors, (nb, km)."""
        return self.regrouping[:, 10 * len(self.bodies) :]

    def theta(self, roots: FloatArray, phi: FloatArray) -> FloatArray:
        """Compute drives' and base parameters of links with these roots and drives."""
        bodies = roots @ roots.transpose(0, 2, 1)
        links = self.regrouping[:, : 10 * len(roots)] @ standard_of_bodies(bodies)
        return np.concatenate([phi[: self.drives], links + self.of_motors @ phi[self.drives :]])

    def precision(self, phi: FloatArray) -> FloatArray:
        """Return ``own f`` of every drive's parameter."""
        below = self.signed & (phi < 0)
        return np.asarray(self.own * np.where(below, self.below**-2, 1.0))


@dataclass(frozen=True)
class _State:
    roots: FloatArray
    phi: FloatArray


class _Problem:
    """One minimisation over a triangle ``[A b]`` of the drives' and base columns."""

    def __init__(self, arm: PlausibleArm, R: FloatArray, weight: float) -> None:
        self.arm, self.weight = arm, weight
        self.A, self.b = R[:, :-1], R[:, -1]
        self.of_phi = np.hstack([self.A[:, : arm.drives], self.A[:, arm.drives :] @ arm.of_motors])
        self.unit = np.where(arm.own > 0, 1.0 / np.sqrt(np.where(arm.own > 0, arm.own, 1.0)), 1.0)

    def cost(self, state: _State, mu: float) -> float:
        """Compute the objective, with its own weight of the log determinant."""
        missing = self.A @ self.arm.theta(state.roots, state.phi) - self.b
        own = state.roots.transpose(0, 2, 1) @ self.arm.inverse @ state.roots
        spread = self.weight * float(np.sum(np.trace(own, axis1=1, axis2=2) - 4.0))
        spread -= mu * float(np.sum(np.linalg.slogdet(own)[1]))
        precision = self.arm.precision(state.phi)
        return float(missing @ missing) / 2 + float(precision @ state.phi**2) / 2 + spread

    def solved(self, state: _State) -> _State:
        """Find the optimum, from any links and drives."""
        count, w, taken = len(state.roots), self.weight, 0.2
        slope = self._slope(state, state.roots, np.zeros((count, 4)))[1][: 10 * count].reshape(count, 10)
        mu = max(w, _FIRST * float(np.max(np.linalg.norm(slope, axis=1), initial=0.0)))
        inverse = np.linalg.inv(state.roots)
        dual = mu * inverse.transpose(0, 2, 1) @ inverse
        for _ in range(_STEPS):
            _, size, turn = np.linalg.svd(np.linalg.cholesky(dual).transpose(0, 2, 1) @ state.roots)
            G = state.roots @ turn.transpose(0, 2, 1) / np.sqrt(size)[:, None, :]
            D = size[:, :, None] * np.eye(4)
            # The better the last step kept to both cones, the faster mu may follow; where it hardly could, mu rises.
            follow = 0.1 if taken > 0.7 else 0.5 if taken > 0.3 else 1.0 if taken > 0.1 else 3.0
            mu = max(w, follow * float(np.mean(size**2))) if count else w
            cost = self.cost(state, mu)
            X, move, fall = self._step(state, G, mu / size)
            length, last = _inside(size, X), mu == w and not fall > _CONVERGED * (1.0 + abs(cost))
            while length > 1e-8:
                new = _State(G @ np.linalg.cholesky(D + length * X), state.phi + length * move)
                if last or self.cost(new, mu) <= cost - 1e-4 * length * fall:
                    break
                length /= 2
            else:
                return state
            if last:  # the step that is too small to be seen in the cost still squares the distance
                return new
            back = (mu / size - size)[:, :, None] * np.eye(4) - X
            along = _inside(size, back)
            inverse = np.linalg.inv(G)
            dual = inverse.transpose(0, 2, 1) @ (D + along * back) @ inverse
            state, taken = new, min(length, along)
        return state

    def _slope(self, state: _State, G: FloatArray, log: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Compute rows per ``X`` and scaled ``phi``, and the slope down; ``log`` as in :meth:`PlausibleArm.slope`."""
        arm = self.arm
        missing = self.A @ arm.theta(state.roots, state.phi) - self.b
        M = np.hstack([self.A[:, arm.drives :] @ arm.fields(G), self.of_phi * self.unit])
        known = arm.precision(state.phi) * state.phi * self.unit
        return M, -M.T @ missing - np.concatenate([arm.slope(G, self.weight, log), known])

    def _step(self, state: _State, G: FloatArray, log: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        """Compute the Newton step: ``X`` (n, 4, 4), change of ``phi``, and its promised descent."""
        M, down = self._slope(state, G, log)
        count = 10 * len(G)
        H = M.T @ M
        known = self.arm.precision(state.phi) * self.unit**2
        H[np.diag_indices(len(H))] += np.concatenate([np.ones(count), known])
        H[np.diag_indices(len(H))] += np.where(np.diag(H) > 0, 0.0, 1.0)  # a drive that no row shows remains at zero
        # Squaring costs digits of the step, none of the place that it goes to: there the slope itself vanishes.
        size = np.sqrt(np.diag(H))
        scaled = H / np.outer(size, size)
        scaled[np.diag_indices(len(H))] += _ROUNDING
        z = linalg.cho_solve(linalg.cho_factor(scaled, check_finite=False), down / size, check_finite=False) / size
        return (
            np.einsum("lk,kij->lij", z[:count].reshape(len(G), 10), _BASIS),
            z[count:] * self.unit,
            float(down @ z),
        )


def _inside(size: FloatArray, X: FloatArray) -> float:
    """Compute the share of step ``X`` from diagonal ``size`` that keeps positive definite, at most 1."""
    root = 1.0 / np.sqrt(size)
    lowest = float(np.min(np.linalg.eigvalsh(X * root[:, :, None] * root[:, None, :]), initial=0.0))
    return min(1.0, _SHARE / -lowest) if lowest < 0 else 1.0


@dataclass(frozen=True)
class Optimum:
    """Links and drives that rows and prior together find most probable.

    Attributes
    ----------
    arm : the prior
    roots : (n, 4, 4), pseudo-inertias are ``L L'``
    phi : (k,) drives' parameters, then those of coupled motors
    weight : of the divergence
    """

    arm: PlausibleArm
    roots: FloatArray
    phi: FloatArray
    weight: float

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
        return np.concatenate([standard_of_bodies(self.bodies), self.phi[self.arm.drives :]])

    @cached_property
    def rows(self) -> tuple[FloatArray, FloatArray]:
        """The prior about this point as rows of unit noise, (R, width) and (R,).

        ``beta ~ N(mu, P T T' P' / w + P_m diag(1 / (own f)) P_m')``, ``mu = beta* - P T g - P_m phi_m*``, and
        ``phi_i ~ N(0, 1 / (own_i f_i))`` of the drives.
        """
        arm, base = self.arm, self.theta[self.arm.drives :]
        fields = arm.fields(self.roots)
        g = arm.slope(self.roots, self.weight, np.full((len(self.roots), 4), self.weight))
        precision = arm.precision(self.phi)
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
    """Build the prior for efforts as they were measured.

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
    """Estimate all links' mass: the slope of efforts on those of the arm at 1 kg, beside the drives' columns."""
    standard = standard_of_bodies(bodies)
    u, b = rows[:, drives:-1] @ (base.regrouping[:, : len(standard)] @ standard), rows[:, -1]
    Q = factor(rows[:, :drives]).Q if drives else np.zeros((len(rows), 0))
    beside, target = u - Q @ (Q.T @ u), b - Q @ (Q.T @ b)
    size, square = float(np.linalg.norm(u)), float(beside @ beside)
    least = _LEAST_MASS * float(np.linalg.norm(b)) / size if size > 0 else 1.0
    return max(float(beside @ target) / square if square > 0 else 0.0, least, 1e-6)
