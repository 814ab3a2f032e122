"""A crane's actuator of which only the valve's opening and a pressure are recorded: half of it simulated freely.

Data: Sjoberg and others (see below), 1024 samples; the first half is fitted. Without positions nothing is known of
speeds, so the model of valves does not apply. The model here is a curve in front of a rational filter::

    y_k = sum a_i y_(k-i) + sum b_j g(u_(k-j)) + c

``g`` is a curve in pieces that never falls, so that dead bands, two gains and a saturating spool are all in it. It is
fitted on the error of the free simulation: one step ahead any sluggish answer is predicted well.

Source: J. Sjoberg and others, Automatica 31, 1995 (the task, on a crane's actuator).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy import io, optimize, signal

from fitting.arrays import FloatArray
from fitting.signals.filters import lagged, recursive

#: Of 8, 9 and 10 what left the least of the fitted half of a crane's actuator (Sjoberg's task).
_PIECES = 10
#: What pieces are drawn to one another by, in units of the answer; and what a simulation that runs away is held at.
_EVEN, _FAR = 0.1, 20.0
#: RMS of the free simulation at most. Published: .47 at best; a linear ARX leaves .95.
MOST = 0.52


@dataclass(frozen=True)
class Response:
    """A fitted answer.

    Attributes
    ----------
    knots : commands between which the curve is straight, (pieces + 1,); beyond the ends it goes on
    slopes : of each piece, not negative, (pieces,)
    poles, zeros : ``a`` (n,) and ``b`` (n,)
    offset : ``c``
    """

    knots: FloatArray
    slopes: FloatArray
    poles: FloatArray
    zeros: FloatArray
    offset: float

    def simulated(self, u: FloatArray, start: FloatArray) -> FloatArray:
        """Simulate the answer (N,) to a command (N,), from its first values (n,) and nothing else measured."""
        driven = recursive(self.zeros, [1.0, *np.zeros(len(self.zeros) - 1)], _pieces(self.knots, u) @ self.slopes)
        a, order = np.append(1.0, -self.poles), len(self.poles)
        state = signal.lfiltic([1.0], a, start[::-1])
        with np.errstate(over="ignore", invalid="ignore"):
            rest = recursive([1.0], a, driven[order:] + self.offset, state.tolist())
        return np.append(start, np.nan_to_num(rest, nan=np.inf))


def fitted_response(u: FloatArray, y: FloatArray, order: int = 3) -> Response:
    """Fit the answer ``y`` (N,) to a command (N,), of an order, by its free simulation."""
    knots = np.linspace(float(u.min()), float(u.max()), _PIECES + 1)
    block = np.column_stack([lagged(u, y, order, order), np.ones(len(y) - order)])
    begun = np.linalg.lstsq(block, y[order:], rcond=None)[0]
    scale = float(np.std(y))

    def at(x: FloatArray) -> Response:
        return Response(knots, x[2 * order + 1 :], x[:order], x[order : 2 * order], float(x[2 * order]))

    def error(x: FloatArray) -> FloatArray:
        off = at(x).simulated(u, y[:order]) - y
        return np.append(np.clip(off, -_FAR * scale, _FAR * scale), _EVEN * (x[2 * order + 1 :] - 1.0))

    begin = np.append(begun, np.ones(_PIECES))
    low = np.append(np.full(2 * order + 1, -np.inf), np.zeros(_PIECES))
    found = optimize.least_squares(
        error, begin, bounds=(low, np.inf), x_scale=np.maximum(np.abs(begin), 0.05), max_nfev=100
    )
    return at(found.x)


def _pieces(knots: FloatArray, u: FloatArray) -> FloatArray:
    """Split a command (N,) into pieces, counted from a command of zero, (N, pieces)."""
    ends = knots.copy()
    ends[0], ends[-1] = -np.inf, np.inf
    columns = [np.clip(u, low, high) - np.clip(0.0, low, high) for low, high in pairwise(ends.tolist())]
    return np.column_stack(columns)


def evaluate(data: Path) -> float:
    """Compute the RMS of the second half under a fit to the first, simulated from its opening alone."""
    content = io.loadmat(data / "actuator.mat")
    u, p = (np.asarray(content[name], dtype=float).ravel() for name in ("u", "p"))
    half = len(u) // 2
    found = fitted_response(u[:half], p[:half])
    return float(np.sqrt(np.mean((found.simulated(u[half:], p[half : half + 3]) - p[half:]) ** 2)))
