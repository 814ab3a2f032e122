"""The CANopen driver over the socketcand protocol, with python-can's stock interface, as in the simulation."""

from __future__ import annotations

import struct
import time
from collections.abc import Callable, Iterator

import can as python_can
import numpy as np
import pytest
from bench_machines import socketcand
from canopen_test_bench import PERIOD, Bench, Untimed, fresh
from socketcand_test_hub import TestHub

from daq import Quality, parse_machine
from daq.drivers import Samples, make_driver
from daq.drivers.can.port import first_line
from daq.drivers.can.receive_queue import ended


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


class ListeningBench(SocketBench):
    """The same, listened to: PDOs are sent by hand."""

    def __post_init__(self) -> None:
        super().__post_init__()
        text = socketcand(self.hub.port).replace("listen_s: 0", "listen_only: true")
        text = text.replace("object: 0x6004,", "object: 0x6004, cob_id: 0x185,")
        text = text.replace("subindex: 1,", "subindex: 1, cob_id: 0x186,")
        machine = parse_machine(text.replace("subindex: 2,", "subindex: 2, cob_id: 0x186, byte: 4,"))
        context = Untimed(PERIOD, 0.0, time.monotonic_ns, start_s=0.01)
        self.driver = make_driver(machine.buses[0], machine.channels, context)  # type: ignore[assignment]

    def once(self) -> Samples:
        for identifier, data in ((0x185, struct.pack("<I", 123456)), (0x186, struct.pack("<ff", 50.0, 20.5))):
            message = python_can.Message(arbitration_id=identifier, data=data, is_extended_id=False)
            self.listener.send(message)
        return super().once()


@pytest.mark.slow
def test_who_only_listens_notices_that_the_gateway_restarted(monkeypatch: pytest.MonkeyPatch) -> None:
    """End of file is read as nothing, again and again: it must neither be waited out nor turned over."""
    bench, calls = ListeningBench(), [0]
    monkeypatch.setattr("daq.drivers.can.port.ended", counted(calls))
    try:
        bench.driver.start()
        bench.until(fresh)
        port = bench.hub.port
        bench.hub.close()
        bench.until(down)
        broken = calls[0]
        for _ in range(20):
            assert down(bench.once())
        assert calls[0] == broken <= 3  # no thread goes on reading from what has ended
        bench.hub = TestHub(bench.channel, port)
        bench.until(fresh)
        (line,) = {device.detail for device in bench.driver.statistics().devices}
        assert line == "" and bench.driver.statistics().counts["bus_rebuilt"] == 1
    finally:
        bench.close()


def counted(calls: list[int]) -> Callable[[object], bool]:
    def told(bus: object) -> bool:
        calls[0] += 1
        return ended(bus)

    return told


@pytest.mark.parametrize(
    "text",
    [
        "Failed to receive: [Errno 104] Connection reset by peer  Traceback (most recent call last):\n  File x",
        "Failed to receive: [Errno 104] Connection reset by peer\nTraceback (most recent call last):",
    ],
)
def test_a_tracebacks_header_is_no_line_for_people(text: str) -> None:
    assert first_line(python_can.CanError(text)) == "Failed to receive: [Errno 104] Connection reset by peer"


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
