"""``hilfit demo --valve``: what it leaves, and that nothing in the whole job writes a command."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import can
import pytest

import fitting.valve.motion
from daq.machine.machine_file import Machine
from fitting.valve.motion import Planned
from server.commands.valve_demo import run_valve_demo
from sim_backends import SimulatedMachine

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

CONTROLLER = 8  # the node of the crane's own controller, which says what it sends
STEPS = 15


@pytest.fixture
def bus(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[can.Message]]:
    """Every frame on the CAN bus of a simulated machine, from before acquisition begins until the machine stops."""
    seen: list[can.Message] = []
    ended, threads = threading.Event(), list[threading.Thread]()
    enter, stop = SimulatedMachine.__enter__, SimulatedMachine.stop

    def watched(self: SimulatedMachine) -> SimulatedMachine:
        running = enter(self)
        listening = can.Bus(interface="socketcand", channel="can0", host="127.0.0.1", port=self.can_port)

        def listen() -> None:
            while not ended.is_set():
                message = listening.recv(0.2)
                if message is not None:
                    seen.append(message)
            listening.shutdown()

        threads.append(threading.Thread(target=listen))
        threads[-1].start()
        return running

    def stopped(self: SimulatedMachine) -> None:
        ended.set()
        for thread in threads:
            thread.join()
        stop(self)

    monkeypatch.setattr(SimulatedMachine, "__enter__", watched)
    monkeypatch.setattr(SimulatedMachine, "stop", stopped)
    yield seen
    ended.set()


def test_the_whole_job_writes_no_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, bus: list[can.Message]
) -> None:
    plan = fitting.valve.motion.plan_valve_motions

    def shorter(machine: Machine) -> list[Planned]:
        """Levels of both axes together, the first of them."""
        together = plan(machine)[-1]
        motion = replace(together.motion, steps=together.motion.steps[:STEPS])
        return [replace(together, motion=motion)]

    monkeypatch.setattr(fitting.valve.motion, "plan_valve_motions", shorter)
    report, acquired, tests = run_valve_demo(tmp_path, ["none"], seconds=12.0)

    identifiers = {message.arbitration_id for message in bus}
    assert 0x080 in identifiers, "SYNC, which hilfit sends, is heard"
    sent = {bytes(message.data) for message in bus if message.arbitration_id == 0x180 + CONTROLLER}
    assert len(sent) > 20, "commands are heard, from the crane's own controller"
    receive = {base + node for base in (0x200, 0x300, 0x400, 0x500) for node in range(1, 128)}
    assert not identifiers & receive, "no process data is sent to any node"
    written = {
        int.from_bytes(message.data[1:3], "little")
        for message in bus
        if message.arbitration_id == 0x600 + CONTROLLER and message.data[0] >> 5 == 1
    }
    assert written, "the controller's transmission is configured"
    assert all(0x1000 <= index < 0x2000 for index in written), "and of its own objects none is written"
    # Where a computer is too busy to answer in time a transfer is aborted, for that and nothing else.
    late = bytes([0x80]), (0x05040000).to_bytes(4, "little")
    asked = {
        m.data[0] >> 5
        for m in bus
        if m.arbitration_id == 0x600 + CONTROLLER and (bytes(m.data[:1]), bytes(m.data[4:])) != late
    }
    assert asked <= {1, 2, 3}, "expedited or segmented transfers alone: none that could carry a command in blocks"

    assert acquired.missed_cycles + acquired.not_fresh <= 0.01 * acquired.rows  # a busy computer may be late
    assert [role for role, _ in acquired.recordings] == ["operation", "validate"]
    assert json.loads((tmp_path / "valve.json").read_text("utf-8")) == report
    for own in report["axes"].values():
        assert own["errors"]["handed_out"] <= own["errors"]["static"]
        assert own["errors"]["role"] == "validate"
    assert {path.name for path in (tmp_path / "inverse").iterdir()} == {
        f"valve_{joint}{end}" for joint in ("boom", "jib") for end in (".h", ".c", "_selftest.c", ".csv", ".st")
    }
    assert len(tests) == 2 and not any("FAILED" in line for line in tests)


def test_a_second_one_in_the_same_folder_is_refused_and_the_first_ends_on_ctrl_c(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "server.commands.command_line", "demo", "--valve", "--seconds", "20"]
    said: list[str] = []
    second: Any = None
    with subprocess.Popen(
        command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as running:  # fmt: skip
        assert running.stdout is not None and running.stderr is not None
        for line in running.stderr:
            if second is None and "planning" in line:
                second = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300)
            if "recording valve-boom" in line and not any("recording" in earlier for earlier in said):
                os.killpg(running.pid, signal.SIGINT)
            said.append(line)
        printed = running.stdout.read()
    assert (second.returncode, second.stdout) == (2, "")
    assert second.stderr.startswith("hilfit: hilfit-demo: another demo is running in this directory")
    assert (running.returncode, printed) == (130, "")
    assert said[-1].startswith("hilfit: interrupted")
    assert not (tmp_path / "hilfit-demo" / "valve.json").exists()


def test_options_of_the_other_demo_are_refused_in_one_line(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "server.commands.command_line", "demo", "--valve", "--resolve"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 2 and done.stderr.startswith("hilfit: --valve: its demo has no --faults")
    assert not (tmp_path / "hilfit-demo").exists()
