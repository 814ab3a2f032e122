"""``python serve_lever.py DATA_DIR PORT``: a real server of a lever that moves; prints its address.

Files in the data directory steer it: ``stale`` makes the torque stale, ``steer.json`` the stages of identifications
(see ``fake_stages.py``).
"""

from __future__ import annotations

import json
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from server.machines.machine_resource import LAUNCH

sys.path.insert(0, str(Path(__file__).parents[1] / "server"))

import numpy as np
from service_fakes import ANY_PLACE, FakeFeed, Fakes, children_as_important_as_tests

from daq import Machine
from daq.acquisition.ring import RingWriter, ring_buffer
from daq.frames.frame import Frame, row_dtype
from server.composition.serve import serve
from server.platform.settings import Settings

RATE_HZ = 50.0
FRESH, STALE = 0, 1


class MovingFeed(FakeFeed):
    """Writes a frame each 20 ms: the angle swings between -30 and 30 degrees in 10 s."""

    def __init__(self, ring_name: str, data_dir: Path) -> None:
        super().__init__(ring_name)
        self._data_dir = data_dir
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="moving", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End writing; the ring may go then."""
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        writer = RingWriter(self.ring_name)
        start, cycle, last = time.monotonic(), 8, time.monotonic()
        while not self._stop.wait(1 / RATE_HZ):
            now = time.monotonic()
            t = 0.16 + (now - start)
            stale = (self._data_dir / "stale").exists()
            last = last if stale else now
            torque = 20 * np.cos(t)
            frame = Frame(
                cycle=cycle,
                monotonic_ns=time.monotonic_ns(),
                utc_ns=time.time_ns(),
                time=t,
                values=np.array([np.pi / 6 * np.sin(2 * np.pi * t / 10), torque]),
                ages=np.array([0.001, 0.001 + now - last]),
                quality=np.array([FRESH, STALE if stale else FRESH], dtype=np.uint8),
            )
            writer.write(frame)
            cycle += 1
        writer.close()


def serve_lever(data_dir: Path, port: int) -> None:
    """Serve until SIGTERM."""

    @contextmanager
    def launch(machine: Machine) -> Iterator[MovingFeed]:
        with ring_buffer(row_dtype(len(machine.channels)), 3000) as name:
            feed = MovingFeed(name, data_dir)
            try:
                yield feed
            finally:
                feed.stop()

    def ready(url: str) -> None:
        print(json.dumps({"url": url}), flush=True)

    with children_as_important_as_tests():
        serve(Settings(data_dir=data_dir, port=port, bus_places=ANY_PLACE), ready, Fakes().parts | {LAUNCH: launch})


if __name__ == "__main__":
    serve_lever(Path(sys.argv[1]), int(sys.argv[2]))
