"""The process of the plant and of the arm's own controller.

It advances by one acquisition period for each ``STEP`` from the hub and by nothing else. Periods are computed some
ahead, in the time between two SYNCs, so the answer to ``STEP`` is immediate.

The controller watches an inbox directory for motion files (:mod:`sim_backends.plant.motion`). A file that appears there
(by an atomic rename, as :func:`~sim_backends.plant.motion.write_motion` does) is read, moved to ``accepted`` or
``rejected`` beside the inbox, and followed after those that came before it. What the controller does stands in a JSON
file that is replaced at every change::

    {"state": "idle" | "moving_to_start" | "following" | "done",
     "motion": "train-1", "rods": "pinned", "cycle": 1234,       # cycle since which this is so
     "queue": ["train-2"],                                       # not begun yet
     "followed": {"unloaded": [210, 1209], "train-1": [1234, null]},   # first and last cycle; null: not over
     "rejected": {"bad": "bad.csv: not a motion file; ..."}}

Cycles count the SYNCs since power-on; the first one is 1.

What is undeclared comes over stdin and stays here: no argument, environment, file or message carries it.
"""

from __future__ import annotations

import json
import selectors
import socket
import sys
import traceback
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from daq.errors import HilfitError
from daq.machine.machine_file import Machine, parse_machine
from sim_backends import backplane
from sim_backends.child import Orders, report
from sim_backends.plant.motion import read_motion
from sim_backends.plant.plant import Plant
from sim_backends.plant.truth import SensorQuality, Truth
from sim_backends.undeclared import EffectSpec

BLOCK = 10  # periods computed at once: most of the cost of a period is the cost of a block
DEMO = (EffectSpec("position_dependent_friction", "joint2", 220.0),)


_UNDECLARED = {"undeclared", "effects.py"}  # places in the sources that have the names of effects


@dataclass(frozen=True)
class _Period:
    state: bytes
    phase: str
    motion: str
    pinned: bool


class _Served(Protocol):
    """A plant with its controller, as the process needs it."""

    @property
    def controller(self) -> Any:
        """Object with ``follow(motion, name)``, ``phase``, ``motion`` and ``pinned``."""
        ...

    def coming(self, most: int) -> int:
        """Count the periods, at most ``most``, that end with the controller doing what it does then."""
        ...

    def advance(self, periods: int) -> Any:
        """Measure values (periods, channels) in SI."""
        ...


#: Reads a motion file, and checks it for a machine.
Reader = Callable[[Path, Machine], Any]


class _PlantServer:
    """The plant behind its packets."""

    def __init__(
        self,
        machine: Machine,
        plant: _Served,
        hub: socket.socket,
        inbox: Path,
        status: Path,
        read: Reader,
    ) -> None:
        self._machine, self._plant, self._hub, self._read = machine, plant, hub, read
        self._inbox, self._status_path = inbox, status
        self._ready: deque[_Period] = deque()
        self._cycle = 0
        self._names: list[str] = []
        self._status: dict[str, Any] = {
            "state": "idle", "motion": "", "rods": "pinned", "cycle": 0, "queue": [], "followed": {}, "rejected": {},
        }  # fmt: skip
        self._write_status()
        self._hub.send(backplane.STATE + backplane.pack_state(0, self._values(plant.advance(1))))

    @staticmethod
    def _values(row: Any) -> bytes:
        return bytes(np.ascontiguousarray(row, dtype="<f8").tobytes())

    def _compute(self) -> None:
        """Compute the next periods, at most to the end of the controller's current segment."""
        self._look_into_inbox()
        rows = self._plant.advance(self._plant.coming(BLOCK))
        controller = self._plant.controller
        self._ready.extend(
            _Period(self._values(row), controller.phase, controller.motion, controller.pinned) for row in rows
        )

    def _step(self) -> None:
        if not self._ready:
            self._compute()
        period = self._ready.popleft()
        self._cycle += 1
        if period.phase != self._status["state"] or period.motion != self._status["motion"]:
            self._change(period)
        self._hub.send(backplane.STATE + backplane.pack_state(self._cycle, period.state))

    def _change(self, period: _Period) -> None:
        followed = self._status["followed"]
        if self._status["state"] == "following":
            followed[self._status["motion"]][1] = self._cycle - 1
        if period.phase == "following":
            followed[period.motion] = [self._cycle, None]
        if period.motion in self._names:
            self._names.remove(period.motion)
        self._status |= {
            "state": period.phase, "motion": period.motion, "rods": "pinned" if period.pinned else "unpinned",
            "cycle": self._cycle, "queue": list(self._names),
        }  # fmt: skip
        self._write_status()

    def _look_into_inbox(self) -> None:
        files = [p for p in self._inbox.iterdir() if p.is_file() and not p.name.startswith(".")]
        for path in sorted(files, key=lambda p: (p.stat().st_mtime_ns, p.name)):
            try:
                motion = self._read(path, self._machine)
            except HilfitError as error:
                self._status["rejected"][path.stem] = str(error).replace(str(path), path.name)
                path.replace(self._inbox.parent / "rejected" / path.name)
            else:
                self._plant.controller.follow(motion, path.stem)
                self._names.append(path.stem)
                path.replace(self._inbox.parent / "accepted" / path.name)
            self._status["queue"] = list(self._names)
        if files:
            self._write_status()

    def _write_status(self) -> None:
        temporary = self._status_path.with_name(f".{self._status_path.name}.part")
        temporary.write_text(json.dumps(self._status), encoding="utf-8")
        temporary.replace(self._status_path)

    def run(self, orders: Orders) -> None:
        """Serve until the parent closes its end or the hub is gone."""
        selector = selectors.DefaultSelector()
        selector.register(self._hub, selectors.EVENT_READ)
        selector.register(orders, selectors.EVENT_READ)
        while not orders.closed:
            idle = len(self._ready) < BLOCK // 2 and self._cycle > 0
            events = selector.select(0 if idle else None)
            for key, _ in events:
                if key.fileobj is orders:
                    orders.work_off({})
                else:
                    if not self._hub.recv(backplane.PACKET):
                        return
                    self._step()
            if not events and idle:
                self._compute()


def ended_quietly(run: Callable[[], None]) -> None:
    """Run a plant's process; a failure leaves one line in the log.

    Without the frames of undeclared effects: even a log must not name them.
    """
    try:
        run()
    except (BrokenPipeError, ConnectionResetError):  # the hub went first: the machine is being switched off
        return
    except Exception as error:
        frames = [f for f in traceback.extract_tb(error.__traceback__) if not _UNDECLARED & set(Path(f.filename).parts)]
        place = f"{Path(frames[-1].filename).name}:{frames[-1].lineno}" if frames else "start"
        print(f"plant: {type(error).__name__} under {place}", file=sys.stderr)
        raise SystemExit(1) from None


def serve(build: Callable[[Mapping[str, Any], Machine], _Served], read: Reader = read_motion) -> None:
    """Serve what ``build`` makes of the configuration and the machine, until the parent closes its end."""
    orders = Orders()
    configuration = orders.configuration()
    machine = parse_machine(configuration["machine"])
    plant = build(configuration, machine)
    hub = backplane.adopt(configuration["hub"])
    server = _PlantServer(machine, plant, hub, Path(configuration["inbox"]), Path(configuration["status"]), read)
    report({"ready": {}})
    server.run(orders)


def _build(configuration: Mapping[str, Any], machine: Machine) -> Plant:
    undeclared = configuration["undeclared"]
    specs = DEMO if undeclared == "demo" else [EffectSpec(*item) for item in undeclared]
    return Plant(
        machine,
        Truth.from_dict(configuration["truth"]),
        undeclared=specs,
        quality=SensorQuality(**configuration["quality"]),
        rng=np.random.default_rng(configuration["seed"]),
    )


if __name__ == "__main__":
    ended_quietly(lambda: serve(_build))
