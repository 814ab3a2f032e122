"""Benches that several tests of drivers share."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from canopen_test_bench import Bench
from modbus_test_server import FakeModbus, bench_registers


@pytest.fixture(autouse=True)
def _patient_first_syncs(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first SYNCs are waited for longer than a busy computer keeps a node's thread from running."""
    monkeypatch.setattr("daq.drivers.canopen.driver.ANSWER_S", 3.0)


@pytest.fixture
def bench() -> Iterator[Bench]:
    """Two CANopen nodes, a driver that was not started, and a listener."""
    made = Bench()
    yield made
    made.close()


@pytest.fixture
def server() -> Iterator[FakeModbus]:
    """The Modbus units of the bench machine, behind one port."""
    made = FakeModbus(bench_registers())
    yield made
    made.close()
