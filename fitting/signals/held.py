"""Values that are held between samples, as commands are: later, through a spring, a mass and a damper, and as rows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitting.arrays import FloatArray
from fitting.signals.filters import recursive

#: Of a cycle, in each of which what follows stands at its mean: what crosses an edge within a cycle is beyond it for a
#: part of it, which its mean over the cycle does not know.
PARTS = 4


def followed(parts: Sequence[slice], u: FloatArray, samples: float, damping: float) -> FloatArray:
    """Follow a command held between samples (N,) with a spool: means over parts of each cycle (PARTS, N).

    A spring, a mass and a damper, ``samples`` late on the average; before a stretch it was at rest.
    """
    late = max(samples, 1e-3)
    split = np.sqrt(complex(damping**2 - 1.0, 1e-9))  # two poles, nearly one where it is critically damped
    one, other = (-2.0 * damping / late * (damping + own) for own in (split, -split))
    time = np.arange(3 * PARTS + 1) / PARTS
    gone = other / one * np.exp(one * time) - one / other * np.exp(other * time)
    ramp = time - late + (gone / (one - other)).real
    steps = PARTS * np.diff(ramp).reshape(3, PARTS)  # the answer to a step; it goes on with the two poles
    poles = np.poly(np.exp([one, other])).real
    zeros = np.array([np.convolve(taps, poles)[:3] for taps in np.diff(steps, axis=0, prepend=0.0).T])
    out = np.empty((PARTS, len(u)))
    for part in parts:
        first = u[part][0]
        slow = np.append(np.zeros(2), recursive(np.eye(3)[0], poles, u[part] - first))
        out[:, part] = first + zeros @ np.stack([slow[2:], slow[1:-1], slow[:-2]])
    return out


def delayed(parts: Sequence[slice], u: FloatArray, samples: float) -> FloatArray:
    """Delay what is held between samples (N,) by ``samples``; values are means of a cycle around.

    Before the first of a stretch it was the first.
    """
    whole = int(np.floor(samples + 0.5))
    fraction = samples + 0.5 - whole
    out = np.empty(len(u))
    for part in parts:
        own, late = u[part], out[part]
        known = max(len(own) - whole - 1, 0)
        late[: len(own) - known] = own[0]
        late[len(own) - known :] = (1.0 - fraction) * own[1 : known + 1] + fraction * own[:known]
    return out


def lagged(u: FloatArray, y: FloatArray, poles: int, zeros: int) -> FloatArray:
    """Return columns ``y_(k-1..poles)``, ``u_(k..k-zeros+1)`` of rows from ``max(poles, zeros - 1)`` on."""
    first = max(poles, zeros - 1)
    past = [y[first - lag : len(y) - lag] for lag in range(1, poles + 1)]
    return np.column_stack([*past, *(u[first - lag : len(u) - lag] for lag in range(zeros))])
