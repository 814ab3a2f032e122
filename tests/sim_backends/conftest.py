"""One simulated machine for all tests that only talk to its buses; every test leaves it as it found it."""

from __future__ import annotations

from collections.abc import Iterator

import can
import canopen
import numpy as np
import pytest
from sim_bus_client import connect

from sim_backends import Plant, SimulatedMachine, default_machine

SEED = 5


@pytest.fixture(scope="session")
def simulated(tmp_path_factory) -> Iterator[SimulatedMachine]:
    machine, truth = default_machine()
    with SimulatedMachine(machine, truth, seed=SEED, workdir=tmp_path_factory.mktemp("machine")) as running:
        yield running


@pytest.fixture
def bus(simulated) -> Iterator[can.BusABC]:
    with connect(simulated) as opened:
        yield opened


@pytest.fixture
def network(simulated) -> Iterator[canopen.Network]:
    opened = canopen.Network()
    opened.connect(interface="socketcand", channel="can0", host="127.0.0.1", port=simulated.can_port, tcp_tune=True)
    yield opened
    opened.disconnect()


@pytest.fixture(scope="session")
def idle_states() -> np.ndarray:
    """What the plant of ``simulated`` measures while its arm idles: row k is the state of the k-th SYNC, row 0 of
    power-on. Computed here from the same seed, so it is known without asking any process."""
    machine, truth = default_machine()
    plant = Plant(machine, truth, rng=np.random.default_rng(SEED))
    return np.concatenate([plant.advance(1), *(plant.advance(10) for _ in range(300))])
