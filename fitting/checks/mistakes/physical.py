"""Fit of efforts by an arm that could exist: masses that are masses, friction that brakes.

Every link is a cloud of point masses, none negative, on a grid in a box around the link; every joint has friction that
takes power at any speed, a moving mass that is not negative, and, free in sign, a constant, a spring and a delay (a
zero error, a gas spring and a late sensor are effects of the catalogue, and no mistakes)::

    y_j = sum_k Y_j(q, q', q'') pi(p_k) mu_k / r_j + m a + sum_i c_i phi_i(v) sgn v + [x, 1, dy/dt] f,   mu, m, c >= 0

(a moving mass or a spring far beyond a cylinder's size has its price, or either could represent a whole arm),

which is linear, so the best such arm is one non-negative least-squares problem (point masses as physically feasible
parameters: Ayusawa and Nakamura, "Identification of standard inertial parameters for large-DOF robots considering
physical consistency", IROS 2010). A wrong sign, a base that is upside down or exchanged cables leave a least
squares fit without such bounds as good as it was; this one they do not.

The misfit of a joint is the root mean square of what is left, over that of the effort less its mean. It has no unit and
does not change when the effort is scaled, so that trials in other units can be compared.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy
from scipy import linalg

from daq.machine.machine_file import Machine
from fitting.arm.dynamics import coupled_regressor, rigid_body_regressor
from fitting.arm.expected import expected_sign
from fitting.arm.geometry import Geometry, geometry_of
from fitting.arrays import BoolArray, FloatArray
from fitting.checks.mistakes.samples import EFFORTS, Motion, Samples, motion_of
from fitting.regression.prior import moving_mass

#: Points along each edge of a link's box. Three determine its mass, centre and spread.
_GRID = 3
#: How far a link's box reaches beyond its two axes: a share of its own length and of the arm's mean link.
_OWN, _MEAN = 0.5, 0.35
#: m; a link of an arm without lengths (all axes through one point) is at least so large.
_LEAST_BOX = 0.1
#: Speeds, as shares of a joint's largest, below which friction may be higher (Stribeck).
_STRIBECK = 0.15
#: Times the mass of a steel piston and rod that a cylinder's moving mass is usually below; Pa over the head's area
#: that a spring adds over the whole stroke at most (gas springs and hoses are effects of a few bar).
_HEAVY, _STIFF = 5.0, 2.0e6
#: Share of a column that compression loses.
_LOST = 1e-6
#: Misfits below this are alike: what thinning and filtering leave of a perfect fit.
LEAST_MISFIT = 0.015


@dataclass(frozen=True)
class Side:
    """Columns of a joint's rows beside the links.

    Attributes
    ----------
    rows : (T,) samples that are used, k of them
    free : (k, f) columns that are projected out
    lever : (k,) what a moment of the links does to the effort, 0 where they are off
    beside : (k, d + s + 6) columns of the drive, of the signals, and of rivals
    names : of the signals that a target is put together from
    centred : (s, s) products of the signals less their means
    usual : (d,) what the drive's coefficients usually stay below; infinite where nothing is known
    """

    rows: BoolArray
    free: FloatArray
    lever: FloatArray
    beside: FloatArray
    names: tuple[str, ...]
    centred: FloatArray
    usual: FloatArray


@dataclass(frozen=True)
class Block:
    """One joint's rows, compressed: ``R`` of ``[body, drive, signals]`` with the free columns projected out.

    Attributes
    ----------
    side : what the rows have beside the links
    body : (k, b) columns of the standard parameters
    drive : (k, d) columns whose coefficients may not be negative
    signals : (k, s) what a target is put together from
    rivals : (k, 6) effects that resemble another area: four columns of valves, two of friction by pressure
    """

    side: Side
    body: FloatArray
    drive: FloatArray
    signals: FloatArray
    rivals: FloatArray
    known: dict[bytes, float] = field(default_factory=dict, init=False, compare=False, repr=False)

    def target(self, weights: Mapping[str, float]) -> FloatArray:
        """Return the (s,) coefficients of a target."""
        return np.array([weights.get(name, 0.0) for name in self.side.names])

    def alone(self, weights: FloatArray, size: float) -> float:
        """Compute what these rows alone leave of a target of that size, as a share of it; some thousandths at least."""
        key = weights.tobytes()
        if key not in self.known:
            left = without(np.hstack([self.body, self.drive]), self.signals @ weights / size)
            self.known[key] = max(float(np.linalg.norm(left)), LEAST_MISFIT)
        return self.known[key]


@dataclass(frozen=True)
class Physical:
    """The best arm that could exist.

    Attributes
    ----------
    misfits : (n,) root mean square of what is left, over that of the effort; NaN for a joint that shows nothing
    free : the same for a least-squares fit without bounds
    own : the same for a least-squares fit of that joint alone
    shares : (n,) spread of the effort over the largest of all joints; per head area where there are cylinders
    """

    misfits: FloatArray
    free: FloatArray
    own: FloatArray
    shares: FloatArray


@dataclass(eq=False)
class _Shared:
    """Common parts of trials that differ in their links alone, once asked for; sides with exchange or not."""

    motion: Motion | None = None
    sides: dict[bool, tuple[Side | None, ...]] = field(default_factory=dict)


@dataclass(frozen=True)
class Trial:
    """A machine and samples as they are, or as a hypothesis has them; regression blocks are made when asked for.

    Attributes
    ----------
    samples : of the recordings
    machine : with the geometry and linkages to try
    positions : quantity of each joint's position
    exchange : also offer other joints' signals as targets
    carried : (T,) 1 where the last link carries more than otherwise, or None
    """

    samples: Samples
    machine: Machine
    positions: tuple[str, ...]
    exchange: bool = False
    carried: FloatArray | None = None
    shared: _Shared = field(default_factory=_Shared, init=False, compare=False, repr=False)

    @property
    def motion(self) -> Motion:
        """Joints and pistons."""
        if self.shared.motion is None:
            self.shared.motion = motion_of(self.machine, self.samples, self.positions)
        return self.shared.motion

    @property
    def sides(self) -> tuple[Side | None, ...]:
        """Columns beside the links in every joint's rows; None for an uninformative one."""
        known = self.shared.sides
        if self.exchange not in known:
            known[self.exchange] = tuple(_side(self, number) for number in range(len(self.machine.joints)))
        return known[self.exchange]

    @cached_property
    def body(self) -> FloatArray:
        """Columns (T, n, 10 n) of the links' standard parameters in the joints' efforts."""
        return rigid_body_regressor(self.machine, self.motion.q, self.motion.qd, self.motion.qdd)

    def rows(self, number: int) -> BoolArray:
        """Return samples (T,) in which a joint moves and its effort is informative."""
        informative = self.samples.loaded | (self.machine.joints[number].cylinder is not None)
        return np.asarray(self.motion.active[:, number] & informative & self.samples.used)

    @cached_property
    def clouds(self) -> FloatArray:
        """Standard parameters (10 n + 3 c, K) of unit point masses in each link's box."""
        clouds = _point_masses(geometry_of(self.machine))
        if self.carried is None:
            return clouds
        n, last = len(self.machine.joints), _GRID**3
        more = clouds[10 * n - 10 : 10 * n, (n - 1) * last : n * last]
        return np.block([[clouds, np.zeros((len(clouds), last))], [np.zeros((10, clouds.shape[1])), more]])

    @cached_property
    def blocks(self) -> tuple[Block | None, ...]:
        """Rows of every joint in which it moves, compressed by QR; None for an uninformative one."""
        motion, body, n = self.motion, self.body, len(self.machine.joints)
        if any(j.drive is not None and j.drive.coupled for j in self.machine.joints):
            more = coupled_regressor(self.machine, motion.qd, motion.qdd, speed_noise=motion.speed_noise)
            body = np.concatenate([body, more], axis=2)
        if self.carried is not None:
            body = np.concatenate([body, body[:, :, 10 * n - 10 : 10 * n] * self.carried[:, None, None]], axis=2)
        blocks: list[Block | None] = []
        for number, side in enumerate(self.sides):
            if side is None:
                blocks.append(None)
                continue
            own = body[side.rows, number] * side.lever[:, None]
            free = side.free.shape[1]
            R = _triangle(np.column_stack([side.free, own, side.beside]))[free:, free:]
            ends = np.cumsum([own.shape[1], len(side.usual), len(side.names)])
            blocks.append(Block(side, *np.split(R, ends, axis=1)))
        return tuple(blocks)

    def with_machine(self, machine: Machine) -> Trial:
        """Return the samples on another machine file; where only links change, with what their rows have beside."""
        return self._kept(replace(self, machine=machine))

    def exchanging(self, exchange: bool) -> Trial:
        """Return the same with other joints' signals as targets, or without."""
        return self._kept(replace(self, exchange=exchange))

    def _kept(self, other: Trial) -> Trial:
        pairs = zip(self.machine.joints, other.machine.joints, strict=True)
        if all((a.cylinder, a.drive, a.limits) == (b.cylinder, b.drive, b.limits) for a, b in pairs):
            object.__setattr__(other, "shared", self.shared)
        return other

    def with_samples(self, samples: Samples) -> Trial:
        """Return other samples on the same machine file."""
        return replace(self, samples=samples)


def _point_masses(geometry: Geometry) -> FloatArray:
    """Compute standard parameters of unit point masses on a grid in each link's box, (10 n + 3 c, K), by link.

    The box spans the link's two axes, wider by half its own length and a third of the arm's mean link on every side.
    """
    n, c = geometry.joints, len(geometry.coupled)
    corners = [np.vstack([end for stretch in own for end in stretch]) for own in geometry.stretches]
    begins, ends = (np.array([side(own, axis=0) for own in corners]) for side in (np.min, np.max))
    lengths = np.linalg.norm(ends - begins, axis=1)
    mean = float(np.mean(lengths)) if n else 0.0
    blocks = []
    for link in range(n):
        wider = max(_OWN * lengths[link] + _MEAN * mean, _LEAST_BOX)
        axes = [np.linspace(begins[link][k] - wider, ends[link][k] + wider, _GRID) for k in range(3)]
        x, y, z = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3).T
        inertia = [y * y + z * z, -x * y, -x * z, x * x + z * z, -y * z, x * x + y * y]
        blocks.append(np.stack([np.ones_like(x), x, y, z, *inertia]))
    return np.asarray(linalg.block_diag(*blocks, np.eye(3 * c)))


def friction(v: FloatArray, noise: float) -> FloatArray:
    """Compute columns (T, 5) of friction that brakes at every speed: constant, cube root, viscous, square, Stribeck."""
    top = max(float(np.percentile(np.abs(v), 99)), 1e-12)
    u = np.abs(v) / top
    sign = expected_sign(v, noise)
    shapes = [np.ones_like(u), np.cbrt(u), u, u**2, np.maximum(0.0, 1.0 - u / _STRIBECK)]
    return np.stack([sign * shape for shape in shapes], axis=1)


def joint_columns(trial: Trial, number: int) -> FloatArray:
    """Compute columns (T, 10 n + 8) of a joint's effort: links where loaded, moving mass, friction, zero, spring."""
    motion = trial.motion
    body = np.where(trial.samples.loaded[:, None], trial.body[:, number] / motion.r[:, [number]], 0.0)
    v, a, x = motion.v[:, number], motion.a[:, number], motion.x[:, number]
    return np.column_stack([body, a, friction(v, motion.speed_noise[number]), np.ones(len(v)), x])


#: Columns of :attr:`Block.rivals` of each effect.
RIVALS = (slice(0, 4), slice(4, 6))


def _rivals(trial: Trial, number: int, v: FloatArray) -> FloatArray:
    """Compute columns (T, 6) of effects that resemble another ratio of areas.

    Four of a force that grows with speed while the cylinder extends (what valves hold back), two of friction that grows
    with the pressures (:data:`RIVALS`).
    """
    u = np.where(v > 0, v, 0.0) / max(float(np.percentile(np.abs(v), 99)), 1e-12)
    columns = [(v > 0).astype(np.float64), np.sqrt(u), u, u**2]
    for quantity in ("head_pressure", "rod_pressure"):
        signal = trial.samples.get(quantity, number)
        columns.append(np.zeros(len(v)) if signal is None else np.sign(v) * signal.value)
    return np.stack(columns, axis=1)


def _side(trial: Trial, number: int) -> Side | None:
    samples, motion = trial.samples, trial.motion
    named, rows = _signals(trial, number), trial.rows(number)
    if not named or np.count_nonzero(rows) < 60:
        return None
    v, a, x = motion.v[:, number], motion.a[:, number], motion.x[:, number]
    drive = np.column_stack([a, friction(v, motion.speed_noise[number])])
    cylinder = trial.machine.joints[number].cylinder
    usual = np.full(drive.shape[1], np.inf)
    if cylinder is not None:
        usual[0] = _HEAVY * moving_mass(cylinder)
        stiff = _STIFF * cylinder.head_area / cylinder.stroke
        usual = np.append(usual, [stiff, stiff])
        drive = np.column_stack([drive, x - x[rows].mean(), x[rows].mean() - x])
    late = measured_effort(trial, number)[1]  # the rate of the effort as it is declared is what a delay adds
    free = np.column_stack([np.ones(len(v)), *([late] if np.any(late) else [])])[rows]
    S = np.stack(list(named.values()), axis=1)[rows]
    centred = S - S.mean(axis=0)
    lever = np.where(samples.loaded, 1.0 / motion.r[:, number], 0.0)[rows]
    beside = np.column_stack([drive[rows], S, _rivals(trial, number, v)[rows]])
    return Side(rows, free, lever, beside, tuple(named), centred.T @ centred, usual)


def _triangle(A: FloatArray) -> FloatArray:
    """Compute the upper triangle with the products of the columns of ``A``; a millionth of each size is lost.

    By Cholesky's decomposition, ten times as fast as Householder's here, and misfits below a thousandth are alike.
    """
    scale = np.linalg.norm(A, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    unit = A / scale
    gram = unit.T @ unit
    gram[np.diag_indices_from(gram)] += _LOST**2
    return np.asarray(linalg.cholesky(gram, check_finite=False)) * scale


def _signals(trial: Trial, number: int) -> dict[str, FloatArray]:
    """Return the signals a target of this joint may combine, in N at a cylinder, in the joint's unit elsewhere."""
    samples, machine, motion = trial.samples, trial.machine, trial.motion
    joint = machine.joints[number]
    result: dict[str, FloatArray] = {}
    for other in range(len(machine.joints)) if trial.exchange else (number,):
        for quantity in EFFORTS if joint.cylinder is not None else ("joint_effort",):
            signal = samples.get(quantity, other)
            if signal is not None:
                torque = joint.cylinder is not None and quantity == "joint_effort"
                result[f"{quantity}{other}"] = signal.value / motion.r[:, number] if torque else signal.value
    if result and joint.cylinder is not None:
        mass = joint.cylinder.moving_mass or 0.0
        known = joint.cylinder.damping * motion.v[:, number] + mass * motion.a[:, number]
        result["known"] = known + samples.external[:, number]
    return result


def measured_effort(trial: Trial, number: int) -> tuple[FloatArray, FloatArray]:
    """Compute a joint's effort (T,) by the machine file, and its rate: N at a cylinder, the joint's unit elsewhere."""
    samples = trial.samples
    value, rate = np.zeros(len(samples)), np.zeros(len(samples))
    weights = declared(trial.machine, samples, number)
    for name, weight in weights.items():
        signal = None if name == "known" else samples.get(quantity_of(name), number)
        if signal is not None:
            value, rate = value + weight * signal.value, rate + weight * signal.first
    if f"joint_effort{number}" in weights and trial.machine.joints[number].cylinder is not None:
        value, rate = value / trial.motion.r[:, number], rate / trial.motion.r[:, number]
    return value, rate


def quantity_of(name: str) -> str:
    """Return the quantity of a signal of an effort: ``head_pressure`` of ``head_pressure2``, or ``known``."""
    return name.rstrip("0123456789")


def declared(machine: Machine, samples: Samples, number: int) -> dict[str, float]:
    """Return the weights of the signals that make a joint's effort by the machine file; empty if unmeasured."""
    joint = machine.joints[number]
    head, rod = samples.get("head_pressure", number), samples.get("rod_pressure", number)
    if joint.cylinder is not None and head is not None and rod is not None:
        return {
            f"head_pressure{number}": joint.cylinder.head_area,
            f"rod_pressure{number}": -joint.cylinder.rod_area,
            "known": -1.0,
        }
    for quantity in ("cylinder_force", "joint_effort"):
        if samples.get(quantity, number) is not None:
            return {f"{quantity}{number}": 1.0} | ({"known": -1.0} if joint.cylinder is not None else {})
    return {}


def fit(trial: Trial, targets: Mapping[int, Mapping[str, float]] | None = None, *, bounded: bool = True) -> Physical:
    """Fit the best arm for targets; by default those of the machine file.

    Parameters
    ----------
    targets : per joint the weights of its signals
    bounded : False leaves the bounds out (cheaper, never a worse fit)
    """
    blocks, machine = trial.blocks, trial.machine
    n = len(machine.joints)
    chosen = [j for j in range(n) if blocks[j] is not None]
    misfits, free, own, shares = (np.full(n, np.nan) for _ in range(4))
    if not chosen:
        return Physical(misfits, free, own, shares)
    bodies, drives, wanted, measured, weights_of = [], [], [], [], []
    for j in chosen:
        block = blocks[j]
        assert block is not None
        weights = block.target((targets or {}).get(j) or declared(machine, trial.samples, j))
        size = max(float(weights @ block.side.centred @ weights), 0.0) ** 0.5
        size = size if size > 0 else 1.0
        cylinder = machine.joints[j].cylinder
        shares[j] = size / float(np.sqrt(len(block.side.lever))) / (cylinder.head_area if cylinder is not None else 1.0)
        # A joint that nothing explains must not bend the others: its weight is what its own rows alone leave.
        alone = block.alone(weights, size)
        # A moving mass or a spring at the end of what is usual costs as much as the joint's misfit alone.
        costs = np.diag(1.0 / block.side.usual)[np.isfinite(block.side.usual)]
        bodies += [block.body / (size * alone), np.zeros((len(costs), block.body.shape[1]))]
        drives.append(np.vstack([block.drive / (size * alone), costs]))
        wanted += [block.signals @ weights / size / alone, np.zeros(len(costs))]
        measured.append(len(block.body))
        weights_of.append(alone)
    ends = np.cumsum([0, *map(len, drives)])
    body, drive, target = np.vstack(bodies), linalg.block_diag(*drives), np.concatenate(wanted)
    left_free = without(np.hstack([body, drive]), target)
    left = _bounded(np.hstack([body @ trial.clouds, drive]), target) if bounded else left_free
    for k, j in enumerate(chosen):
        mine = slice(int(ends[k]), int(ends[k]) + measured[k])
        misfits[j] = weights_of[k] * float(np.linalg.norm(left[mine]))
        free[j] = weights_of[k] * float(np.linalg.norm(left_free[mine]))
        own[j] = weights_of[k]
    return Physical(misfits, free, own, shares / np.nanmax(shares))


def without(A: FloatArray, b: FloatArray) -> FloatArray:
    """Compute what least squares leave of ``b``; by normal equations with a ridge of 1e-9, enough for a misfit."""
    scale = np.linalg.norm(A, axis=0)
    used = scale > 1e-12 * scale.max(initial=0.0)
    unit = A[:, used] / scale[used]
    gram = unit.T @ unit
    gram[np.diag_indices_from(gram)] += 1e-9
    theta = linalg.solve(gram, unit.T @ b, assume_a="pos", check_finite=False)
    return np.asarray(b - unit @ theta)


def _bounded(A: FloatArray, b: FloatArray) -> FloatArray:
    """Compute what nonnegative least squares leave of ``b``."""
    scale = np.linalg.norm(A, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    # Compressed once more: as many rows as columns at most.
    R = np.asarray(np.linalg.qr(np.column_stack([A / scale, b]), mode="r"))
    try:
        mu = scipy.optimize.nnls(R[:, :-1], R[:, -1], maxiter=20 * A.shape[1])[0]
    except RuntimeError:
        mu = scipy.optimize.lsq_linear(R[:, :-1], R[:, -1], (0, np.inf), max_iter=200).x
    return np.asarray(b - (A / scale) @ mu)
