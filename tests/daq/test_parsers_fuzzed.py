"""Frames of anybody at the parsers: nothing raises, and nothing is taken for what it is not."""

from __future__ import annotations

import socket
import struct
import threading
from collections.abc import Iterator
from itertools import count

import can
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from daq.drivers import canopen_link
from daq.drivers.base import DriverContext
from daq.drivers.can_health import BusHealth
from daq.drivers.canopen_link import CanLink
from daq.drivers.canopen_mapping import Mapping
from daq.drivers.canopen_node import Cycle, Node
from daq.drivers.modbus_client import ModbusConnection
from daq.errors import AcquisitionError
from daq.machine_file import CanNode, CanopenBus, ModbusTcpBus

PAYLOAD = st.binary(max_size=8)
QUICK = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def node() -> Node:
    mapping = Mapping(1, 0x185, (), 6, struct.Struct("<Ih"), ((0,), (1,)))
    return Node(CanNode(node=5), "node 5", (mapping,), Cycle())


@given(st.lists(PAYLOAD, max_size=30))
def test_emcy_messages_are_counted_by_code_whatever_they_hold(frames: list[bytes]) -> None:
    found = node()
    for data in frames:
        found.on_emergency(bytearray(data), 0)
    # CiA 301, 7.2.7: error code in the first two bytes, error register in the third; 0x00xx: error reset or no error.
    codes = [int.from_bytes(data[:2], "little") for data in frames if len(data) >= 3]
    assert found.errors == sum(code >= 0x100 for code in codes)
    assert sum(found.emergencies.values()) == len(codes)
    last = codes[-1] if codes else 0
    assert found.emergency == (last if last >= 0x100 else None)


@given(st.lists(st.tuples(st.booleans(), PAYLOAD), max_size=30))
def test_a_tpdo_counts_only_in_its_own_length_and_for_a_sync(steps: list[tuple[bool, bytes]]) -> None:
    tpdo = node().tpdos[0]
    waiting = taken = wrong = surplus = 0
    for number, (sync, data) in enumerate(steps):
        if sync:
            tpdo.asked(number, number)
            waiting = min(waiting + 1, 4)  # more unanswered SYNCs are not remembered
        tpdo.receive(bytearray(data), number)
        if len(data) != 6:
            wrong += 1
        elif waiting:
            waiting, taken = waiting - 1, taken + 1
            assert tpdo.latest is not None and tpdo.latest.data == data
        else:
            surplus += 1
    assert (tpdo.count, tpdo.wrong, tpdo.surplus) == (taken, wrong, surplus)


@given(st.lists(PAYLOAD, max_size=10))
def test_heartbeats_of_any_content_are_states_or_none(frames: list[bytes]) -> None:
    found = node()
    for data in frames:
        found.on_heartbeat(bytearray(data), 1)
        assert found.heartbeat_state == (data[0] & 0x7F if data else -1)
    assert found.boot_ups == sum(bool(data) and data[0] & 0x7F == 0 for data in frames)


_CHANNELS = count()


@pytest.fixture(scope="module")
def link() -> Iterator[tuple[CanLink, can.BusABC]]:
    name = f"fuzzed-{next(_CHANNELS)}"
    bus = CanopenBus(name="can0", type="canopen", interface="virtual", channel=name)
    now = count(1)
    opened = CanLink(bus, DriverContext(1.0, 0.0, lambda: next(now)), BusHealth())
    with can.Bus(interface="virtual", channel=name) as other:
        yield opened, other
    opened.close()


@QUICK
@given(
    st.integers(0, 0x1FFFFFFF), PAYLOAD, st.booleans(), st.booleans(), st.booleans(),
    st.floats(allow_nan=False, allow_infinity=False, width=32),
)  # fmt: skip
def test_every_frame_is_counted_once_and_none_stops_the_driver(
    link: tuple[CanLink, can.BusABC], number: int, data: bytes, extended: bool, remote: bool, error: bool, stamp: float
) -> None:
    opened, _ = link
    found = node()
    opened.handlers.update(found.handlers())
    identifier = number if extended or error else number & 0x7FF
    message = can.Message(
        arbitration_id=identifier, data=b"" if remote else data, is_extended_id=extended or error,
        is_remote_frame=remote and not error, is_error_frame=error, timestamp=stamp,
    )  # fmt: skip
    before = (opened.frames, opened.extended, opened.remote, opened.health.error_frames)
    opened.take(message)
    after = (opened.frames, opened.extended, opened.remote, opened.health.error_frames)
    plain = not (error or extended or remote)
    kinds = (1, extended and not error, remote and not extended and not error, error)
    assert tuple(b - a for a, b in zip(before, after, strict=True)) == kinds
    if not plain:  # nobody but a data frame of 11 bits reaches a device
        assert found.errors == 0 and found.tpdos[0].wrong == found.tpdos[0].surplus == 0


@QUICK
@given(st.lists(PAYLOAD, min_size=1, max_size=6))
def test_an_sdo_answer_of_any_bytes_is_a_value_or_one_line(
    link: tuple[CanLink, can.BusABC], monkeypatch: pytest.MonkeyPatch, answers: list[bytes]
) -> None:
    opened, _ = link
    monkeypatch.setattr(canopen_link, "SDO_ATTEMPTS", 1)
    sdo = opened.sdo(5)
    sdo._client.RESPONSE_TIMEOUT = 0.002
    waiting = iter(answers)

    def sent(identifier: int, data: bytes, remote: bool = False) -> None:
        answer = next(waiting, None)
        if identifier == 0x605 and answer is not None:
            sdo._client.receive(bytearray(answer), 0)

    sdo._client.network = type("Network", (), {"send_message": staticmethod(sent)})()
    try:
        value = sdo.read(0x1000)
    except AcquisitionError as error:
        assert "\n" not in str(error) and "node 5" in str(error)
    else:
        # CiA 301, 7.2.4.3.6: an upload's answer begins with 010, and names the object that was asked for.
        assert isinstance(value, bytes) and len(answers[0]) == 8
        assert answers[0][0] >> 5 == 2 and answers[0][1:4] == b"\x00\x10\x00"
    finally:
        sdo.close()


class Echo:
    """Answers every request with what it is told to, in one piece, and closes."""

    def __init__(self) -> None:
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port = self._server.getsockname()[1]
        self.answer = lambda request: request
        threading.Thread(target=self._run, daemon=True).start()

    def _run(self) -> None:
        while True:
            try:
                client, _ = self._server.accept()
            except OSError:
                return
            with client:
                request = client.recv(260)
                if request:
                    client.sendall(self.answer(request))

    def close(self) -> None:
        self._server.close()


@pytest.fixture(scope="module")
def echo() -> Iterator[Echo]:
    made = Echo()
    yield made
    made.close()


@QUICK
@given(st.one_of(st.binary(min_size=1, max_size=40), st.tuples(st.integers(0, 16), st.integers(1, 255))))
def test_a_modbus_answer_is_good_only_if_it_is_that_to_the_question(
    echo: Echo, content: bytes | tuple[int, int]
) -> None:
    """Either any bytes, or the right answer with one byte of it changed."""
    sent: list[bytes] = []

    def answer(request: bytes) -> bytes:
        if isinstance(content, bytes):
            made = content
        else:
            at, change = content
            right = request[:4] + struct.pack(">HBBB4H", 11, 3, 3, 8, 1, 2, 3, 4)
            made = right[:at] + bytes([right[at] ^ change]) + right[at + 1 :]
        sent[:] = [request, made]
        return made

    echo.answer = answer
    connection = ModbusConnection(
        ModbusTcpBus(name="mb", type="modbus_tcp", host="127.0.0.1", port=echo.port), timeout_s=0.02
    )
    try:
        found = connection.read(3, "holding", 0, 4)
    finally:
        connection.close()
    if found.good:
        request, made = sent
        assert made[:2] == request[:2] and made[6:9] == b"\x03\x03\x08", "another question's answer, unit or length"
        assert found.registers == struct.unpack_from(">4H", made, 9)
    else:
        assert found.registers == ()
