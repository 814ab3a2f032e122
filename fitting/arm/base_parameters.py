"""Base parameters: the combinations of standard parameters that joint efforts determine at all.

Columns of the regressor that vanish for every motion are dropped; columns that are combinations of others are
regrouped: ``tau = Y pi = Y_independent (P pi)`` with ``P`` the regrouping matrix. Which columns those are is
found numerically, from the regressor at random states within the machine's limits.

Which of a dependent group is kept is a choice. Columns are offered kind by kind, base to tip, and one is kept
if it adds to those kept before. The order is Gautier and Khalil's: of a link on a revolute joint first the
inertia about the joint's axis, the first moments across it, the other inertias, and last what their rules
regroup away (``YY``, ``MZ`` and ``m`` where the axis is ``z``). In the distal convention the joint's axis is
fixed in the link as ``(0, sin alpha, cos alpha)``: ``z`` for parallel axes, ``y`` for a twist of 90 degrees,
where ``ZZ``, ``MY`` and ``m`` come last; in the modified one it is always ``z``. A link on a prismatic joint
offers its mass first. Friction and drive inertia come at the end.

Rank decision: columns scaled to unit norm; a column whose part outside the span of the kept ones is below
:data:`RANK_TOLERANCE` of it is dependent. Round-off leaves 1e-15 to 1e-13, geometry (the smallest link offset
over the reach, squared) 1e-5 and more; the two numbers nearest to the tolerance are kept in ``gap``.

Sources: Gautier, "Numerical calculation of the base inertial parameters of robots", J. Robotic Systems 8,
1991 (QR); Gautier and Khalil, "Direct calculation of minimum set of inertial parameters of serial robots",
IEEE T-RA 6, 1990.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from daq.machine.machine_file import Machine
from fitting.arm.dynamics import (
    COUPLED_PARAMETERS,
    JOINT_PARAMETERS,
    coupled_regressor,
    rigid_body_regressor,
    stacked,
    standard_regressor,
)
from fitting.arm.geometry import Geometry, geometry_of
from fitting.arrays import BoolArray, FloatArray, IntArray

RANK_TOLERANCE = 1e-8
_SYMBOLS = ("m", "MX", "MY", "MZ", "XX", "XY", "XZ", "YY", "YZ", "ZZ", "f_c", "f_v", "J")
_ABOUT_Z = ("ZZ", "MX", "MY", "XX", "XY", "XZ", "YZ", "YY", "MZ", "m", "f_c", "f_v", "J")
_ABOUT_Y = ("YY", "MX", "MZ", "XX", "XY", "XZ", "YZ", "ZZ", "MY", "m", "f_c", "f_v", "J")
_SLIDING = ("m", "MX", "MY", "MZ", "XX", "XY", "XZ", "YZ", "YY", "ZZ", "f_c", "f_v", "J")
_READING_ORDER = ("XX", "XY", "XZ", "YY", "YZ", "ZZ", "MX", "MY", "MZ", "m", "f_c", "f_v", "J")


@dataclass(frozen=True)
class BaseParameters:
    """An identifiable set of ``nb`` parameters out of ``p`` standard ones.

    Attributes
    ----------
    independent : shape (nb,), indices of the kept columns among the ``p`` standard ones, link by link
    regrouping : shape (nb, p): ``base = regrouping @ pi``. The identity at the kept columns
    names : name of each base parameter: that of its kept column (``ZZ2``)
    expressions : what each one is: ``ZZ2 + 0.5824 (m3 + m4)``. Coefficients in SI, four digits; ``regrouping`` has them
        all
    units : unit of each base parameter
    standard_names : names of the ``p`` standard parameters (``ZZ2``, ``f_c2``, ...)
    standard_count : how many standard parameters the machine has: 13 per joint, or 10 where only inertial ones were
        asked for
    vanished : names of the standard parameters that no motion determines
    gap : largest remainder that was taken for round-off, and smallest that was taken for independence
    """

    independent: IntArray
    regrouping: FloatArray
    names: tuple[str, ...]
    expressions: tuple[str, ...]
    units: tuple[str, ...]
    standard_names: tuple[str, ...]
    standard_count: int
    vanished: tuple[str, ...]
    gap: tuple[float, float]

    def __len__(self) -> int:
        return len(self.names)

    @property
    def inertial_columns(self) -> int:
        """Number of standard parameters of the links (``10 n``), 0 where joints' own friction is among them."""
        inertias = sum(name.startswith("ZZ") for name in self.standard_names)
        return 0 if "f_c1" in self.standard_names else 10 * inertias

    @property
    def only_rigid_body(self) -> bool:
        """True where friction and drive inertia are not among the standard parameters (``p = 10 n``)."""
        return len(self.standard_names) == self.inertial_columns

    def regressor(self, Y: FloatArray) -> FloatArray:
        """Keep the base columns of a standard regressor, shape (..., p) to (..., nb).

        Raises
        ------
        ValueError
            If ``Y`` does not have the ``p`` columns that this set was reduced from.
        """
        if Y.shape[-1] != self.regrouping.shape[1]:
            raise ValueError(f"the regressor has {Y.shape[-1]} columns, these parameters {self.regrouping.shape[1]}")
        return Y[..., self.independent]

    def from_standard(self, pi: npt.ArrayLike) -> FloatArray:
        """Compute base parameters of standard parameters ``pi``, (p,) or (n, p / n)."""
        return np.asarray(self.regrouping @ np.asarray(pi, dtype=float).ravel())

    def standard_example(self, base: npt.ArrayLike) -> FloatArray:
        """Return one ``pi`` (p,) with these base parameters: each on its kept column, the rest zero.

        Enough to compute efforts; the numbers themselves are no link's mass or inertia.
        """
        pi = np.zeros(self.regrouping.shape[1])
        pi[self.independent] = np.asarray(base, dtype=float)
        return pi


def base_regressor(
    machine: Machine | Geometry,
    base: BaseParameters,
    q: npt.ArrayLike,
    qd: npt.ArrayLike,
    qdd: npt.ArrayLike,
    *,
    gravity: npt.ArrayLike | None = None,
    speed_noise: npt.ArrayLike | None = None,
) -> FloatArray:
    """Compute the regressor of the base parameters, shape (N, n, nb); only the kept columns.

    Arguments as in :func:`fitting.arm.dynamics.rigid_body_regressor`; ``speed_noise`` (n,) is that of the joints'
    speeds, for the sign of a coupled motor's speed.
    """
    links = base.inertial_columns
    if not links:
        return base.regressor(standard_regressor(machine, q, qd, qdd, gravity=gravity))
    inertial = base.independent[base.independent < links]
    Y = rigid_body_regressor(machine, q, qd, qdd, columns=inertial, gravity=gravity)
    if len(inertial) == len(base):
        return Y
    motors = coupled_regressor(machine, qd, qdd, speed_noise=speed_noise)[
        ..., base.independent[len(inertial) :] - links
    ]
    # Joined where memory runs along the samples, so that stacking remains free.
    return np.concatenate([Y.transpose(2, 1, 0), motors.transpose(2, 1, 0)]).transpose(2, 1, 0)


def base_gravity_regressor(
    machine: Machine | Geometry, base: BaseParameters, q: npt.ArrayLike, direction: npt.ArrayLike
) -> FloatArray:
    """Compute what a unit change of gravity adds to :func:`base_regressor`, (N, n, nb); not to a motor's columns.

    The regressor is linear in gravity. A base that tilts by small angles ``t`` (rad, about the axis ``k``) changes
    gravity by ``-t k x g``. ``direction`` is in the base frame, (3,) or (N, 3), in units of choice.
    """
    inertial = base.independent[base.independent < base.inertial_columns]
    still = np.zeros(np.shape(np.asarray(q, dtype=float)))
    Y = rigid_body_regressor(machine, q, still, still, columns=inertial, gravity=direction)
    missing = np.zeros((*Y.shape[:2], len(base) - len(inertial)))
    return np.concatenate([Y, missing], axis=2) if missing.size else Y


def reduce_parameters(
    machine: Machine | Geometry, *, friction_by_stage_1: bool = True, seed: int = 0
) -> BaseParameters:
    """Find the base parameters of a machine.

    Parameters
    ----------
    machine : arm of ``n`` joints
    friction_by_stage_1 : True: friction and drive inertia are known from the cylinders, and ``p = 10 n`` inertial
        parameters are reduced. False: all ``p = 13 n``. Three more for every motor that turns with several joints, in
        both
    seed : of the random states
    """
    geometry = geometry_of(machine).squared_up()
    n = geometry.joints
    kinds = 10 if friction_by_stage_1 else 13
    names = (
        *(f"{symbol}{i + 1}" for i in range(n) for symbol in _SYMBOLS[:kinds]),
        *(f"{symbol}{i + 1}" for i in geometry.coupled for symbol in COUPLED_PARAMETERS),
    )
    W = _random_observation(geometry, kinds, np.random.default_rng(seed), max(60, 5 * kinds))
    norms = np.linalg.norm(W, axis=0)
    alive = norms > RANK_TOLERANCE * norms.max()
    order = [column for column in _offered(geometry, kinds) if alive[column]]
    kept, gap = _independent(W[:, order] / norms[order])
    independent = np.array(sorted((order[k] for k in kept), key=lambda column: _reading_key(column, kinds, n)))
    regrouping = _regrouping(W, norms, alive, independent)
    expressions = tuple(_expression(row, int(i), names) for row, i in zip(regrouping, independent, strict=True))
    return BaseParameters(
        independent=independent.astype(np.intp),
        regrouping=regrouping,
        names=tuple(names[i] for i in independent),
        expressions=expressions,
        units=tuple(_unit(int(i), kinds, geometry) for i in independent),
        standard_names=names,
        standard_count=13 * n + 3 * len(geometry.coupled),
        vanished=tuple(name for name, there in zip(names, alive, strict=True) if not there),
        gap=gap,
    )


def _offered(geometry: Geometry, kinds: int) -> list[int]:
    """List all columns in the order in which they are offered to the reduction."""
    orders = []
    for i in range(geometry.joints):
        if not geometry.revolute[i]:
            orders.append(_SLIDING)
        else:
            orders.append(_ABOUT_Y if abs(geometry.axes[i, 1]) > abs(geometry.axes[i, 2]) else _ABOUT_Z)
    own = [
        i * kinds + _SYMBOLS.index(order[place])
        for place in range(len(_SYMBOLS))
        for i, order in enumerate(orders)
        if _SYMBOLS.index(order[place]) < kinds
    ]
    return own + [kinds * geometry.joints + k for k in range(3 * len(geometry.coupled))]


def _random_observation(geometry: Geometry, kinds: int, rng: np.random.Generator, states: int) -> FloatArray:
    """Stack the regressor at random states, each kind of motion brought to a like size.

    Speeds and accelerations are drawn at unit size, not at the machine's: what is identifiable in principle does
    not depend on how slow the arm is, and small numbers would blur the rank.
    """
    n = geometry.joints
    low, high = geometry.position_limits.T
    q = rng.uniform(low, high, (states, n))
    qd, qdd = rng.uniform(-2.0, 2.0, (2, states, n))
    if kinds == 10:
        own = stacked(rigid_body_regressor(geometry, q, qd, qdd))
        return np.hstack([own, stacked(coupled_regressor(geometry, qd, qdd))]) if geometry.coupled else own
    return stacked(standard_regressor(geometry, q, qd, qdd))


def _independent(W: FloatArray) -> tuple[list[int], tuple[float, float]]:
    """Find columns of ``W`` (unit norms), in order, that are independent of kept ones before; and the gap.

    Gram-Schmidt, each column orthogonalised twice (twice is enough for full precision: Kahan and Parlett).
    """
    basis = np.zeros((W.shape[0], 0), order="F")
    kept: list[int] = []
    largest_dependent, smallest_independent = 0.0, 1.0
    for k in range(W.shape[1]):
        rest = W[:, k] - basis @ (basis.T @ W[:, k])
        rest = rest - basis @ (basis.T @ rest)
        remainder = float(np.linalg.norm(rest))
        if remainder > RANK_TOLERANCE:
            kept.append(k)
            basis = np.column_stack([basis, rest / remainder])
            smallest_independent = min(smallest_independent, remainder)
        else:
            largest_dependent = max(largest_dependent, remainder)
    return kept, (largest_dependent, smallest_independent)


def _regrouping(W: FloatArray, norms: FloatArray, alive: BoolArray, independent: IntArray) -> FloatArray:
    dependent = np.array([k for k in np.flatnonzero(alive) if k not in set(independent.tolist())], dtype=np.intp)
    P = np.zeros((len(independent), W.shape[1]))
    P[np.arange(len(independent)), independent] = 1.0
    if dependent.size:
        scaled = np.linalg.lstsq(
            W[:, independent] / norms[independent], W[:, dependent] / norms[dependent], rcond=None
        )[0]
        scaled[np.abs(scaled) < 1e-9] = 0.0
        coefficients = scaled * norms[dependent] / norms[independent][:, None]
        whole = np.round(coefficients)
        P[:, dependent] = np.where(np.abs(coefficients - whole) < 1e-10, whole, coefficients)
    return P


def _reading_key(column: int, kinds: int, joints: int) -> tuple[int, int]:
    if column >= kinds * joints:  # a motor's: last, in order
        return joints, column
    link, parameter = divmod(column, kinds)
    return link, _READING_ORDER.index(_SYMBOLS[parameter])


def _expression(row: FloatArray, own: int, names: Sequence[str]) -> str:
    """Write ``ZZ2 + 0.5824 (m3 + m4) - XX3``: equal coefficients together, own name first."""
    groups: dict[tuple[float, bool], list[str]] = {}
    for k in np.flatnonzero(row):
        if k != own:
            groups.setdefault((float(f"{abs(row[k]):.6g}"), bool(row[k] < 0)), []).append(names[int(k)])
    text = names[own]
    for (size, negative), members in groups.items():
        factor = "" if size == 1.0 else f"{size:.4g} "
        inside = " + ".join(members)
        if len(members) > 1 and (factor or negative):
            inside = f"({inside})"
        text += f" {'-' if negative else '+'} {factor}{inside}"
    return text


def _unit(column: int, kinds: int, geometry: Geometry) -> str:
    if column >= kinds * geometry.joints:
        motor, parameter = divmod(column - kinds * geometry.joints, 3)
        link, symbol = geometry.coupled[motor], ("f_c", "f_v", "J")[parameter]
    else:
        link, parameter = divmod(column, kinds)
        symbol = JOINT_PARAMETERS[parameter]
    revolute = bool(geometry.revolute[link])
    if symbol == "m":
        return "kg"
    if symbol in ("mx", "my", "mz"):
        return "kg m"
    if symbol == "f_c":
        return "N m" if revolute else "N"
    if symbol == "f_v":
        return "N m s/rad" if revolute else "N s/m"
    if symbol == "J" and not revolute:
        return "kg"
    return "kg m^2"


def unidentifiable(W: FloatArray, base: BaseParameters | Sequence[str], *, rtol: float = 1e-7) -> list[str]:
    """List base parameters that a motion leaves undetermined, by name; empty if none.

    Parameters
    ----------
    W : observation matrix of the motion, shape (rows, nb), or a triangular factor ``R`` of it with the same columns
    base : the base parameters, or just names for the columns
    rtol : singular values of the column-scaled ``W`` below ``rtol`` times the largest count as zero. For measured
        motions take the noise's share of the signals instead of round-off's (as 1e-3)

    Returns
    -------
    list of str
        Every parameter that has a part in the null space: those with a zero column, and all members of a
        group of which only combinations are determined. In the order of the columns.
    """
    names = list(base.names) if isinstance(base, BaseParameters) else list(base)
    if W.shape[1] != len(names):
        raise ValueError(f"W has {W.shape[1]} columns, there are {len(names)} names")
    norms = np.linalg.norm(W, axis=0)
    # Columns have units, so only a round-off's share of the largest is nothing.
    dead = norms <= 1e-12 * max(float(norms.max(initial=0.0)), np.finfo(float).tiny)
    lost = set(np.flatnonzero(dead).tolist())
    alive = np.flatnonzero(~dead)
    if alive.size:
        R = np.linalg.qr(W[:, alive] / norms[alive], mode="r")
        _, values, directions = np.linalg.svd(R, full_matrices=True)
        values = np.pad(values, (0, len(alive) - len(values)))
        null = directions[values <= rtol * values[0]]
        # Entries of round-off size do not make a parameter part of an undetermined combination.
        involved = np.abs(null).max(axis=0, initial=0.0) > 1e-3
        lost |= set(alive[involved].tolist())
    return [names[k] for k in sorted(lost)]


def condition_number(W: FloatArray) -> float:
    """Compute the condition number of ``W``, columns scaled to unit norm; infinite without rank.

    The scaling takes the units out: what is left is how much parameters replace one another (van der
    Sluis: no other column scaling is better by more than the root of the number of columns).
    """
    norms = np.linalg.norm(W, axis=0)
    if not np.all(norms > 0):
        return float("inf")
    values = np.linalg.svd(np.linalg.qr(W / norms, mode="r"), compute_uv=False)
    return float(values[0] / values[-1]) if values[-1] > 0 else float("inf")
