"""An order to the simulated machine fails for a process that does not answer, not for a computer that is busy."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from sim_backends import SimulationError, simulated_machine
from sim_backends.simulated_machine import _Process, waited_s

CHILD = """
import pathlib, sys, time
while not pathlib.Path(__file__).with_name("answer").exists():
    time.sleep(0.005)
print('{"result": 7}', flush=True)
sys.stdin.read()
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Of a process that answers once there is a file ``answer``."""
    (tmp_path / "answering_child.py").write_text(CHILD)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    monkeypatch.setitem(simulated_machine._MODULES, "child", "answering_child")
    yield tmp_path
    (tmp_path / "answer").touch()


def test_a_silent_process_is_given_up(folder: Path) -> None:
    process = _Process("child", {}, (), folder / "log")
    try:
        with pytest.raises(SimulationError, match=r"child: no answer within 0\.05 s; see .*log"):
            process.answer(0.05)
    finally:
        (folder / "answer").touch()
        process.stop()


def test_time_without_a_processor_does_not_count(folder: Path) -> None:
    looks: list[float] = []

    def waited() -> float:
        looks.append(1000.0 * len(looks))  # it never ran since the last look
        if len(looks) == 2:  # the patience is over
            (folder / "answer").touch()
        return looks[-1]

    process = _Process("child", {}, (), folder / "log", waited)
    try:
        assert process.answer(0.05) == {"result": 7}
        assert len(looks) >= 2
    finally:
        process.stop()


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_waiting_is_that_of_processes_that_are_there() -> None:
    assert waited_s([os.getpid()]) >= 0.0
    assert waited_s([2**30]) == 0.0
