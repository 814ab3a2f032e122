"""What the tests say on the simulated CAN bus, with python-can's stock interface."""

from __future__ import annotations

import logging
from collections.abc import Callable

import can

from sim_backends import SimulatedMachine

SYNC = can.Message(arbitration_id=0x080, is_extended_id=False, data=b"")

# python-can warns about every frame that TCP delivers in two parts.
logging.getLogger("can.interfaces.socketcand").setLevel(logging.CRITICAL)


def connect(machine: SimulatedMachine) -> can.BusABC:
    """A stock python-can bus on the machine's hub, past the quiet time after its handshake."""
    bus = can.Bus(interface="socketcand", channel="can0", host="127.0.0.1", port=machine.can_port, tcp_tune=True)
    bus.send(can.Message(arbitration_id=0x60B, is_extended_id=False, data=[0x40, 0, 0x10, 0, 0, 0, 0, 0]))
    receive(bus, lambda m: m.arbitration_id == 0x58B)  # what node 11 says for its device type
    return bus


def receive(bus: can.BusABC, wanted: Callable[[can.Message], bool], timeout: float = 5.0) -> can.Message:
    """The next message that ``wanted`` accepts; fails after ``timeout`` s without any message."""
    while True:
        message = bus.recv(timeout)
        assert message is not None, "no such message came"
        if wanted(message):
            return message
