"""``hilfit serve --simulate``: what has to be done before the first live frame."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import httpx2
import pytest
from service_fakes import API

#: Seconds of processor time that may lie between the start and the first frame, one after the other.
MOST_CPU_S = 10.0


def children(pid: int) -> list[int]:
    """Processes that a process started."""
    found = []
    for task in Path(f"/proc/{pid}/task").iterdir():
        found += [int(child) for child in (task / "children").read_text().split()]
    return found


def cpu_s(pid: int) -> float:
    """Processor time of a process itself (proc(5): fields 14 and 15 of stat)."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def command(pid: int) -> str:
    return Path(f"/proc/{pid}/cmdline").read_text().replace("\0", " ")


@pytest.mark.slow
def test_the_plant_loads_beside_the_service_and_little_stands_before_the_first_frame(tmp_path: Path) -> None:
    """On idle cores the time is the processor time of the longest chain: the service (or, beside it, the simulation
    and its slowest device), then the acquisition. Measured so, it does not depend on who else uses the computer."""
    run = [sys.executable, "-m", "server.cli", "serve", "--simulate", "--port", "0", "--json"]
    with (
        (tmp_path / "server.log").open("wb") as log,
        subprocess.Popen([*run, "--data-dir", str(tmp_path / "data")], stdout=subprocess.PIPE, stderr=log) as process,
    ):
        try:
            assert process.stdout is not None
            with httpx2.Client(base_url=json.loads(process.stdout.readline())["url"], timeout=30) as client:
                while not client.get(f"{API}/live").json():
                    assert process.poll() is None
                    time.sleep(0.1)
            service = cpu_s(process.pid)
            assert "mujoco" not in Path(f"/proc/{process.pid}/maps").read_text(), "the service loads no plant"
            started = {command(pid): pid for pid in children(process.pid)}
            (simulation,) = [pid for name, pid in started.items() if "simulation_child" in name]
            devices = max(cpu_s(pid) for pid in children(simulation))
            (acquisition,) = [pid for name, pid in started.items() if "acquisition_child" in name]
            before = max(service, cpu_s(simulation) + devices)
            assert before + cpu_s(acquisition) < MOST_CPU_S
        finally:
            process.terminate()
            assert process.wait(60) == 0
    for pid in (simulation, acquisition):
        assert not Path(f"/proc/{pid}").exists(), "no child outlives the service"
