"""Collisions and overloads live: every new sample against its band, within a tenth of a second.

The decisions are those of :mod:`fitting.model.uses.overload`, on windows that end with the newest sample.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from fitting.model.uses.overload import QUIET_S, delay_s, quick, scores_in, thresholds
from server.identifications.live_model import LiveModel, NotLiveError
from server.monitor.monitor_order import OverloadJoint, OverloadNow
from server.monitor.residual_blocks import measured

FloatArray = npt.NDArray[np.float64]
#: Samples before the newest that are looked at again, for what a window tells of its sensors.
_PAST = 48


class OverloadWatch:
    """Watches rows of a ring buffer.

    Parameters
    ----------
    live : the calibration's model
    names : of the channels, in the order of the ring's rows
    per_hour : false alarms of the machine that are allowed

    Raises
    ------
    NotLiveError
        If the model does not say what is usual.
    """

    def __init__(self, live: LiveModel, names: Sequence[str], per_hour: float) -> None:
        if live.model.tails is None:
            raise NotLiveError("server.model_not_say_residuals")
        self._live = LiveModel(quick(live.model))
        self._names, self._units = tuple(names), [joint.effort_unit for joint in live.machine.joints]
        self.limits = thresholds(live.model.tails, per_hour)
        self.delay_s = delay_s(self._live.model)
        self._quiet = round(QUIET_S * live.machine.rate_hz)
        self._rows: npt.NDArray[np.void] | None = None
        self._judged = -np.inf  # s of machine time up to which samples were judged
        self._since: int | None = None  # samples since the last exceedance; None while nothing is wrong
        self._nearest: dict[int, OverloadJoint] = {}

    def push(self, rows: npt.NDArray[np.void], missed: int = 0) -> list[OverloadNow]:
        """Return what begins or ends with these rows; ``missed`` rows were lost before them."""
        if not len(rows):
            return []
        past = rows[:0] if missed or self._rows is None else self._rows
        window = np.concatenate([past, rows])
        self._rows = window[-_PAST:]
        if len(window) < _PAST:
            return []
        time, values = measured(window, self._names)
        found = self._live.evaluated(time, values)
        if found is None:  # a gap: nothing is known of these samples
            return []
        own = scores_in(found, 0)
        fresh = own.t > self._judged
        self._judged = max(self._judged, float(own.t[-1]))
        hits = list[OverloadNow]()
        for lasting, scores, residual in zip(own.lasting[fresh], own.scores[fresh], own.residual[fresh], strict=True):
            hits += self._step(lasting, scores, residual, float(time[-1]))
            self._note(lasting / self.limits, residual)
        return hits

    def nearest(self) -> list[OverloadJoint]:
        """Return joints in the machine's order, since the last call; none that could not be judged."""
        found, self._nearest = self._nearest, {}
        return [found[joint] for joint in sorted(found)]

    def _note(self, shares: FloatArray, residual: FloatArray) -> None:
        for joint, share in enumerate(shares.tolist()):
            before = self._nearest.get(joint)
            if np.isfinite(share) and (before is None or share > before.share):
                name = self._live.model.joints[joint]
                self._nearest[joint] = OverloadJoint(name, float(residual[joint]), self._units[joint], share)

    def _step(self, lasting: FloatArray, scores: FloatArray, residual: FloatArray, now: float) -> list[OverloadNow]:
        share = lasting / self.limits
        joint = int(np.argmax(share))
        if share[joint] > 1.0:
            begins, self._since = self._since is None, 0
            if not begins:
                return []
            name, limit = self._live.model.joints[joint], float(self.limits[joint])
            return [
                OverloadNow(True, now, name, float(residual[joint]), self._units[joint], float(scores[joint]), limit)
            ]
        if self._since is not None:
            self._since += 1
            if self._since > self._quiet:
                self._since = None
                return [OverloadNow(False, now, "", 0.0, "", 0.0, 0.0)]
        return []
