"""Linear filters that run block by block: tracking errors, noise shaping, and modes of the structure."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import scipy

from sim_backends.arrays import FloatArray


class LinearFilter:
    """A continuous state-space system, discretised exactly for inputs that are held over one step.

    Parameters
    ----------
    A, B, C, D : arrays
        Continuous-time matrices with one input.
    dt : float
        Step in s.
    columns : int
        Independent copies, one per column of the input.
    """

    def __init__(
        self, A: npt.ArrayLike, B: npt.ArrayLike, C: npt.ArrayLike, D: npt.ArrayLike, dt: float, columns: int
    ) -> None:
        system: Any = tuple(np.atleast_2d(np.asarray(M, dtype=float)) for M in (A, B, C, D))
        discrete: Any = scipy.signal.cont2discrete(system, dt)
        numerators, self._denominator = scipy.signal.ss2tf(*discrete[:4])
        self._numerators = np.atleast_2d(numerators)
        order = len(self._denominator) - 1
        self._states = [np.zeros((order, columns)) for _ in self._numerators]

    def __call__(self, u: FloatArray) -> list[FloatArray]:
        """Filter the input block ``u`` of shape (n, columns): one array of that shape per row of ``C``."""
        outputs = []
        for i, numerator in enumerate(self._numerators):
            y, self._states[i] = scipy.signal.lfilter(numerator, self._denominator, u, axis=0, zi=self._states[i])
            outputs.append(y)
        return outputs


def second_order(frequency: float, damping: float, dt: float, columns: int = 1) -> LinearFilter:
    """Build ``y'' + 2 z w y' + w^2 y = w^2 u``, outputs ``y, y', y''``; ``frequency`` in Hz."""
    w = 2 * np.pi * frequency
    spring = [-(w**2), -2 * damping * w]
    A = [[0.0, 1.0], spring]
    C = [[1.0, 0.0], [0.0, 1.0], spring]
    return LinearFilter(A, [[0.0], [w**2]], C, [[0.0], [0.0], [w**2]], dt, columns)


class ColouredNoise:
    """First-order (AR(1)) noise of unit variance with correlation time ``tau``, in ``columns`` independent columns."""

    def __init__(self, tau: float, dt: float, columns: int, rng: np.random.Generator) -> None:
        self._a = float(np.exp(-dt / tau)) if tau > 0 else 0.0
        self._rng = rng
        self._state = self._a * rng.standard_normal((1, columns))
        self._columns = columns

    def __call__(self, n: int) -> FloatArray:
        """Draw the next ``n`` values, shape (n, columns)."""
        white = self._rng.standard_normal((n, self._columns))
        y, self._state = scipy.signal.lfilter([np.sqrt(1 - self._a**2)], [1.0, -self._a], white, axis=0, zi=self._state)
        return np.asarray(y)
