"""From commands to strokes of the spools: delay, hysteresis, stick, a spring-mass-damper; many side by side.

Nothing acts back on a spool (flow forces are the pilot stage's business), so it is stepped exactly for itself: its
input is held over a step, as a command is between two telegrams. Arrays are (J, P).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import expm

from sim_backends.arrays import FloatArray
from sim_backends.valve.truth import Spool

#: Widths of the elements that a solenoid's loop is put together from, over its half-width at full current, and weights.
#: The weighted sum of the widths is 1: that is the loop's half-width once all elements have turned.
_ELEMENTS = (np.array([0.25, 0.75, 1.5, 2.5]) / 0.875, np.array([0.4, 0.3, 0.2, 0.1]))
_BLOCK = 1000  # steps for which random numbers are drawn at once
_AT_REST = 0.02  # 1/s: a spool slower than this fraction of full stroke per second stands still


class Spools:
    """The spools of P machines with J axes each; parameters from ``spools[p][j]``, stepped by ``dt`` s.

    ``rngs``, one per machine, are what restless pilot stages draw from; without them all are calm.

    Attributes
    ----------
    stroke, rate : (J, P) fraction of full, and per second
    """

    def __init__(
        self, spools: Sequence[Sequence[Spool]], dt: float, rngs: Sequence[np.random.Generator] | None = None
    ) -> None:
        def stacked(key: str) -> FloatArray:
            return np.array([[getattr(spool, key) for spool in row] for row in spools], dtype=np.float64).T

        self._dt = dt
        self._steps_late = [np.rint(stacked(key) / dt).astype(np.intp) for key in ("delay_extend", "delay_retract")]
        shape = self._steps_late[0].shape
        self._length = 1 + max(int(late.max()) for late in self._steps_late)
        self._sent = np.zeros((self._length, *shape))
        self._now = 0
        self._joint, self._machine = np.indices(shape)
        self._null = stacked("null")
        self._loss = stacked("current_loss")
        widths, weights = _ELEMENTS
        # One element of mechanical play, and those of the solenoid (Prandtl and Ishlinskii): their sum follows.
        self._widths = np.concatenate([stacked("play")[None], widths[:, None, None] * stacked("magnetic")])
        self._weights = np.concatenate([[0.0], weights])[:, None, None]
        self._plays, self._hysteretic = np.zeros((1 + len(widths), *shape)), bool(np.any(self._widths > 0.0))
        self._stick, self._silt = stacked("stick"), stacked("silt_time")
        self._sticky = bool(np.any(self._stick > 0.0))
        self._held, self._stuck = np.zeros(shape), np.ones(shape, dtype=bool)
        self._rested = np.zeros(shape)
        self._restless = stacked("restless")
        self._rngs = rngs if np.any(self._restless > 0.0) else None
        self._memory = np.exp(-dt / stacked("restless_time"))
        self._wander, self._drawn, self._used = np.zeros(shape), np.zeros((0, *shape)), 0
        w, damping, slower = stacked("frequency") * 2 * np.pi, stacked("damping"), stacked("retracting")
        self._extending = _transition(w, damping, dt)
        self._retracting = _transition(w * slower, damping, dt) if np.any(slower != 1.0) else None
        self.stroke, self.rate = self._null.copy(), np.zeros(shape)

    def step(self, command: FloatArray, warmth: FloatArray) -> None:
        """Advance one step under commands (J, P) sent now; ``warmth`` (P,) is 0 in cold oil and 1 at working heat."""
        self._now = (self._now + 1) % self._length
        self._sent[self._now] = np.clip(command, -1.0, 1.0)
        extend, retract = (
            self._sent[(self._now - late) % self._length, self._joint, self._machine] for late in self._steps_late
        )
        target = (np.maximum(extend, 0.0) + np.minimum(retract, 0.0)) * (1.0 - self._loss * warmth)
        if self._hysteretic:
            target = self._behind(target)
        target = np.clip(target + self._null, -1.0, 1.0)
        if self._sticky:
            target = self._let_go(target)
        if self._rngs is not None:
            target = np.clip(target + self._restless * self._wandered(self._rngs), -1.0, 1.0)
        away, rate = self.stroke - target, self.rate
        (a, b), (c, d) = self._extending
        if self._retracting is not None:
            other = (target < 0.0) | ((target == 0.0) & (self.stroke < 0.0))
            (e, f), (g, h) = self._retracting
            a, b, c, d = np.where(other, e, a), np.where(other, f, b), np.where(other, g, c), np.where(other, h, d)
        self.stroke, self.rate = target + a * away + b * rate, c * away + d * rate
        if self._sticky:
            self.stroke = np.where(self._stuck, self._held, self.stroke)
            self.rate = np.where(self._stuck, 0.0, self.rate)

    def _wandered(self, rngs: Sequence[np.random.Generator]) -> FloatArray:
        """Draw the next value of AR(1) noise of unit variance."""
        if self._used == len(self._drawn):
            drawn = [rng.standard_normal((_BLOCK, len(self._wander))) for rng in rngs]
            self._drawn, self._used = np.ascontiguousarray(np.stack(drawn, axis=2)), 0
        self._wander = self._memory * self._wander + np.sqrt(1.0 - self._memory**2) * self._drawn[self._used]
        self._used += 1
        return self._wander

    def _behind(self, target: FloatArray) -> FloatArray:
        """Play first, then the solenoid: the spool's command after both."""
        plays, widths = self._plays, self._widths
        plays[0] = np.clip(plays[0], target - widths[0], target + widths[0])
        plays[1:] = np.clip(plays[1:], plays[0] - widths[1:], plays[0] + widths[1:])
        return np.asarray((self._weights[1:] * plays[1:]).sum(axis=0))

    def _let_go(self, target: FloatArray) -> FloatArray:
        """Hold a spool at rest until the target has left it by more than its stick."""
        self._rested = np.where(self._stuck, self._rested + self._dt, 0.0)
        threshold = self._stick.copy()
        silting = self._silt > 0.0
        threshold[silting] *= 1.0 - np.exp(-self._rested[silting] / self._silt[silting])
        near = np.abs(target - self.stroke) <= self._stick * 0.05
        resting = near & (np.abs(self.rate) < _AT_REST) & (self._stick > 0.0)
        self._held = np.where(resting & ~self._stuck, self.stroke, self._held)
        self._stuck = np.where(self._stuck, np.abs(target - self._held) <= threshold, resting) & (self._stick > 0.0)
        return target


def _transition(w: FloatArray, damping: FloatArray, dt: float) -> FloatArray:
    """Compute ``exp(A dt)`` of ``y'' + 2 damping w y' + w^2 y = 0``, shape (2, 2, J, P)."""
    matrices = np.zeros((*w.shape, 2, 2))
    matrices[..., 0, 1] = dt
    matrices[..., 1, 0] = -(w**2) * dt
    matrices[..., 1, 1] = -2 * damping * w * dt
    return np.ascontiguousarray(np.moveaxis(expm(matrices), (-2, -1), (0, 1)))
