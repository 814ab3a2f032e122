"""What a valve's model is compared with: a line, an autoregression, a curve of the command alone.

All three get the same rows, the same filters and the same recordings, and are judged on the same other motion; the
autoregression runs freely there, on nothing but commands.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from fitting.arrays import BoolArray, FloatArray
from fitting.signals.filters import recursive
from fitting.signals.held import delayed, lagged
from fitting.valve.fit import DELAYS, Fit, fitted, predicted, relative
from fitting.valve.model import Structure
from fitting.valve.rows import Axis

#: Rows at the start of a stretch in which an autoregression has not forgotten that it began from nothing.
_SETTLING = 8


def peers_of(axis: Axis, judged: Axis) -> tuple[dict[str, float | None], Fit]:
    """Compute errors of peers fitted to an axis on another motion, RMS over the speed's, and the static curve.

    ``linear``: one gain and a delay; ``arx``: two poles, two zeros and a delay, simulated, None where that has no end;
    ``static``: a curve of the command and a delay, no pressures: what is handed out where nothing is better.
    """
    curve = fitted(axis, Structure(curve="monotone"))
    arx = min(_arx(axis, judged, lag) for lag in range(round(DELAYS[-1] * axis.bank.reduced_rate_hz) + 1))[1]
    errors = {
        "linear": min(_linear(axis, judged, delay) for delay in DELAYS)[1],
        "arx": arx if np.isfinite(arx) else None,
        "static": relative(judged, judged.speed - predicted(judged, curve)),
    }
    return errors, curve


def _linear(axis: Axis, judged: Axis, delay: float) -> tuple[float, float]:
    """Compute errors on the fitted rows and on others."""
    one, other = (
        own.reduced(delayed(own.signals.parts, own.signals.u, delay * axis.bank.rate_hz)) for own in (axis, judged)
    )
    gain = float(one[axis.keep] @ axis.speed[axis.keep]) / max(float(one[axis.keep] @ one[axis.keep]), 1e-30)
    return relative(axis, axis.speed - gain * one), relative(judged, judged.speed - gain * other)


def _arx(axis: Axis, judged: Axis, lag: int) -> tuple[float, float]:
    """Compute errors, simulated freely, on fitted and other rows: ``y_k = a y_(k-1..2) + b u_(k-lag..lag+1)``."""
    rows, right = [], []
    for u, y, keep in _series(axis):
        late = np.concatenate([np.full(lag, u[0]), u])[: len(u)]
        block = lagged(late, y, poles=2, zeros=2)
        kept = keep[2:] & keep[1:-1] & keep[:-2]
        rows.append(block[kept])
        right.append(y[2:][kept])
    a = np.linalg.lstsq(np.concatenate(rows), np.concatenate(right), rcond=None)[0]
    if np.any(np.abs(np.roots([1.0, -a[0], -a[1]])) >= 1.0):
        return np.inf, np.inf
    return _simulated(axis, a, lag), _simulated(judged, a, lag)


def _simulated(axis: Axis, a: FloatArray, lag: int) -> float:
    errors = list[FloatArray]()
    for u, y, keep in _series(axis):
        late = np.concatenate([np.full(lag, u[0]), u])[: len(u)]
        out = recursive([a[2], a[3], 0.0], [1.0, -a[0], -a[1]], late)
        errors.append(np.where(keep & (np.arange(len(y)) >= _SETTLING), y - out, 0.0))
    return relative(axis, np.concatenate(errors))


def _series(axis: Axis) -> Iterator[tuple[FloatArray, FloatArray, BoolArray]]:
    """Return filtered command, speed and whether a row is kept (rows,), by stretch."""
    start = 0
    for part in axis.signals.parts:
        u = axis.bank.reduce(axis.signals.u[part])
        own = slice(start, start + len(u))
        start += len(u)
        yield u, axis.speed[own], axis.keep[own]
