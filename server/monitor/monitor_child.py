"""``python -m server.monitor.monitor_child ORDER.json``: watches one machine until its ring buffer ends.

It reads the ring at its own pace, at low priority, and writes one line per block; nothing waits for
it. The lines are those of :mod:`server.platform.processes.children`, with what was found as JSON in ``text``.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np
import numpy.typing as npt

from daq import load_machine
from daq.acquisition.ring import RingReader
from daq.arrays import FloatArray, RowArray
from daq.whole_files import write_whole
from fitting.model.uses.overload import QUIET_S, delay_s, quick, scores_in, thresholds
from server.identifications.live_model import LiveModel, NotLiveError
from server.monitor.drift_watcher import Watcher
from server.monitor.followed import Efforts, Followed, Speeds
from server.monitor.monitor_order import Order, OverloadJoint, OverloadNow
from server.monitor.residual_blocks import Windows, measured
from server.platform.processes.child_speech import ended, send

#: Samples before the newest that are looked at again, for what a window tells of its sensors.
_PAST = 48


class OverloadWatch:
    """Watches rows of a ring buffer: every new sample against its band, within a tenth of a second.

    The decisions are those of :mod:`fitting.model.uses.overload`, on windows that end with the newest sample.

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
        self._rows: RowArray | None = None
        self._judged = -np.inf  # s of machine time up to which samples were judged
        self._since: int | None = None  # samples since the last exceedance; None while nothing is wrong
        self._nearest: dict[int, OverloadJoint] = {}

    def push(self, rows: RowArray, missed: int = 0) -> list[OverloadNow]:
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


#: Seconds between two looks at the ring.
LOOK_S = 0.25
POLL_S = 0.01
#: Seconds between two words on how near the joints are to an overload.
NEAR_S = 1.0
#: Blocks (of 2 s) after which its state is written down: what a kill costs at most.
REMEMBER_BLOCKS = 15
Send = Callable[[Mapping[str, Any]], None]


def watch(
    followed: Followed, names: tuple[str, ...], order: Order, windows: Iterator[npt.NDArray[Any]], send: Send
) -> None:
    """Watch ``windows`` until they end; report what was found in each.

    Parameters
    ----------
    names : of the channels, in the order of the ring's rows
    """
    units = followed.units
    watcher = _remembered(order.memory, Watcher.begin(tuple(units), followed.statistics, order.rules))
    for number, rows in enumerate(windows, 1):
        time, values = measured(rows, names)
        seen = followed.look(time, values) or {}  # nothing after a gap: nothing is known of these seconds
        watcher = watcher.step(
            {joint: own.statistics for joint, own in seen.items()}, {joint: own.slack for joint, own in seen.items()}
        )
        found: list[dict[str, Any]] = [
            {
                **watcher.joint(joint),
                "residual": seen[joint].residual if joint in seen else None,
                "unit": unit,
                **followed.of_joint(joint, watcher),
            }
            for joint, unit in units.items()
        ]
        send(
            {
                "state": watcher.state,
                "joints": [{k: None if v != v else v for k, v in joint.items()} for joint in found],
                "drifting": sorted(watcher.drifting),
                "time": float(time[-1]),
                "delay_s": followed.delay_s,
                **followed.of_machine(),
            }
        )
        if number % REMEMBER_BLOCKS == 0:
            _remember(order.memory, watcher)
    _remember(order.memory, watcher)


def _remember(path: Path, watcher: Watcher) -> None:
    write_whole(path, json.dumps(watcher.memory()).encode())


def _remembered(path: Path, fresh: Watcher) -> Watcher:
    """Load the watcher that was remembered; a fresh one without a readable memory."""
    try:
        return fresh.remembering(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return fresh


def _windows(
    ring: RingReader, windows: Windows, overload: OverloadWatch | None, send: Send
) -> Iterator[npt.NDArray[Any]]:
    """Yield windows of the drift's blocks; report an overload at once, the joints' margins each second."""
    reported = monotonic()
    while True:
        if not ring.wait(LOOK_S, poll=POLL_S) and (ring.closed or not ring.writer_alive):
            return
        read = ring.read()
        for hit in () if overload is None else overload.push(read.rows, read.missed):
            send({"overload": asdict(hit)})
        if overload is not None and monotonic() - reported >= NEAR_S:
            reported = monotonic()
            send({"overload_joints": [asdict(joint) for joint in overload.nearest()]})
        yield from windows.push(read.rows, read.missed)


def run(order: Order, send: Send) -> None:
    """Load the model and watch the ring until it ends.

    Raises
    ------
    NotLiveError, HilfitError
        If this calibration cannot be watched on this machine.
    """
    machine = load_machine(order.machine)
    names = tuple(channel.name for channel in machine.channels)
    overload, first = None, dict[str, Any]()
    if order.of == "valves":
        followed: Followed = Speeds(order.model, machine, order.rules)
    else:
        model = LiveModel.load(order.model)
        missing = {channel.name for channel in model.machine.channels} - set(names)
        if missing:
            raise NotLiveError("server.machine_file_no_channel", missing=min(missing))
        followed = Efforts(model, order.rules)
        with suppress(NotLiveError):  # of long ago, or of too short recordings: the drift is watched still
            overload = OverloadWatch(model, names, order.rules.false_overloads_per_hour)
        first = {"payload": None, "overload_delay_s": None if overload is None else overload.delay_s}
    windows = Windows(followed.overlap, followed.block_samples(order.rules.block_s))
    first |= {"state": "learning", "joints": [], "drifting": [], "time": None, "delay_s": followed.delay_s}
    with RingReader(order.ring_name) as ring:
        send(first)
        watch(followed, names, order, _windows(ring, windows, overload, send), send)


def main(arguments: list[str]) -> int:
    """Run the process."""
    order = Order.from_json(Path(arguments[0]).read_text(encoding="utf-8"))
    return ended(lambda: run(order, lambda found: send(fraction=0.0, text=json.dumps(found))))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
