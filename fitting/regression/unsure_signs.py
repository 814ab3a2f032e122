"""How unsure a speed's sign is where friction turns, as the efforts show it.

A smoothed speed is off by the sensors' noise, which is known, and by what the filter takes of the motion itself: a
controller's tracking error, a vibration. Near reversals the sign of friction is wrong by either, by as much as it
scatters about its expectation: a pulse of force at every reversal, of a variance that follows from the width. So each
joint's width is the sensors', doubled as long as that is no less probable by its own rows, beside any friction and any
force of its position and speed, a delay and friction that turns late, none of which shall be taken for it.

Source of the likelihood of a random effect: D. Harville, "Maximum likelihood approaches to variance component
estimation", JASA 72, 1977.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
import scipy

from fitting.arm.expected import expected_sign
from fitting.arrays import FloatArray, IntArray
from fitting.regression.design import Design, NoiseModel, drive_columns_of, whitened_joint
from fitting.regression.drive import JUMPING
from fitting.regression.noise import spread
from fitting.signals.preparation import PositionNoise
from fitting.signals.splines import spline_basis

#: Multiples of the sensors' noise that a speed may be off by.
WIDTHS = (1.0, 2.0, 4.0, 8.0, 16.0)
#: Fall of twice the negative log likelihood from which on another width than the sensors' is taken: 19 times as
#: probable, where the sensors' is as probable beforehand as all others together.
CLEAR = 2.0 * float(np.log(19.0 * (len(WIDTHS) - 1)))
_WORSE = 2.0 * float(np.log(19.0))  # rise from which on no wider one is tried: what is probable beyond it is a law
_FUNCTIONS, _RANK = 8, 1e-9  # of a spline; share of the largest from which a direction of columns is one
_LATE = (1, 2, 4, 8, 16)  # samples by which friction may turn late


def unsure_speeds(
    design: Design, noise: NoiseModel, fitted: Sequence[int], sensors: Sequence[PositionNoise], joints: Iterable[int]
) -> tuple[PositionNoise, ...]:
    """Find how far speeds of some joints are off where they turn; the others have the design's.

    Parameters
    ----------
    fitted : segments whose rows are fitted
    sensors : noise of each joint's position by its sensors alone
    """
    result = list(design.noise)
    fitted = spread(fitted) if design.stored else fitted
    for joint in joints:
        rows, own = _OwnRows(design, noise, fitted, joint), sensors[joint]
        least = first = rows.unlikely(own.speed)
        width = WIDTHS[0]
        for wider in WIDTHS[1:]:
            now = rows.unlikely(wider * own.speed)
            if now > least + _WORSE:
                break
            if now < least:
                least, width = now, wider
        result[joint] = replace(own, turning=width * own.speed) if least < first - CLEAR else own
    return tuple(result)


class _OwnRows:
    """One joint's whitened rows: what depends on the deviation of its speed is fitted beside all that does not."""

    def __init__(self, design: Design, noise: NoiseModel, fitted: Sequence[int], joint: int) -> None:
        self._design, self._noise, self._joint = design, noise, joint
        self._segments = [(index, design.segments[index]) for index in fitted]
        self._ends = np.cumsum([len(own) for _, own in self._segments])[:-1]
        names, first = design.parameters.drive[joint], design.parameters.drive_slice(joint).start
        self._turning = [place for place, name in enumerate(names) if name in JUMPING]
        self._splines = np.hstack([spline_basis(self._motion(of), _FUNCTIONS) for of in "xv"])
        slopes = np.concatenate([np.gradient(own.effort[:, joint]) for _, own in self._segments])
        own = whitened_joint(design, noise, joint, fitted)
        steady = np.delete(own.A, [first + place for place in self._turning], axis=1)
        free = self._rows(np.column_stack([slopes, self._splines]))
        directions, sizes, _ = np.linalg.svd(_sized(np.hstack([steady, free])), full_matrices=False)
        self._basis = directions[:, sizes > _RANK * sizes.max(initial=0.0)]
        self._target = self._beside(own.b[:, None])
        found = np.linalg.lstsq(own.A, own.b, rcond=_RANK)[0]
        self._friction = max(0.0, float(found[first + names.index("f_c")]))
        self._turns = [np.flatnonzero(np.diff(np.sign(own.v[:, joint])) != 0) for _, own in self._segments]
        pulses = [
            self._pulses(index, turns, len(own))
            for (index, own), turns in zip(self._segments, self._turns, strict=True)
        ]
        self._of_pulses = self._beside(scipy.linalg.block_diag(*pulses))

    def unlikely(self, speed: float) -> float:
        """Compute twice the negative log likelihood of the best fit with this deviation of the speed."""
        sign = expected_sign(self._motion("v"), speed)
        late = [sign[np.maximum(np.arange(len(sign)) - k, 0)] for k in _LATE]
        parameters, joint = self._design.parameters, self._joint
        drive = np.vstack([drive_columns_of(parameters, own, joint, speed) for _, own in self._segments])
        A = self._rows(np.column_stack([drive[:, self._turning], *late, self._splines * sign[:, None]]))
        rows = np.hstack([self._beside(_sized(A)), self._target])
        scatter = map(_at_nearest, self._turns, np.split(1.0 - sign**2, self._ends))
        sized = self._of_pulses * self._friction * np.sqrt(np.concatenate(list(scatter)))
        # The rows' covariance is I + S S', S the pulses in their sizes: Woodbury's identity for what its inverse makes.
        root = np.linalg.cholesky(np.eye(sized.shape[1]) + sized.T @ sized)
        taken = scipy.linalg.solve_triangular(root, sized.T @ rows, lower=True)
        products = rows.T @ rows - taken.T @ taken
        fitted = np.linalg.pinv(products[:-1, :-1], rcond=1e-9, hermitian=True) @ products[:-1, -1]
        return float(products[-1, -1] - products[-1, :-1] @ fitted + 2.0 * np.sum(np.log(np.diag(root))))

    def _pulses(self, index: int, turns: IntArray, length: int) -> FloatArray:
        """Compute whitened rows (M, k) of a pulse of force at each reversal of a segment."""
        unit = np.zeros((length, len(turns)))
        unit[turns, np.arange(len(turns))] = 1.0
        return self._design.white(self._noise, self._joint, index, self._design.bank.reduce(unit))

    def _motion(self, of: str) -> FloatArray:
        return np.concatenate([getattr(own, of)[:, self._joint] for _, own in self._segments])

    def _rows(self, columns: FloatArray) -> FloatArray:
        """Reduce columns (N, k) of all segments and whiten them."""
        reduced = [self._design.bank.reduce(part) for part in np.split(columns, self._ends)]
        whole = zip(self._segments, reduced, strict=True)
        return np.vstack([self._design.white(self._noise, self._joint, index, rows) for (index, _), rows in whole])

    def _beside(self, rows: FloatArray) -> FloatArray:
        return np.asarray(rows - self._basis @ (self._basis.T @ rows))


def _at_nearest(turns: IntArray, values: FloatArray) -> FloatArray:
    """Sum values (N,) of samples at the reversal that is nearest to each, (k,)."""
    nearest = np.searchsorted((turns[1:] + turns[:-1]) / 2, np.arange(len(values)))
    return np.bincount(nearest, values, len(turns))[: len(turns)].astype(float)


def _sized(columns: FloatArray) -> FloatArray:
    """Scale columns to unit size; those that are zero stay."""
    return np.asarray(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300))
