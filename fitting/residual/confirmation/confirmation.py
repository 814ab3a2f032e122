"""Before and after on a motion that no fit has seen, with an interval that knows coloured residuals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any

import numpy as np
import scipy

from fitting.arrays import FloatArray, IntArray
from fitting.regression.design import effort_errors, full_residual, moving_rows, whitened
from fitting.regression.noise import Pairing
from fitting.residual.confirmation.cross_validation import CONFIRMED
from fitting.residual.terms import Model

_BLOCK_SECONDS = 3.0
_DRAWS = 1000
#: Share by which no joint may get worse on `validate`, and the chance that a right model is refused for any joint.
MOST_WORSE, REFUSES_RIGHT = 0.01, 0.001
#: Standard deviations by which a right model falls short in one case of a hundred: up to so rarely `validate` counts as
#: a motion that can show it, and only beyond it is what is handed out refused.
_RARELY = NormalDist().inv_cdf(0.99)


def overall_change(
    before: Sequence[FloatArray],
    after: Sequence[FloatArray],
    floor: FloatArray,
    rate_hz: float,
    rng: np.random.Generator,
) -> dict[str, Any]:
    """Compute error over noise floor, RMS over the joints, before and after, and its change.

    Parameters
    ----------
    before, after : per joint (M_j,) filtered errors in the joint's effort unit, on the same rows
    floor : (n,) noise floor per joint
    rate_hz : rate of the errors
    rng : for the block bootstrap: blocks of three seconds (ten correlation times of what a filter of 3 Hz and a
        first-order disturbance leave), the same blocks before and after, drawn per joint

    Returns
    -------
    dict
        ``before``, ``after`` (in noise floors), ``change_percent`` and ``ci95_percent``.
    """
    pairs = [
        ((b - b.mean()) / f, (a - a.mean()) / f)
        for b, a, f in zip(before, after, floor, strict=True)
        if len(b) and len(b) == len(a) and f > 0
    ]
    if not pairs:
        return {"before": None, "after": None, "change_percent": None, "ci95_percent": None}
    first, second, *interval = _changed(pairs, rate_hz, rng)
    return {"before": first, "after": second, "change_percent": _percent(first, second), "ci95_percent": interval}


def error_change(
    before: Sequence[FloatArray], after: Sequence[FloatArray], rate_hz: float, rng: np.random.Generator
) -> tuple[float, float, float]:
    """Compute the change of some joints' RMS error, means included, in percent, with its 95 % interval.

    Each joint counts in units of its own error before; blocks and draws are those of :func:`overall_change`. Nothing
    changes (0, 0, 0) where the two have not the same rows.

    Parameters
    ----------
    before, after : per joint (M_j,) filtered errors in the joint's effort unit, on the same rows
    rate_hz : rate of the errors
    rng : for the block bootstrap
    """
    pairs = [(b, a) for b, a in zip(before, after, strict=True) if len(b) and len(b) == len(a) and np.any(b)]
    if not pairs:
        return 0.0, 0.0, 0.0
    sizes = [float(np.sqrt(np.mean(b**2))) for b, _ in pairs]
    units = [(b / size, a / size) for (b, a), size in zip(pairs, sizes, strict=True)]
    first, second, low, high = _changed(units, rate_hz, rng)
    return _percent(first, second), low, high


def _changed(
    pairs: Sequence[tuple[FloatArray, FloatArray]], rate_hz: float, rng: np.random.Generator
) -> tuple[float, float, float, float]:
    """Compute RMS before and after over joints of equal weight, and the 95 % interval of the change in percent.

    ``pairs`` are unit errors (M_j,) before and after; both have the same blocks, which each joint draws for itself.
    """
    block, drawn = max(2, round(_BLOCK_SECONDS * rate_hz)), list[FloatArray]()
    for pair in pairs:
        rows = len(pair[0])
        starts = np.arange(0, max(rows - block, 0) + 1, max(1, block // 4))
        squares = np.array([[np.mean(e[s : s + block] ** 2) for e in pair] for s in starts])
        picks = rng.integers(0, len(starts), size=(_DRAWS, max(1, rows // block)))
        drawn.append(squares[picks].mean(axis=1))
    first, second = (float(np.sqrt(np.mean([np.mean(pair[k] ** 2) for pair in pairs]))) for k in (0, 1))
    low, high = np.quantile(_percent(*np.sqrt(np.mean(drawn, axis=0).T)), [0.025, 0.975])
    return first, second, float(low), float(high)


def _percent(before: Any, after: Any) -> Any:
    """Compute the change in percent, of numbers or arrays."""
    return 100 * (after / before - 1)


@dataclass(frozen=True)
class Misfit:
    """Misfit of one joint beyond its noise.

    Attributes
    ----------
    excess : chi-square over all fitted rows that repeats of one motion share, so that it is structure and not noise
    z : the same over its standard error
    """

    excess: float
    z: float


def misfit(model: Model, pairs: Sequence[Pairing], joint: int) -> Misfit:
    """Test the pure error: half the sum of two runs' residuals holds structure and noise, half their difference noise.

    Without a repeated motion the result is zero. Source: N. R. Draper and H. Smith, Applied Regression Analysis,
    1998, ch. 2 (lack of fit and pure error).
    """
    together, apart, rows = 0.0, 0.0, 0
    design, bank = model.design, model.design.bank
    for pair in pairs:
        both = list(zip((pair.train, pair.repeat), pair.rows, strict=True))
        first, second = (full_residual(design, model.fit.theta, joint, i, model.extra)[rows] for i, rows in both)
        rest = np.logical_or(*(design.segments[i].rest[rows, joint] for i, rows in both))
        noise = model.noise.of(joint, design.segments[pair.train].loaded)
        halves = np.column_stack([first + second, first - second]) / np.sqrt(2.0)
        white = noise(bank.reduce(halves))[noise.kept(moving_rows(bank, rest))]
        together += float(white[:, 0] @ white[:, 0])
        apart += float(white[:, 1] @ white[:, 1])
        rows += len(white)
    if not rows:
        return Misfit(0.0, 0.0)
    # The sum counts structure twice; the pair's two segments represent all loaded ones.
    scale = 0.5 * len(model.fit.residual[joint]) / rows
    return Misfit(scale * (together - apart), (together - apart) / float(2.0 * np.sqrt(rows)))


def worse_joint(before: Model, after: Model, validate: Sequence[int]) -> tuple[int, float] | None:
    """Return the joint whose validation error rises most, if by more than :data:`MOST_WORSE`, and by how much.

    The rise has to be more than a right model allows (:class:`OnValidate`), with all joints looked at: a refit moves
    every joint's error, and a joint whose parameters were lucky loses that luck. An error that rises only because slow
    noise is not whitened in it is none: the joint's chi-square has to rise as well.
    """
    worst: tuple[int, float] | None = None
    significant = float(scipy.stats.norm.isf(REFUSES_RIGHT / len(before.design.machine.joints)))
    errors = [effort_errors(m.design, m.fit.theta, validate, m.extra) for m in (before, after)]
    for joint, (first, second) in enumerate(zip(*errors, strict=True)):
        if not len(first) or not len(second) or not np.std(first) > 0:
            continue
        rise = float(np.std(second) / np.std(first)) - 1.0
        if rise <= MOST_WORSE or (worst is not None and rise <= worst[1]):
            continue
        seen = on_validate(before, after, validate, (joint,))
        if seen.gain < 0 and seen.short > significant:
            worst = joint, rise
    return worst


@dataclass(frozen=True)
class OnValidate:
    """Change of the whitened residual of the validation segments by a better model.

    If it is right, the residual it leaves, ``u``, is noise and what its parameters' errors make, of covariance ``V =
    s^2 (I + X C X')``; the other model's is ``u - d``. The chi-square then falls by ``d'd - 2 u'd``.

    Attributes
    ----------
    gain : chi-square that falls
    expected : what falls on average if it is right, ``d'd``; infinite where the two models have not the same rows
    spread : the standard deviation of that, ``2 sqrt(d'V d)``; ``s^2`` is what the better of the two leaves per row:
        more than 1 where the validation motion is noisier than those that were fitted
    predicted : twice the logarithm of the rows' density, ``N(0, V)`` of what each leaves, over that of the other model
    entered : whether what was added acts in these segments at all
    rise : share by which the error of the joint that gets worst rises; infinite where it is not known
    """

    gain: float
    expected: float
    spread: float
    predicted: float
    entered: bool = True
    rise: float = np.inf

    @property
    def short(self) -> float:
        """Standard deviations by which it falls by less than expected; 0 where nothing can be expected."""
        known = self.spread > 0.0 and np.isfinite(self.expected)
        return (self.expected - self.gain) / self.spread if known else 0.0

    @property
    def has_power(self) -> bool:
        """True where a right model would be confirmed here in all but one case of a hundred."""
        return self.expected > CONFIRMED + _RARELY * self.spread

    @property
    def refutes(self) -> bool:
        """True where the rows speak against it as clearly as they have to for it, or are silent where they could speak.

        The rows' density knows how uncertain the parameters are. What is handed out has their means: it may not fall
        as short either, unless a right model does so in more than one case of a hundred and no joint gets worse for it.
        """
        needed = CONFIRMED if self.has_power and np.isfinite(self.expected) else -CONFIRMED
        harms = self.short > _RARELY or self.rise > MOST_WORSE
        return self.predicted < needed or (self.gain < needed and harms)


def on_validate(
    before: Model, after: Model, validate: Sequence[int], joints: Sequence[int] | None = None
) -> OnValidate:
    """Compare a model with another one on the validation segments.

    Parameters
    ----------
    before, after : the models
    validate : numbers of the segments
    joints : those that are taken together; None: all of them
    """
    joints = range(len(before.design.machine.joints)) if joints is None else joints
    gain, expected, own, seen = 0.0, 0.0, 0.0, np.zeros(len(after.fit.theta))
    start, entered, rise = len(before.fit.theta), False, 0.0
    densities = [Density(np.zeros(len(m.fit.theta))) for m in (before, after)]
    for joint in joints:
        residuals = [[_white_residual(model, index, joint) for index in validate] for model in (before, after)]
        old, new = (np.concatenate(parts) for parts in residuals)
        left = float(old @ old), float(new @ new)
        gain += left[0] - left[1]
        rise = max(rise, float(np.sqrt(left[1] / left[0])) - 1.0) if left[0] > 0 else np.inf
        if len(old) != len(new):  # a signal that is moved in time has other rows at rest
            expected = np.inf
            continue
        difference = new - old
        scale = max(1.0, min(left) / max(len(old), 1))
        rows = np.vstack([whitened(after.design, after.noise, (i,), after.extra)[joint].A for i in validate])
        entered = entered or bool(np.any(rows[:, start:]))
        expected += float(difference @ difference)
        own += scale * float(difference @ difference)
        seen += np.sqrt(scale) * (rows.T @ difference)
        densities = [
            density.with_rows(rows[:, : len(density.shadow)], r, scale)
            for density, r in zip(densities, (old, new), strict=True)
        ]
    spread = 2.0 * float(np.sqrt(own + seen @ after.fit.covariance @ seen))
    predicted = gain
    if np.isfinite(expected):
        logs = [
            own.log(m.fit.covariance, np.flatnonzero(m.fit.determined))
            for own, m in zip(densities, (before, after), strict=True)
        ]
        predicted = 2.0 * (logs[1] - logs[0])
    return OnValidate(gain, expected, spread, predicted, entered, rise)


@dataclass(frozen=True)
class Density:
    """Density ``N(0, s^2 + A C A')`` of what a model leaves of some rows: ``A'r``, ``A'A`` and ``r'r`` over ``s^2``."""

    shadow: FloatArray
    own: FloatArray | float = 0.0
    squares: float = 0.0

    def with_rows(self, A: FloatArray, residual: FloatArray, scale: float) -> Density:
        """Add more rows: columns (M, p), what is left of them (M,), and ``s^2``."""
        return Density(
            self.shadow + A.T @ residual / scale,
            self.own + A.T @ A / scale,
            self.squares + float(residual @ residual) / scale,
        )

    def log(self, covariance: FloatArray, determined: IntArray) -> float:
        """Compute the logarithm, but for a constant, with the ``covariance`` (p, p) of parameters ``determined``."""
        std = np.sqrt(np.diag(covariance)[determined])
        unit = covariance[np.ix_(determined, determined)] / np.outer(std, std)
        root = std[:, None] * np.linalg.cholesky(unit + 1e-12 * np.eye(len(determined)))
        own = np.eye(len(determined)) + root.T @ np.asarray(self.own)[np.ix_(determined, determined)] @ root
        shadow = root.T @ self.shadow[determined]
        return -0.5 * (self.squares - float(shadow @ np.linalg.solve(own, shadow)) + float(np.linalg.slogdet(own)[1]))


def validate_gain(before: Model, after: Model, validate: Sequence[int]) -> float:
    """Compute by how much the validation rows' whitened chi-square falls from one model to another."""
    joints = range(len(before.design.machine.joints))

    def chi_square(model: Model) -> float:
        return sum(float(np.sum(_white_residual(model, index, joint) ** 2)) for joint in joints for index in validate)

    return chi_square(before) - chi_square(after)


def _white_residual(model: Model, index: int, joint: int) -> FloatArray:
    residual = model.design.bank.reduce(full_residual(model.design, model.fit.theta, joint, index, model.extra))
    return model.design.white(model.noise, joint, index, residual)
