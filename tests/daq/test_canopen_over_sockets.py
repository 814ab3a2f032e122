"""The CANopen driver over the socketcand protocol, with python-can's stock interface, as in the simulation."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from bench_machines import socketcand
from canopen_test_bench import Bench, fresh
from socketcand_test_hub import TestHub

from daq import Quality
from daq.drivers import Samples


class SocketBench(Bench):
    """The bench behind a socketcand server."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.hub = TestHub(self.channel)
        self.driver = self.make(socketcand(self.hub.port))

    def close(self) -> None:
        self.driver.stop()
        self.hub.close()
        super().close()


@pytest.fixture
def bench() -> Iterator[SocketBench]:
    made = SocketBench()
    yield made
    made.close()


def down(samples: Samples) -> bool:
    return bool(np.all(samples.quality == Quality.BUS_ERROR))


def test_values_come_through_the_socket(bench: SocketBench, capfd: pytest.CaptureFixture[str]) -> None:
    assert bench.driver.start() == ()
    samples = bench.until(fresh)
    assert samples.raw.tolist() == [123456.0, 50.0, 20.5]
    bench.driver.stop()
    assert capfd.readouterr().err == ""  # the stock interface warns about every frame that comes in two parts


@pytest.mark.slow
def test_a_connection_that_is_cut_is_noticed_and_made_again(bench: SocketBench) -> None:
    bench.driver.start()
    bench.until(fresh)
    bench.hub.drop()
    bench.until(down)
    bench.until(fresh)
    assert bench.hub.clients == 2


@pytest.mark.slow
def test_a_server_that_goes_away_and_comes_back(bench: SocketBench) -> None:
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
