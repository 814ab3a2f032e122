"""Before and after on a motion that no fit has seen, with an interval that knows coloured residuals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import stats

from fitting.noise import Pairing
from fitting.regression import REST_SHARE, effort_errors, full_residual, whitened
from fitting.residual.terms import Model

FloatArray = npt.NDArray[np.float64]

_BLOCK_SECONDS = 3.0
_DRAWS = 1000
#: Share by which no joint may get worse on `validate`, and the chance that a right model is refused for any joint.
MOST_WORSE, REFUSES_RIGHT = 0.01, 0.001


def overall_change(
    before: Sequence[FloatArray],
    after: Sequence[FloatArray],
    floor: FloatArray,
    rate_hz: float,
    rng: np.random.Generator,
) -> dict[str, Any]:
    """Root mean square over the joints of error over noise floor, before and after, and its change.

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
        (b - b.mean(), a - a.mean(), f)
        for b, a, f in zip(before, after, floor, strict=True)
        if len(b) and len(b) == len(a) and f > 0
    ]
    if not pairs:
        return {"before": None, "after": None, "change_percent": None, "ci95_percent": None}
    first = _overall([np.mean(b**2) / f**2 for b, _, f in pairs])
    second = _overall([np.mean(a**2) / f**2 for _, a, f in pairs])
    block = max(2, round(_BLOCK_SECONDS * rate_hz))
    draws_before = np.zeros((_DRAWS, len(pairs)))
    draws_after = np.zeros((_DRAWS, len(pairs)))
    for column, (b, a, f) in enumerate(pairs):
        starts = np.arange(0, max(len(b) - block, 0) + 1, max(1, block // 4))
        sums_b = np.array([np.mean(b[s : s + block] ** 2) for s in starts]) / f**2
        sums_a = np.array([np.mean(a[s : s + block] ** 2) for s in starts]) / f**2
        picks = rng.integers(0, len(starts), size=(_DRAWS, max(1, len(b) // block)))
        draws_before[:, column] = sums_b[picks].mean(axis=1)
        draws_after[:, column] = sums_a[picks].mean(axis=1)
    changes = 100 * (np.sqrt(draws_after.mean(axis=1) / draws_before.mean(axis=1)) - 1)
    low, high = np.quantile(changes, [0.025, 0.975])
    return {
        "before": first,
        "after": second,
        "change_percent": 100 * (second / first - 1),
        "ci95_percent": [float(low), float(high)],
    }


def _overall(squares: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(squares)))


@dataclass(frozen=True)
class Misfit:
    """What a model leaves of one joint beyond its noise.

    Attributes
    ----------
    excess : chi-square over all fitted rows that repeats of one motion share, so that it is structure and not noise
    z : the same over its standard error
    """

    excess: float
    z: float


def misfit(model: Model, pairs: Sequence[Pairing], joint: int) -> Misfit:
    """Pure-error test: half the sum of two runs' residuals holds structure and noise, half their difference noise only.

    Without a repeated motion nothing is said (zero). Source: N. R. Draper and H. Smith, Applied Regression Analysis,
    1998, ch. 2 (lack of fit and pure error).
    """
    together, apart, rows = 0.0, 0.0, 0
    design, bank = model.design, model.design.bank
    for pair in pairs:
        left = slice(pair.train_start, pair.train_start + pair.length)
        right = slice(pair.repeat_start, pair.repeat_start + pair.length)
        first, second = (
            full_residual(design, model.fit.theta, joint, index, model.extra)[part]
            for index, part in ((pair.train, left), (pair.repeat, right))
        )
        rest = design.segments[pair.train].rest[left, joint] | design.segments[pair.repeat].rest[right, joint]
        kept = model.noise.kept(joint, bank.reduce(rest.astype(float)) < REST_SHARE)
        halves = np.column_stack([first + second, first - second]) / np.sqrt(2.0)
        white = model.noise.whiten(joint, bank.reduce(halves))[kept]
        together += float(white[:, 0] @ white[:, 0])
        apart += float(white[:, 1] @ white[:, 1])
        rows += len(white)
    if not rows:
        return Misfit(0.0, 0.0)
    # The sum counts structure twice; the pair's two segments stand for all loaded ones.
    scale = 0.5 * len(model.fit.residual[joint]) / rows
    return Misfit(scale * (together - apart), (together - apart) / float(2.0 * np.sqrt(rows)))


def worse_joint(before: Model, after: Model, validate: Sequence[int]) -> tuple[int, float] | None:
    """The joint whose error on the validation segments rises most, if by more than :data:`MOST_WORSE`, and by how much.

    The rise has to be significant as well, with all joints looked at. If the new model is right, its whitened residual
    ``u`` is noise and what its parameters' errors make, of covariance ``V = s^2 (I + X C X')``; the old model's is
    ``u - d``. The chi-square then changes by ``2 u'd - d'd``, with ``2 sqrt(d'V d)`` as standard deviation. A refit
    moves every joint's error, and a joint whose parameters were lucky loses that luck. ``s^2`` is what the better of
    the two leaves per row: more than 1 where the validation motion is noisier than those that were fitted.
    """
    worst: tuple[int, float] | None = None
    significant = float(stats.norm.isf(REFUSES_RIGHT / len(before.design.machine.joints)))
    errors = [effort_errors(m.design, m.fit.theta, validate, m.extra) for m in (before, after)]
    for joint, (first, second) in enumerate(zip(*errors, strict=True)):
        if not len(first) or not len(second) or not np.std(first) > 0:
            continue
        rise = float(np.std(second) / np.std(first)) - 1.0
        if (
            rise > MOST_WORSE
            and (worst is None or rise > worst[1])
            and _loss(before, after, validate, joint) > significant
        ):
            worst = joint, rise
    return worst


def _loss(before: Model, after: Model, validate: Sequence[int], joint: int) -> float:
    """Standard errors by which a joint's chi-square on the validation segments is above what a right model allows."""
    left, change, moved, rows, seen = 0.0, 0.0, 0.0, 0, np.zeros(len(after.fit.theta))
    for index in validate:
        old, new = (_white_residual(model, index, joint) for model in (before, after))
        if len(old) != len(new):  # a signal that is moved in time has other rows at rest
            continue
        difference = new - old
        left += float(old @ old)
        change += float(new @ new - old @ old)
        moved += float(difference @ difference)
        rows += len(new)
        seen += whitened(after.design, after.noise, (index,), after.extra)[joint].A.T @ difference
    if moved <= 0.0:
        return 0.0
    scale = max(1.0, min(left, left + change) / rows)
    return (change + moved) / (2.0 * float(np.sqrt(scale * (moved + seen @ after.fit.covariance @ seen))))


def validate_gain(before: Model, after: Model, validate: Sequence[int]) -> float:
    """Chi-square by which the whitened residual of the validation segments falls from one model to another."""
    return _validate_chi_square(before, validate) - _validate_chi_square(after, validate)


def _validate_chi_square(model: Model, validate: Sequence[int]) -> float:
    return sum(_joint_chi_square(model, validate, joint) for joint in range(len(model.design.machine.joints)))


def _joint_chi_square(model: Model, validate: Sequence[int], joint: int) -> float:
    return float(sum(np.sum(_white_residual(model, index, joint) ** 2) for index in validate))


def _white_residual(model: Model, index: int, joint: int) -> FloatArray:
    block = model.design.blocks[joint][index]
    residual = model.design.bank.reduce(full_residual(model.design, model.fit.theta, joint, index, model.extra))
    return model.noise.whiten(joint, residual)[model.noise.kept(joint, block.keep)]
