"""``python -m server.monitor.monitor_child ORDER.json``: watches one machine until its ring buffer ends.

It reads the ring at its own pace, at low priority, and writes one line per block; nothing waits for
it. The lines are those of :mod:`server.platform.processes.children`, with what was found as JSON in ``text``.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from time import monotonic
from typing import Any

import numpy.typing as npt

from daq import load_machine
from daq.acquisition.ring import RingReader
from daq.whole_files import write_whole
from server.identifications.live_model import LiveModel, NotLiveError
from server.monitor.drift_watcher import Watcher
from server.monitor.followed import Efforts, Followed, Speeds
from server.monitor.monitor_order import Order
from server.monitor.overload_watch import OverloadWatch
from server.monitor.residual_blocks import Windows, measured
from server.platform.processes.child_speech import ended, send

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
