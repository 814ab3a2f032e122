"""Sources of a monitor: joint efforts by the model of the mechanics, or rod speeds by identified valves.

Both cut the live signals into blocks and give a few statistics of measured minus predicted for each; the watcher sums
these up, and each adds results of its own.
"""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Mapping
from dataclasses import asdict
from itertools import takewhile
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

from daq import Machine, Recording
from daq.arrays import FloatArray
from fitting.model.uses.payload import WINDOW_S, weighed
from fitting.valve import drift
from server.identifications.live_model import JointBlock, LiveModel, NotLiveError
from server.monitor.cusum import Sums
from server.monitor.drift_watcher import Watcher
from server.monitor.monitor_order import Rules

STATISTICS = ("offset", "direction", "level")
#: Share of a block during which a drive has to move for the block to count.
MOVING_SHARE = 0.5


def scores(block: JointBlock) -> Mapping[str, float] | None:
    """Project a joint's block, in the joint's effort unit, on one direction per kind of change; None at rest.

    A residual's mean alone misses the commonest change of all: more friction pushes one way while the drive goes forth
    and the other way while it comes back, and the mean over a stroke is zero. So the residual ``e`` of a block is
    projected on a direction ``w``: ``z = sum(w e) / sqrt(sum(w^2))``, which has the variance of one sample whatever
    ``w`` is, where ``e`` is white. Directions:

    - ``offset``: 1, a bias of a sensor or a load that is always there;
    - ``direction``: the sign of the speed, friction;
    - ``level``: the predicted effort about its mean, a gain, or a load that moves with the arm.

    A direction that the motion does not have (always forth: ``direction`` is ``offset``) is left out.
    """
    moving = block.moving
    if np.count_nonzero(moving) < max(3, MOVING_SHARE * len(moving)):
        return None
    e = block.residual[moving]
    weights = {
        "offset": np.ones(len(e)),
        "direction": block.direction[moving],
        "level": block.predicted[moving] - block.predicted[moving].mean(),
    }
    scale = max(float(np.abs(block.predicted[moving]).max()), 1e-12)
    found = {}
    for name in STATISTICS:
        w = weights[name] / scale if name == "level" else weights[name]
        norm = float(np.linalg.norm(w))
        if norm > 0.05 * np.sqrt(len(e)):
            found[name] = float(w @ e) / norm
    return found


def effective(block: JointBlock) -> float:
    """Compute the RMS of a joint's residual while it moves, in its effort unit; NaN while it rests."""
    e = block.residual[block.moving]
    return float(np.sqrt(np.mean(e**2))) if len(e) else float("nan")


class Scored(NamedTuple):
    """Of a joint in a block: its statistics, None at rest, and the residual's root mean square, NaN at rest.

    ``slack``: by how much the model may be off in each statistic where it was not identified.
    """

    statistics: Mapping[str, float] | None
    residual: float
    slack: Mapping[str, float]


class Followed(Protocol):
    """Interface of a model to the watching process.

    Attributes
    ----------
    units : of the residual, by joint
    statistics : names of what is summed up
    overlap : samples before a block that its filters and its memory need
    delay_s : s by which the residual is late
    """

    units: Mapping[str, str]
    statistics: tuple[str, ...]
    overlap: int
    delay_s: float

    def block_samples(self, seconds: float) -> int:
        """Count a block's samples in about so many seconds."""

    def look(self, time: FloatArray, values: dict[str, FloatArray]) -> Mapping[str, Scored] | None:
        """Evaluate a window of samples; None where something of it is missing."""

    def of_machine(self) -> dict[str, Any]:
        """Return what else the last blocks show of the machine."""
        return {}

    def of_joint(self, joint: str, watcher: Watcher) -> dict[str, Any]:
        """Return what else they show of a joint, to whoever has just watched the last one."""
        return {}


class Efforts(Followed):
    """Joint efforts, and the mass at the tip."""

    statistics = STATISTICS

    def __init__(self, model: LiveModel, rules: Rules) -> None:
        self._model = model
        self.units = {joint.name: joint.effort_unit for joint in model.machine.joints}
        self.overlap, self.delay_s = model.overlap, model.delay_s
        self._recent = deque[tuple[JointBlock, ...]](maxlen=max(1, round(WINDOW_S / rules.block_s)))

    def block_samples(self, seconds: float) -> int:
        """Count them as the model does."""
        return self._model.block_samples(seconds)

    def look(self, time: FloatArray, values: dict[str, FloatArray]) -> Mapping[str, Scored] | None:
        """Compute statistics of every joint."""
        blocks = self._model.evaluate(time, values)
        if blocks is None:
            self._recent.clear()
            return None
        self._recent.append(blocks)
        return {name: Scored(scores(own), effective(own), {}) for name, own in zip(self.units, blocks, strict=True)}

    def of_machine(self) -> dict[str, Any]:
        """Estimate the mass at the tip; None where too little moved."""
        parts = [
            [np.column_stack([getattr(joint, key) for joint in block]) for key in ("residual", "tip", "moving")]
            for block in self._recent
        ]
        if not parts:
            return {"payload": None}
        residual, tip, moving = (np.concatenate(own) for own in zip(*parts, strict=True))
        found = weighed(residual, tip, moving)
        return {"payload": None if found is None else asdict(found)}


class Speeds(Followed):
    """Rod speeds, and which numbers of a valve have moved since it drifts.

    Raises
    ------
    NotLiveError
        If the report is gone, or is of a version that kept no fit, or the machine has changed, at once or at a look.
    """

    statistics = drift.STATISTICS

    def __init__(self, report: Path, machine: Machine, rules: Rules) -> None:
        try:
            axes = json.loads(report.read_text(encoding="utf-8"))["axes"]
            self._kept = {joint: drift.Kept.from_json(own["fit"]) for joint, own in axes.items()}
            self._errors = {joint: float(own["errors"]["handed_out"]) for joint, own in axes.items()}
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise NotLiveError("server.valve_json_calibration_cannot", error=f"{error!r}") from None
        self._machine = machine
        for joint, own in self._kept.items():
            if machine.channel("command", joint) is None:
                raise NotLiveError("server.machine_file_no_command", joint=joint)
            if "warm_up" in own.structure.effects and machine.channel("oil_temperature", None) is None:
                raise NotLiveError("server.warming_up_follows_recording", joint=joint)
        self.units = dict.fromkeys(self._kept, "m/s")
        bank, rate = next(iter(self._kept.values())).bank(machine.rate_hz), machine.rate_hz
        past = max(own.shape["delay"] for own in self._kept.values()) + drift.PAST
        self.overlap = 2 * (bank.margin + bank.half) + round(past * rate)
        self.delay_s = (bank.margin + bank.half) / rate
        self._decimation, self._rate, self._last = bank.decimation, rate, dict[str, drift.Block]()
        self._block = self.block_samples(rules.block_s)
        #: By joint its last blocks, each with where the sums of its statistics stood after it.
        self._recent = {joint: deque[tuple[drift.Block, Mapping[str, Sums]]](maxlen=rules.learn) for joint in axes}

    def block_samples(self, seconds: float) -> int:
        """Count whole rows after decimation."""
        return self._decimation * max(1, round(seconds * self._rate / self._decimation))

    def look(self, time: FloatArray, values: dict[str, FloatArray]) -> Mapping[str, Scored] | None:
        """Compute statistics of every axis."""
        machine, rate = self._machine, self._rate
        window = Recording(machine.name, "operation", "live", "", rate, np.asarray(time), values)
        blocks = {joint: drift.block_of(machine, joint, own, window, self._block) for joint, own in self._kept.items()}
        self._last = {joint: own for joint, own in blocks.items() if own is not None}
        for joint, own in self._last.items():
            if not np.isfinite(own.score).all():
                raise NotLiveError("server.pressures_valve_identified_no", joint=joint)
        return {
            joint: Scored(own.statistics, own.residual, own.slack(self._errors[joint]))
            for joint, own in self._last.items()
        } or None

    def of_joint(self, joint: str, watcher: Watcher) -> dict[str, Any]:
        """Find which numbers of its valve have moved, in the blocks since its largest sum began to grow."""
        series = {name: watcher.series[joint, name] for name in self.statistics}
        recent = self._recent[joint]
        if joint in self._last:
            recent.append((self._last[joint], {name: own.sums for name, own in series.items()}))
        if joint not in watcher.drifting:
            return {}
        largest = watcher.joint(joint)["statistic"]
        side = "up" if series[largest].sums.up >= series[largest].sums.down else "down"
        grown = takewhile(lambda own: getattr(own[1][largest], side) > 0.0, reversed(recent))
        blocks = [block for block, _ in grown if block.statistics is not None]
        usual = [(0.0, 0.0) if own.usual is None else (own.usual.mean, own.usual.error) for own in series.values()]
        return {"moved": [asdict(own) for own in drift.moved_numbers(blocks, *np.array(usual).T)]}
