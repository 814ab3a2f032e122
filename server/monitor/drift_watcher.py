"""Learns what a machine's residual usually is, then watches for a change. Pure: blocks in, state out.

Each statistic of each joint (:mod:`server.monitor.followed`) is a series with one number per block in which the
joint moved. *Learning*: the first ``learn`` of them give its mean, its first-order autocorrelation and the standard
deviation of what that leaves. *Watching*: new numbers are whitened by that autocorrelation, standardised, and summed
(:mod:`server.monitor.cusum`).

What was learnt is an estimate, and an error of it would be taken for a drift in the long run (Jensen et al. 2006,
*Effects of parameter estimation on control chart properties*). Therefore the mean's allowance is widened by two of its
standard errors, and the standard deviation is the upper end of its 95 % interval: the stated rate is what happens in
the worst of forty cases, not on average.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
import scipy

from server.monitor import cusum
from server.monitor.cusum import ALLOWANCE, Sums
from server.monitor.monitor_order import Rules

State = Literal["learning", "watching", "drift"]
Key = tuple[str, str]  # joint, statistic
YEAR_S = 365.25 * 86400


def threshold(rules: Rules, statistics: int) -> float:
    """Compute the threshold of each of so many statistics: each gets an equal share of the false alarms."""
    return cusum.threshold_for(YEAR_S / rules.block_s * statistics / rules.false_alarms_per_year)


@dataclass(frozen=True)
class Usual:
    """Baseline of one statistic: mean, autocorrelation, standard deviation of the innovations, blocks seen."""

    mean: float
    correlation: float
    std: float
    blocks: int

    @classmethod
    def of(cls, values: tuple[float, ...]) -> Usual:
        """Estimate it from the numbers of the learning time."""
        z = np.asarray(values)
        centred = z - z.mean()
        variance = float(centred @ centred) / len(z)
        correlation = float(centred[1:] @ centred[:-1]) / len(z) / variance if variance > 0 else 0.0
        correlation = min(max(correlation, 0.0), 0.8)
        innovations = centred[1:] - correlation * centred[:-1]
        n = len(innovations) - 2
        worst = math.sqrt(n / float(scipy.stats.chi2.ppf(0.025, n)))
        std = float(np.sqrt(innovations @ innovations / n)) * worst
        return cls(float(z.mean()), correlation, max(std, 1e-12), len(z))

    @property
    def error(self) -> float:
        """Standard error of the mean."""
        return self.std / (1.0 - self.correlation) / math.sqrt(self.blocks)

    @property
    def allowance(self) -> float:
        """The allowance, with room for the error of the mean."""
        return ALLOWANCE + 2.0 / math.sqrt(self.blocks)


@dataclass(frozen=True)
class Series:
    """One statistic: what was seen while learning, what is usual, where its sums stand."""

    seen: tuple[float, ...] = ()
    usual: Usual | None = None
    last: float | None = None
    sums: Sums = field(default_factory=Sums)

    def step(self, value: float | None, threshold: float, learn: int, slack: float = 0.0) -> Series:
        """Return the series after one block; None for a block in which the joint rested.

        ``slack``: by how much the model may be off there, beyond what was learnt; that much is no change.
        """
        if value is None:
            return replace(self, last=None)
        if self.usual is None:
            seen = (*self.seen, value)
            return replace(self, seen=seen) if len(seen) < learn else replace(self, seen=(), usual=Usual.of(seen))
        usual = self.usual
        centred = value - usual.mean
        # After a rest there is no last number; the first one has the variance of the series itself.
        if self.last is None:
            z = centred * math.sqrt(1.0 - usual.correlation**2) / usual.std
        else:
            z = (centred - usual.correlation * self.last) / usual.std
        z = math.copysign(max(abs(z) - slack / usual.std, 0.0), z)
        return replace(self, last=centred, sums=cusum.step(self.sums, z, threshold, usual.allowance))


@dataclass(frozen=True)
class Watcher:
    """All statistics of a machine."""

    rules: Rules
    threshold: float
    series: Mapping[Key, Series]
    drifting: frozenset[str] = frozenset()

    @classmethod
    def begin(cls, joints: tuple[str, ...], statistics: tuple[str, ...], rules: Rules) -> Watcher:
        """Return a watcher that knows nothing yet."""
        keys = [(joint, statistic) for joint in joints for statistic in statistics]
        return cls(rules, threshold(rules, len(keys)), {key: Series() for key in keys})

    def step(
        self, block: Mapping[str, Mapping[str, float] | None], slack: Mapping[str, Mapping[str, float]] | None = None
    ) -> Watcher:
        """Update by one block: per joint its scores, None where it rested, and by how much these may be off."""
        slack = slack or {}
        series = {
            (joint, statistic): own.step(
                None if (found := block.get(joint)) is None else found.get(statistic),
                self.threshold,
                self.rules.learn,
                slack.get(joint, {}).get(statistic, 0.0),
            )
            for (joint, statistic), own in self.series.items()
        }
        joints = {joint for joint, _ in series}
        drifting = frozenset(
            joint
            for joint in joints
            # It comes at the threshold and goes at half of it.
            if self._largest(series, joint)[1] >= self.threshold * (0.5 if joint in self.drifting else 1.0)
        )
        return replace(self, series=series, drifting=drifting)

    @staticmethod
    def _largest(series: Mapping[Key, Series], joint: str) -> tuple[str, float]:
        own = {statistic: s.sums.larger for (name, statistic), s in series.items() if name == joint}
        return max(own.items(), key=lambda item: item[1])

    @property
    def state(self) -> State:
        """``drift`` if a joint drifts; ``watching`` once a statistic is known well enough; else ``learning``."""
        if self.drifting:
            return "drift"
        return "watching" if any(s.usual is not None for s in self.series.values()) else "learning"

    def joint(self, name: str) -> dict[str, Any]:
        """Describe one joint: its largest sum, of which statistic, threshold, and its statistics' false alarms."""
        statistic, largest = self._largest(self.series, name)
        own = [s for (joint, _), s in self.series.items() if joint == name]
        blocks = YEAR_S / self.rules.block_s
        known = sum(s.usual is not None for s in own)
        return {
            "joint": name,
            "cusum": largest,
            "statistic": statistic,
            "threshold": self.threshold,
            "false_alarms_per_year": blocks * known / cusum.run_length(self.threshold),
            "learnt": min(1.0, max((len(s.seen) / self.rules.learn if s.usual is None else 1.0) for s in own)),
        }

    def memory(self) -> dict[str, Any]:
        """Return all that it knows, as plain JSON: what was seen and learnt, its sums, and which joints drift."""
        series = {
            f"{joint}/{statistic}": {
                "seen": list(own.seen),
                "usual": None if own.usual is None else vars(own.usual),
                "sums": vars(own.sums),
            }
            for (joint, statistic), own in self.series.items()
        }
        return {"series": series, "drifting": sorted(self.drifting)}

    def remembering(self, memory: Mapping[str, Any]) -> Watcher:
        """Restore an earlier watcher; between the two, time is missing, so no number is the last one.

        Raises
        ------
        KeyError, TypeError, ValueError
            If that is no memory.
        """
        series = {}
        for (joint, statistic), own in self.series.items():
            kept = memory["series"].get(f"{joint}/{statistic}")
            if kept is not None:
                usual = None if kept["usual"] is None else Usual(**kept["usual"])
                own = Series(tuple(float(value) for value in kept["seen"]), usual, None, Sums(**kept["sums"]))
            series[joint, statistic] = own
        joints = {joint for joint, _ in series}
        return replace(self, series=series, drifting=frozenset(memory["drifting"]) & joints)
