"""A bench for the CANopen driver: two nodes on a virtual bus, and cycles that wait for what is due."""

from __future__ import annotations

import math
import struct
import time
import uuid
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import can as python_can
import numpy as np
from bench_machines import can
from canopen_test_node import FakeNode

from daq import Machine, Quality, parse_machine
from daq.drivers import DriverContext, Samples
from daq.drivers.can.port import lengthen
from daq.drivers.canopen.driver import CanopenDriver

PERIOD = 0.02
#: A cycle waits this long for what is due. A busy computer may keep a node's thread from running for longer, so what
#: one cycle brings is not asserted, but what comes in some cycle (:meth:`Bench.until`), and what never comes.
PATIENCE = 0.3
NS = 1_000_000_000
ANGLE, HEAD, ROD = 0, 1, 2


class Untimed(DriverContext):
    """Nothing is late by a clock.

    Half a period is 10 ms, for which a busy computer may keep a node's thread from running. What is late by whole
    cycles is told without a clock; the rule itself has a test with times of its own.
    """

    @property
    def late_ns(self) -> float:
        return math.inf


@dataclass
class Bench:
    """Encoder node 5, pressure node 6, and a listener to all that the driver sends."""

    channel: str = field(default_factory=lambda: uuid.uuid4().hex)
    cycle: int = 0
    patience: float = PATIENCE
    interface: str = "virtual"

    def __post_init__(self) -> None:
        self.listener = python_can.Bus(interface=self.interface, channel=self.channel)
        lengthen(self.listener)  # nobody reads it before the end of a test
        self.angle = FakeNode(self.channel, 5, {(0x6004, 0): struct.pack("<I", 123456)}, self.interface)
        self.pressure = FakeNode(
            self.channel,
            6,
            {(0x6130, 1): struct.pack("<f", 50.0), (0x6130, 2): struct.pack("<f", 20.5), (0x61A1, 1): b"\0\0"},
            self.interface,
        )
        self.machine: Machine = parse_machine(can(self.channel, interface=self.interface))
        self.driver = self.make()

    def make(self, text: str | None = None, **context: Any) -> CanopenDriver:
        """A driver, with changes to its context."""
        machine = self.machine if text is None else parse_machine(text)
        told = Untimed(PERIOD, 0.0, time.monotonic_ns, **context)
        return CanopenDriver(machine.buses[0], machine.channels, told)  # type: ignore[arg-type]

    def once(self) -> Samples:
        start = time.monotonic_ns()
        self.driver.trigger(self.cycle)
        samples = self.driver.collect(start + round(self.patience * NS))
        self.cycle += 1
        time.sleep(max(0.0, PERIOD - (time.monotonic_ns() - start) / NS))
        return samples

    def until(self, done: Callable[[Samples], bool], cycles: int = 500) -> Samples:
        for _ in range(cycles):
            samples = self.once()
            if done(samples):
                return samples
        raise AssertionError(f"not within {cycles} cycles; {self.driver.statistics()}")

    def state(self, number: int) -> str:
        return next(d.state for d in self.driver.statistics().devices if d.name == f"node {number}")

    def sent(self) -> list[python_can.Message]:
        found = []
        while (message := self.listener.recv(0)) is not None:
            found.append(message)
        return found

    def close(self) -> None:
        self.driver.stop()
        self.angle.close()
        self.pressure.close()
        self.listener.shutdown()


def fresh(samples: Samples) -> bool:
    return bool(np.all(samples.quality == Quality.FRESH))
