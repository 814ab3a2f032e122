"""Number of machines of forty channels that one computer acquires, cost of each, and time until 23 nodes are there.

The devices are CANopen nodes of this package (twenty with two channels each) behind socketcand servers in one process.
They answer SDO as the simulated machine's do; at a SYNC they send frames that were made before, so that they cost
little beside what is measured.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.pages import filled
from benchmarks.targets import Outcome, Show, figure
from daq.acquisition.acquisition import AcquisitionProcess
from daq.acquisition.ring import RingReader
from daq.machine.machine_file import Machine, parse_machine
from daq.quality import Quality

CHANNELS, RATE_HZ = 40, 50.0
MACHINES, CORE_PERCENT = 8, 5.0  # at least so many on two cores; at most so much of a core each
NODES, DEAD, COMMISSIONED_S = 23, 20, 3.0
SETTLE_S = 3.0


def machine_of(name: str, port: int, nodes: int) -> Machine:
    """Make a machine of pressure transducers with two channels each."""
    return parse_machine(filled("acquisition/machine.yaml.j2", name=name, rate=RATE_HZ, port=port, channels=2 * nodes))


class Devices:
    """Nodes of several machines in one process, each machine behind a port of its own."""

    def __init__(self, machines: int, nodes: int, dead: int = 0, port: int = 0) -> None:
        numbers = [str(number) for number in (machines, nodes, dead, port)]
        command = [sys.executable, "-m", "benchmarks.acquisition.channel_devices", *numbers]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self._process.stdout is not None
        self.ports = [int(word) for word in self._process.stdout.readline().split()]
        self.pid = self._process.pid

    def kill(self) -> None:
        """Kill the devices as if they lost their power."""
        self._process.kill()
        self._process.wait()

    def __enter__(self) -> Devices:
        return self

    def __exit__(self, *_: object) -> None:
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.close()
        try:
            self._process.wait(10)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._process.stdout.close()


def busy_s(pid: int, beside_first: bool = False) -> float:
    """Read the processor time of all threads of a process, or of all but its first, s (proc(5): schedstat)."""
    tasks = [task for task in Path(f"/proc/{pid}/task").iterdir() if not beside_first or task.name != str(pid)]
    return sum(int((task / "schedstat").read_text().split()[0]) for task in tasks) / 1e9


def run(machines: Sequence[int], seconds: float, show: Show) -> Outcome:
    """Acquire so many machines at once, and measure."""
    notes = [f"{'machines':>8s}  cycles  lost  values lost  slowest start of a cycle  of a core each  devices"]
    sound, each = 0, []
    for number in machines:
        found = _acquire(number, seconds)
        each.append(found["core"])
        if not found["lost"]:
            sound = max(sound, number)
        notes.append(
            f"{number:8d} {found['cycles']:7d} {found['lost']:5d} {found['values']:12d} {found['late_ms']:22.1f} ms"
            f" {found['core']:14.1f} % {found['devices']:6.1f} %"
        )
        show(notes[-1])
    all_there, some_there = _commissioning(0), _commissioning(DEAD)
    ratio, few = each[-1] / each[0], NODES - DEAD
    checks = (
        figure("machines without a lost cycle", sound, least=MACHINES),
        figure("of a core for each", each[0], "{:.1f} %", most=CORE_PERCENT),
        figure("cost of each among most, over that of one alone", ratio, "{:.2f}"),
        figure(f"{NODES} nodes commissioned", all_there, "{:.2f} s", most=COMMISSIONED_S),
        figure(f"{few} of {NODES} nodes commissioned, {DEAD} dead", some_there, "{:.2f} s", most=COMMISSIONED_S),
    )
    notes.append(f"{seconds:g} s each, load of the computer {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    return Outcome(checks, tuple(notes))


def _acquire(number: int, seconds: float) -> dict[str, Any]:
    with ExitStack() as stack:
        devices = stack.enter_context(Devices(number, CHANNELS // 2))
        running = [AcquisitionProcess(machine_of(f"m{k}", port, CHANNELS // 2)) for k, port in enumerate(devices.ports)]
        for one in running:
            stack.callback(one.stop)
            one.start()
        for one in running:
            one.wait_running()
        time.sleep(SETTLE_S)
        readers = [stack.enter_context(RingReader(one.ring_name)) for one in running]
        pids = [reader.writer_pid for reader in readers]
        before, devices_before, began = [busy_s(pid) for pid in pids], busy_s(devices.pid), time.monotonic()
        time.sleep(seconds)
        wall = time.monotonic() - began
        core = [100 * (busy_s(pid) - was) / wall for pid, was in zip(pids, before, strict=True)]
        of_devices = 100 * (busy_s(devices.pid) - devices_before) / wall
        rows = [reader.read().rows for reader in readers]
        late = max(one.statistics().worst_late_ms for one in running)
    return {
        "cycles": sum(len(r) for r in rows),
        "lost": sum(int((np.diff(r["cycle"]) - 1).sum()) for r in rows),
        "values": sum(int((r["quality"] != Quality.FRESH).sum()) for r in rows),
        "late_ms": late,
        "core": float(np.mean(core)),
        "devices": of_devices,
    }


def _commissioning(dead: int) -> float:
    """Time the start of the acquisition process until every living node has sent a fresh value, s."""
    with Devices(1, NODES, dead) as devices:
        process = AcquisitionProcess(machine_of("m", devices.ports[0], NODES), strict=dead == 0)
        began = time.monotonic()
        try:
            process.start()
            process.wait_running()
            with RingReader(process.ring_name, from_start=True) as ring:
                fresh = np.zeros(2 * NODES, dtype=np.bool_)
                while fresh.sum() < 2 * (NODES - dead):
                    if not ring.wait(30):
                        return float("inf")
                    fresh |= (ring.read().rows["quality"] == Quality.FRESH).any(axis=0)
            return time.monotonic() - began
        finally:
            process.stop()
