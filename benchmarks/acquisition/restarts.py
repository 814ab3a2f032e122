"""What is restarted or killed beside acquisition: a gateway that we lead through or listen to, its own process."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import struct
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

from benchmarks.acquisition.channels import Devices, machine_of
from benchmarks.acquisition.masters import PATIENCE_S, Row, Seen
from benchmarks.acquisition.traces import listening
from daq.acquisition.acquisition import AcquisitionProcess
from daq.acquisition.recorder import Recorder
from daq.acquisition.ring import RingReader
from daq.errors import AcquisitionError
from daq.quality import Quality
from daq.recordings.recording_files import read_table

NODES = 2
DOWN_S = (0.3, 2.5)  # that a gateway is away
IDLE = 0.02  # of a core that all threads but the cycle's may take meanwhile


def _beside_the_cycle_s(pid: int) -> float:
    """Read the processor time of all threads of a process but its first, s."""
    tasks = [task for task in Path(f"/proc/{pid}/task").iterdir() if task.name != str(pid)]
    return sum(int((task / "schedstat").read_text().split()[0]) for task in tasks) / 1e9


def _until_fresh(ring: RingReader) -> tuple[float, int]:
    """Time until the first of five rows that are all fresh, s; count fresh values that are not what was sent.

    None may be between them but ones with values that only came late: that is the computer, not what was restarted.
    """
    began, first, good, wrong = time.monotonic(), 0.0, 0, 0
    while good < 5 and time.monotonic() - began < PATIENCE_S:
        ring.wait(0.5)
        for row in ring.read().rows:
            fresh = row["quality"] == Quality.FRESH
            wrong += int((fresh & (np.abs(row["values"] - VALUES) > 1e-3 * VALUES)).sum())
            if fresh.all():
                good += 1
                first = row["monotonic_ns"] / 1e9 if good == 1 else first
            elif not np.isin(row["quality"], (Quality.FRESH, Quality.LATE, Quality.STALE)).all():
                good = 0
    return (first if good >= 5 else time.monotonic()) - began, wrong


#: What every device says, in SI: 42 bar, 42 rad, 42 degC.
VALUES = np.array([42e5, 42e5, 42.0, 42.0 + 273.15])


def _led(random: np.random.Generator) -> Seen:
    """Cut the power of the gateway and of the nodes behind it."""
    seen = Seen()
    with Devices(1, NODES) as first:
        machine = machine_of(f"led{first.pid}", first.ports[0], NODES)
        with AcquisitionProcess(machine) as acquisition, RingReader(acquisition.ring_name) as ring:
            _until_fresh(ring)
            time.sleep(random.uniform(0, 0.5))
            first.kill()
            time.sleep(random.uniform(*DOWN_S))
            with Devices(1, NODES, port=first.ports[0]):
                seen.recovery, seen.wrong = _until_fresh(ring)
    return seen


class _Gateway(threading.Thread):
    """Sends the PDOs of nodes that another master leads, to one client at a time."""

    def __init__(self, port: int = 0) -> None:
        super().__init__(daemon=True)
        self._server = socket.create_server(("127.0.0.1", port))
        self.port = self._server.getsockname()[1]
        self._ended = threading.Event()
        self.start()

    def run(self) -> None:
        """Run until it is ended."""
        self._server.settimeout(0.05)
        while not self._ended.is_set():
            with contextlib.suppress(OSError):
                client, _ = self._server.accept()
                with client:
                    client.sendall(b"< hi >")
                    for _ in range(2):
                        client.recv(100)
                        client.sendall(b"< ok >")
                    while not self._ended.wait(0.02):
                        for node in range(1, NODES + 1):
                            data = struct.pack("<ff", 42.0, 42.0).hex()
                            client.sendall(f"< frame {0x180 + node:03X} {time.time():.6f} {data} >".encode())
        self._server.close()

    def end(self) -> None:
        """Close all sockets."""
        self._ended.set()
        self.join()


def _listened(random: np.random.Generator) -> Seen:
    """Restart a gateway that is only listened to; meanwhile the process is as good as idle."""
    seen, gateway = Seen(), _Gateway()
    try:
        machine = listening(machine_of(f"listened{gateway.port}", gateway.port, NODES))
        with AcquisitionProcess(machine) as acquisition, RingReader(acquisition.ring_name) as ring:
            _until_fresh(ring)
            time.sleep(random.uniform(0, 0.5))
            gateway.end()
            time.sleep(0.2)
            before, began, down = _beside_the_cycle_s(ring.writer_pid), time.monotonic(), random.uniform(0.5, 2.5)
            time.sleep(down)
            busy = (_beside_the_cycle_s(ring.writer_pid) - before) / (time.monotonic() - began)
            seen.failed = f"{100 * busy:.1f} % of a core while it is away" if busy > IDLE else ""
            gateway = _Gateway(gateway.port)
            seen.recovery, seen.wrong = _until_fresh(ring)
    finally:
        gateway.end()
    return seen


def _killed(random: np.random.Generator) -> Seen:
    """Kill acquisition's own process while a recorder follows it; what came is sealed, and balanced."""
    seen = Seen(failed="the recorder did not notice")
    with Devices(1, NODES) as devices, tempfile.TemporaryDirectory(prefix="hilfit-bench-") as folder:
        machine = machine_of(f"killed{devices.pid}", devices.ports[0], NODES)
        path = Path(folder, "killed.parquet")
        with AcquisitionProcess(machine) as acquisition, RingReader(acquisition.ring_name) as ring:
            recorder = Recorder(acquisition.ring_name, machine, "operation", path)
            recorder.start()
            _until_fresh(ring)
            time.sleep(random.uniform(0, 1.0))
            killed = time.monotonic()
            os.kill(ring.writer_pid, signal.SIGKILL)
            try:
                recorder.wait()
            except AcquisitionError:
                seen.recovery, seen.failed = time.monotonic() - killed, ""
            ledger = json.loads(read_table(path).metadata["hilfit.ledger"])
            seen.unbalanced = sum(e["produced"] != e["stored"] + sum(e["dropped"].values()) for e in ledger.values())
    return seen


ROWS: dict[str, Row] = {
    "the gateway and its nodes restart": _led,
    "a gateway that is listened to restarts": _listened,
    "the acquisition process is killed": _killed,
}
