"""The whole main job through REST alone: a simulated machine is recorded, identified, and its effect found.

Only the motions do not go through REST: they are files for the arm's own controller, as on a real machine.
"""

from __future__ import annotations

import json
import os
import select
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx2
import pytest
from service_fakes import API

from daq.motion_files import Motion, write_motion
from server.commands.demo_command import PLAN, design_motions

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]
SPEED = 4.0
#: Machine time of each recording, and the recordings: enough to tell the demo's effect, and no more.
SECONDS = 30.0
RECORDED = [row for row in PLAN if row[0] != "train-2"]
MACHINE = "folding-arm"


@contextmanager
def server(data_dir: Path) -> Iterator[httpx2.Client]:
    """``hilfit serve --simulate`` on a free port; stopped by SIGTERM at the end."""
    command = [sys.executable, "-m", "server.commands.command_line", "serve", "--simulate", "--json", "--port", "0"]
    command += ["--simulation-speed", str(SPEED), "--data-dir", str(data_dir)]
    log = data_dir.parent / "server.log"
    with log.open("wb") as errors, subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors) as process:
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            assert line, log.read_text()
            with httpx2.Client(base_url=json.loads(line)["url"], timeout=60) as client:
                yield client
            children = {pid: os.pidfd_open(pid) for pid in children_of(process.pid)}
            assert children, "the simulated machine and acquisition are processes of their own"
            process.terminate()
            assert process.wait(60) == 0, log.read_text()
            for descriptor in children.values():
                assert select.select([descriptor], [], [], 10)[0], "every child has to end with the server"
                os.close(descriptor)
        finally:
            process.kill()


def children_of(pid: int) -> list[int]:
    """Processes that a process started (proc(5))."""
    return [
        int(child) for task in Path(f"/proc/{pid}/task").iterdir() for child in (task / "children").read_text().split()
    ]


def wait_until(what: str, condition: Callable[[], Any], seconds: float = 60) -> Any:
    """The first true value of ``condition()``; other processes give no event to wait for here."""
    deadline = time.monotonic() + seconds
    while not (value := condition()):
        assert time.monotonic() < deadline, f"waited {seconds:g} s until {what}"
        time.sleep(0.1)  # a question costs the server's core some milliseconds
    return value


def assert_nearly_all_fresh(channel: str, counts: dict[str, int]) -> None:
    """A busy computer may make a value late, never lose one of a hundred; ``bench service`` counts them."""
    assert counts["fresh"] > 0.99 * sum(counts.values()), (channel, counts)


def record(client: httpx2.Client, data_dir: Path, name: str, role: str, motion: Motion) -> dict[str, Any]:
    """Let the controller follow a motion and record it."""
    simulation = data_dir / "simulation"

    def controller() -> dict[str, Any]:
        return dict(json.loads((simulation / "controller.json").read_text()))

    write_motion(simulation / "inbox" / f"{name}.csv", motion)
    wait_until(f"{name} is followed", lambda: name in controller()["followed"])
    # A little less than the motion: the request takes its time, and afterwards the rods may be pinned again.
    body = {"machine": MACHINE, "role": role, "label": name, "seconds": motion.seconds - 1.0}
    started = client.post(f"{API}/recordings", json=body)
    assert started.status_code == 201, started.text
    place = started.headers["location"]
    sealed = wait_until(f"{name} is sealed", lambda: (row := client.get(place).json())["state"] != "recording" and row)
    assert sealed["state"] == "sealed", sealed
    statistics = sealed["statistics"]
    assert statistics["missed_cycles"] == 0
    assert statistics["rows"] == round((motion.seconds - 1.0) * 50)
    for channel, others in statistics["quality"].items():
        assert_nearly_all_fresh(channel, {"fresh": statistics["rows"] - sum(others.values()), **others})
    wait_until(f"{name} is over", lambda: controller()["followed"][name][1] is not None)
    return dict(sealed)


def test_record_identify_and_read_the_report(tmp_path: Path) -> None:
    data_dir = tmp_path / "data"
    with server(data_dir) as client:
        machine_file = tmp_path / "machine.yaml"
        machine_file.write_bytes(client.get(f"{API}/machines/{MACHINE}/file").content)
        motions = design_motions(machine_file, SECONDS, 1, lambda share, text: None)

        live = wait_until("frames come", lambda: client.get(f"{API}/live").json())[MACHINE]
        assert live["channels"]["joint1.head_pressure"]["quality"] == "fresh"
        recorded = [record(client, data_dir, name, role, motions[motion]) for name, role, motion in RECORDED]
        assert client.get(f"{API}/recordings", params={"machine": MACHINE}).json()["items"] == recorded[::-1]

        order = {"machine": MACHINE, "recordings": [{"id": row["id"]} for row in recorded]}
        ordered = client.post(f"{API}/identifications", json=order)
        assert ordered.status_code == 202, ordered.text
        job = ordered.headers["location"]
        with client.stream("GET", f"{job}/events", timeout=240) as stream:
            told = [json.loads(line[6:]) for line in stream.iter_lines() if line.startswith("data: ")]
        assert told[-1]["state"] == "done", client.get(job).json()
        assert [*dict.fromkeys(event["stage"] for event in told[1:])] == client.get(job).json()["stages"]

        place = f"{API}/identifications/{ordered.json()['id']}"
        report = client.get(f"{place}/report.json").json()
        assert report["schema"] == "hilfit/report/1"
        assert report["reduction"] == {"standard_parameters": 78, "base_parameters": 18}
        assert [(entry["role"], entry["samples"]) for entry in report["data"]] == [
            (row["role"], row["statistics"]["rows"]) for row in recorded
        ]
        found = report["loop"]["effects"][0]
        assert (found["id"], found["joint"]) == ("position_dependent_friction", "joint2")
        errors = report["errors"]["joint2"]
        # It was well above the floor, and most of it is gone.
        assert errors["before"]["validate"] > 1.5 * errors["noise_floor"]
        assert errors["after"]["validate"] < 0.5 * errors["before"]["validate"]
        assert client.get(place).json()["verdict"] == report["loop"]["verdict"] != "nothing_missing"
        page = client.get(f"{place}/report.html")
        assert page.status_code == 200
        assert "joint2" in page.text

        # Acquisition went on meanwhile, and lost nothing.
        counts = client.get(f"{API}/status").json()["acquisition"][MACHINE]["counts"]
        assert counts["skipped"] == 0
        for channel, of_channel in counts["quality"].items():
            assert_nearly_all_fresh(channel, of_channel)
