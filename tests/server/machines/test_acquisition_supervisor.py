"""A machine's acquisition is started again when it fails or dies, with growing pauses, until it is told to stop."""

from __future__ import annotations

import queue
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from service_fakes import MACHINE, FakeAcquisition

from server.machines.acquisition import FIRST_PAUSE_S, LONGEST_PAUSE_S, LOOK_S, Acquisition, Supervisor
from server.platform.errors import ConflictError


class Pace:
    """Pauses of a supervisor: the test sees each of them and lets it pass."""

    def __init__(self) -> None:
        self.asked: queue.Queue[float] = queue.Queue()
        self.passes: queue.Queue[bool] = queue.Queue()

    def __call__(self, stop: threading.Event, seconds: float) -> bool:
        self.asked.put(seconds)
        return self.passes.get(timeout=30)

    def next(self) -> float:
        """How long the supervisor wants to pause now."""
        return self.asked.get(timeout=30)

    def let_pass(self) -> float:
        """Let the current pause pass; how long the next one is to be."""
        self.passes.put(False)
        return self.next()


@pytest.fixture
def machine_file(tmp_path: Path) -> Path:
    path = tmp_path / "machine.yaml"
    path.write_text(MACHINE)
    return path


@pytest.fixture
def supervised(machine_file: Path) -> Iterator[tuple[Supervisor, FakeAcquisition, Pace]]:
    acquisition, pace = FakeAcquisition(), Pace()
    supervisor = Supervisor("lever", machine_file, acquisition, pause=pace)
    yield supervisor, acquisition, pace
    pace.passes.put(True)  # as the event would, once told to stop
    supervisor.stop()


def test_a_process_that_dies_is_started_again(
    supervised: tuple[Supervisor, FakeAcquisition, Pace],
) -> None:
    supervisor, acquisition, pace = supervised
    supervisor.start()
    assert pace.next() == LOOK_S
    assert supervisor.statistics()["state"] == "running"
    assert pace.let_pass() == LOOK_S
    assert supervisor.statistics()["counts"]["cycles"] == 1
    acquisition.feeds[0].alive = False
    assert pace.let_pass() == FIRST_PAUSE_S
    state = supervisor.statistics()
    assert (state["state"], state["error"]) == ("waiting", "the bus went away")
    assert supervisor.running is None
    assert pace.let_pass() == LOOK_S
    assert len(acquisition.feeds) == 2
    state = supervisor.statistics()
    assert (state["state"], state["restarts"], state["error"]) == ("running", 1, None)


def test_pauses_between_restarts_grow(
    supervised: tuple[Supervisor, FakeAcquisition, Pace],
) -> None:
    supervisor, acquisition, pace = supervised
    acquisition.failures = ["node 3 does not answer"] * 7
    supervisor.start()
    pauses = [pace.next(), *(pace.let_pass() for _ in range(6))]
    assert pauses == [FIRST_PAUSE_S, 2, 4, 8, 16, LONGEST_PAUSE_S, LONGEST_PAUSE_S]
    assert supervisor.statistics()["error"] == "node 3 does not answer"
    assert pace.let_pass() == LOOK_S
    acquisition.feeds[0].alive = False
    assert pace.let_pass() == FIRST_PAUSE_S, "after a good run the pauses begin anew"


def test_a_machine_file_that_vanished_is_a_reason_to_wait(
    supervised: tuple[Supervisor, FakeAcquisition, Pace], machine_file: Path
) -> None:
    supervisor, _, pace = supervised
    machine_file.unlink()
    supervisor.start()
    assert pace.next() == FIRST_PAUSE_S
    assert "no such file" in supervisor.statistics()["error"]


def test_stopping_ends_the_process(machine_file: Path) -> None:
    acquisition = FakeAcquisition()
    supervisor = Supervisor("lever", machine_file, acquisition)
    supervisor.start()
    assert acquisition.up.wait(10)
    supervisor.stop()
    assert acquisition.ended == 1
    assert supervisor.statistics()["state"] == "stopped"


@pytest.mark.parametrize("places", [(), ("can:virtual:other", "tcp:0.0.0.0/0:*", "serial:*")])
def test_an_uploaded_machine_goes_nowhere_unless_the_administrator_says_so(
    machine_file: Path, places: tuple[str, ...]
) -> None:
    changed = threading.Event()
    acquisition = Acquisition(FakeAcquisition(), changed.set, places)
    with pytest.raises(ConflictError, match="bus 'can' leads to can:virtual:tests, which is not in bus_places"):
        acquisition.check(machine_file)
    acquisition.check(machine_file, own=True)
    acquisition.start("lever", machine_file)  # as after a restart, or with a new version of its file
    try:
        while acquisition.state("lever") == "starting":
            assert changed.wait(30)
            changed.clear()
        assert acquisition.state("lever") == "waiting"
        assert "not in bus_places" in acquisition.statistics("lever")["error"]
    finally:
        acquisition.stop_all()
    Acquisition(FakeAcquisition(), changed.set, ("can:virtual:t*",)).check(machine_file)
