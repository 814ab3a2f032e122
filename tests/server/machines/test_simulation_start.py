"""``hilfit serve --simulate``: what has to be done before the first live frame."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path

import httpx2
import pytest
from service_fakes import API

pytestmark = pytest.mark.slow


def children(pid: int) -> list[int]:
    """Processes that a process started."""
    found = []
    for task in Path(f"/proc/{pid}/task").iterdir():
        found += [int(child) for child in (task / "children").read_text().split()]
    return found


def command(pid: int) -> str:
    return Path(f"/proc/{pid}/cmdline").read_text().replace("\0", " ")


def test_the_plant_loads_beside_the_service_and_ends_with_it(tmp_path: Path) -> None:
    """What takes long to load (the plant) is in a process of its own, so that the service answers meanwhile."""
    run = [sys.executable, "-m", "server.commands.command_line", "serve", "--simulate", "--port", "0", "--json"]
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
            assert "mujoco" not in Path(f"/proc/{process.pid}/maps").read_text(), "the service loads no plant"
            started = {command(pid): pid for pid in children(process.pid)}
            (simulation,) = [pid for name, pid in started.items() if "simulation_child" in name]
            assert children(simulation), "every device is a process of its own"
            (acquisition,) = [pid for name, pid in started.items() if "acquisition_child" in name]
        finally:
            process.terminate()
            assert process.wait(60) == 0
    for pid in (simulation, acquisition):
        assert not Path(f"/proc/{pid}").exists(), "no child outlives the service"
