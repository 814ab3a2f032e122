"""The CANopen driver over the socketcand protocol, with python-can's stock interface, as in the simulation."""

from __future__ import annotations

import struct
import time
import uuid
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import pytest
from bench_machines import socketcand
from canopen_test_node import FakeNode
from socketcand_test_hub import TestHub

from daq import Quality, parse_machine
from daq.drivers import DriverContext, Samples
from daq.drivers.canopen import CanopenDriver

PERIOD = 0.02
#: A cycle waits this long for what is due: longer than a busy computer keeps a node's thread from running.
PATIENCE = 0.3
NS = 1_000_000_000


@dataclass
class Bench:
    channel: str
    hub: TestHub
    driver: CanopenDriver
    cycle: int = 0

    def once(self) -> Samples:
        start = time.monotonic_ns()
        self.driver.trigger(self.cycle)
        samples = self.driver.collect(start + round(PATIENCE * NS))
        self.cycle += 1
        time.sleep(max(0.0, PERIOD - (time.monotonic_ns() - start) / NS))
        return samples

    def until(self, done: Callable[[Samples], bool], cycles: int = 500) -> Samples:
        for _ in range(cycles):
            samples = self.once()
            if done(samples):
                return samples
        raise AssertionError(f"not within {cycles} cycles; {self.driver.statistics()}")


@pytest.fixture
def bench() -> Iterator[Bench]:
    channel = uuid.uuid4().hex
    pressures = {(0x6130, 1): struct.pack("<f", 50.0), (0x6130, 2): struct.pack("<f", 20.5), (0x61A1, 1): b"\0\0"}
    nodes = [FakeNode(channel, 5, {(0x6004, 0): struct.pack("<I", 123456)}), FakeNode(channel, 6, pressures)]
    hub = TestHub(channel)
    machine = parse_machine(socketcand(hub.port))
    context = DriverContext(PERIOD, 0.0, time.monotonic_ns)
    made = Bench(channel, hub, CanopenDriver(machine.buses[0], machine.channels, context))  # type: ignore[arg-type]
    yield made
    made.driver.stop()
    made.hub.close()
    for node in nodes:
        node.close()


def fresh(samples: Samples) -> bool:
    return bool(np.all(samples.quality == Quality.FRESH))


def down(samples: Samples) -> bool:
    return bool(np.all(samples.quality == Quality.BUS_ERROR))


def test_values_come_through_the_socket(bench: Bench, capfd: pytest.CaptureFixture[str]) -> None:
    assert bench.driver.start() == ()
    samples = bench.until(fresh)
    assert samples.raw.tolist() == [123456.0, 50.0, 20.5]
    bench.driver.stop()
    assert capfd.readouterr().err == ""  # the stock interface warns about every frame that comes in two parts


@pytest.mark.slow
def test_a_connection_that_is_cut_is_noticed_and_made_again(bench: Bench) -> None:
    bench.driver.start()
    bench.until(fresh)
    bench.hub.drop()
    bench.until(down)
    bench.until(fresh)
    assert bench.hub.clients == 2


@pytest.mark.slow
def test_a_server_that_goes_away_and_comes_back(bench: Bench) -> None:
    bench.driver.start()
    bench.until(fresh)
    port = bench.hub.port
    bench.hub.close()
    bench.until(down)
    for _ in range(40):
        assert down(bench.once())
    assert "nothing answers" in bench.driver.statistics().devices[0].detail
    bench.hub = TestHub(bench.channel, port)
    bench.until(fresh)
