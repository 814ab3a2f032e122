"""CAN ports without a bus: a test hands frames to them at moments of its own clock."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import can

from daq.drivers import DriverContext, Samples
from daq.drivers.base import Driver
from daq.drivers.can.port import CanAccess, CanPort
from daq.machine.machine_file import CanBus

NS = 1_000_000_000
PERIOD = 0.02


class _Nothing:
    """A bus that nothing comes from; what is sent is kept."""

    def __init__(self) -> None:
        self.sent: list[can.Message] = []

    def send(self, message: can.Message) -> None:
        self.sent.append(message)

    def shutdown(self) -> None:
        pass


class HandFed(CanAccess):
    """A driver whose frames come by :meth:`frame`, and whose cycles are run by :meth:`cycle`."""

    def __init__(self, make: Callable[[DriverContext], Driver]) -> None:
        self.now_ns = 1_000 * NS
        self.bus = _Nothing()
        self.port: CanPort | None = None
        self.number = 0
        self.driver = make(DriverContext(PERIOD, 0.0, lambda: self.now_ns, start_s=0.0, can=self))  # no waiting
        self.problems = self.driver.start()

    def attach(self, port: CanPort, config: CanBus) -> Any:
        self.port = port
        return self.bus

    def begin(self, port: CanPort) -> None:
        pass

    def advance(self, seconds: float) -> None:
        self.now_ns += round(seconds * NS)

    def frame(self, identifier: int, data: bytes, extended: bool = False) -> None:
        """A frame comes now."""
        assert self.port is not None
        self.port.take(
            can.Message(
                timestamp=self.now_ns / NS,
                arbitration_id=identifier,
                data=data,
                is_extended_id=extended,
            )
        )

    def cycle(self, advance: float = PERIOD) -> Samples:
        """Let time pass, then run a cycle."""
        self.advance(advance)
        self.driver.trigger(self.number)
        self.number += 1
        return self.driver.collect(self.now_ns)
