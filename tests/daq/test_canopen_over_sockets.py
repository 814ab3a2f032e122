"""The CANopen driver over the socketcand protocol, as in the simulation, and the protocol itself."""

from __future__ import annotations

import itertools
import socket
import struct
import threading
import time
from collections.abc import Iterator

import can as python_can
import numpy as np
import pytest
from bench_machines import socketcand
from canopen_test_bench import PERIOD, Bench, Untimed, fresh
from hypothesis import given, settings
from hypothesis import strategies as st
from socketcand_test_hub import TestHub

from daq import Quality, parse_machine
from daq.drivers import Samples, make_driver
from daq.drivers.can.port import first_line, open_bus
from daq.drivers.can.socketcand import SocketcandBus
from daq.errors import BusError


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
    assert capfd.readouterr().err == ""  # although every frame comes in two parts


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
    """End of file must neither be waited out nor read again and again."""
    bench, calls = ListeningBench(), [0]
    receive = SocketcandBus.recv

    def counted(bus: SocketcandBus, timeout: float | None = None) -> python_can.Message | None:
        calls[0] += 1
        return receive(bus, timeout)

    monkeypatch.setattr(SocketcandBus, "recv", counted)
    try:
        bench.driver.start()
        bench.until(fresh)
        port = bench.hub.port
        bench.hub.close()
        bench.until(down)
        broken = calls[0]
        for _ in range(20):
            assert down(bench.once())
        assert calls[0] == broken  # no thread goes on reading from what has ended
        bench.hub = TestHub(bench.channel, port)
        bench.until(fresh)
        (line,) = {device.detail for device in bench.driver.statistics().devices}
        assert line == "" and bench.driver.statistics().counts["bus_rebuilt"] == 1
    finally:
        bench.close()


class Gateway:
    """Says what it is told to, in the pieces that it is given, to one client."""

    def __init__(self, *pieces: bytes) -> None:
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port = self._server.getsockname()[1]
        self.heard = b""
        self._thread = threading.Thread(target=self._serve, args=(pieces,))
        self._thread.start()

    def _serve(self, pieces: tuple[bytes, ...]) -> None:
        client, _ = self._server.accept()
        with client:
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            for piece in pieces:
                client.sendall(piece)
                time.sleep(0.005)
            client.shutdown(socket.SHUT_WR)
            while data := client.recv(4096):
                self.heard += data

    def __enter__(self) -> Gateway:
        return self

    def __exit__(self, *_: object) -> None:
        self._thread.join()
        self._server.close()


HELLO = (b"< hi >", b"< ok >", b"< ok >")


def received(*pieces: bytes) -> list[python_can.Message]:
    """Frames until the gateway goes away, which the client has to notice."""
    found = []
    with Gateway(*pieces) as gateway, SocketcandBus("can0", "127.0.0.1", gateway.port) as bus:
        with pytest.raises(python_can.CanOperationError, match="closed the connection"):
            while (message := bus.recv(10.0)) is not None:
                found.append(message)
        bus.send(python_can.Message(arbitration_id=0x80, is_extended_id=False))
        bus.send(python_can.Message(arbitration_id=0x18FEF100, data=b"\x01\xff"))
    assert gateway.heard == b"< open can0 >< rawmode >< send 080 0  >< send 18FEF100 2 01 ff >"
    return found


FRAMES = (
    b"< frame 185 12.250000 0102FF >< frame 18FEF100 12.500000 11 22 >< error 00000040 13.000000 >< frame 701 1.0  >"
)


@given(cuts=st.lists(st.integers(1, len(FRAMES) - 1), max_size=6))
@settings(max_examples=12, deadline=None)
def test_frames_of_a_gateway_come_whole_however_they_are_cut(cuts: list[int]) -> None:
    ends = [0, *sorted(set(cuts)), len(FRAMES)]
    parts = [FRAMES[a:b] for a, b in itertools.pairwise(ends)]
    told = [
        (m.arbitration_id, m.is_extended_id, m.is_error_frame, m.timestamp, bytes(m.data))
        for m in received(*HELLO, *parts)
    ]
    assert told == [
        (0x185, False, False, 12.25, b"\x01\x02\xff"),
        (0x18FEF100, True, False, 12.5, b"\x11\x22"),
        (0x40, True, True, 13.0, b"\0"),
        (0x701, False, False, 1.0, b""),
    ]


def test_a_frame_behind_the_last_word_of_the_handshake_is_a_frame() -> None:
    """And what is no frame is none: odd digits, no time, another protocol's words."""
    strange = b"< frame 1G5 1.0 00 >< frame 185 x 00 >< frame 185 1.0 0 >< hello >< frame 185 1.0 07 >"
    (first, second) = received(b"< hi >", b"< ok >", b"< ok >< frame 186 1.0 05 >", strange)
    assert (bytes(first.data), bytes(second.data)) == (b"\x05", b"\x07")


@pytest.mark.parametrize("words", [b"SSH-2.0-OpenSSH_9.2\r\n", b"< hi >< no >" + bytes(5000)])
def test_what_is_no_gateway_is_refused_in_a_line(words: bytes) -> None:
    with Gateway(words) as gateway, pytest.raises(BusError) as caught:
        open_bus(parse_machine(socketcand(gateway.port)).buses[0])  # type: ignore[arg-type]
    assert f"nothing answers at 127.0.0.1:{gateway.port}" in str(caught.value) and "\n" not in str(caught.value)


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
