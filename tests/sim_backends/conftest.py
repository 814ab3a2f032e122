"""One simulated machine for all tests that only talk to its buses; every test leaves it as it found it."""

from __future__ import annotations

import logging
from collections.abc import Iterator

import can
import canopen
import numpy as np
import pytest

from sim_backends import Plant, SimulatedMachine, default_machine

SEED = 5
SYNC = can.Message(arbitration_id=0x080, is_extended_id=False, data=b"")

# python-can warns about every frame that TCP delivers in two parts.
logging.getLogger("can.interfaces.socketcand").setLevel(logging.CRITICAL)


def connect(machine: SimulatedMachine) -> can.BusABC:
    """A stock python-can bus on the machine's hub, past the quiet time after its handshake."""
    bus = can.Bus(interface="socketcand", channel="can0", host="127.0.0.1", port=machine.can_port, tcp_tune=True)
    bus.send(can.Message(arbitration_id=0x60B, is_extended_id=False, data=[0x40, 0, 0x10, 0, 0, 0, 0, 0]))
    receive(bus, lambda m: m.arbitration_id == 0x58B)  # what node 11 says for its device type
    return bus


def receive(bus: can.BusABC, wanted, timeout: float = 5.0) -> can.Message:
    """The next message that ``wanted`` accepts; fails after ``timeout`` s without any message."""
    while True:
        message = bus.recv(timeout)
        assert message is not None, "no such message came"
        if wanted(message):
            return message


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
