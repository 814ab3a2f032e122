"""What is fuzzed, once for all: hypothesis tries each target in every run (``test_parsers_fuzzed.py``), atheris for as
long as one likes (``make fuzz``, ``fuzz_parsers.py``).

A target takes anything that a bus or a file may bring and asserts what has to be true of it; no exception is right that
is not caught there. Files are bytes, and whole ones to begin with are given; what a bus brings is made by a strategy.
"""

from __future__ import annotations

import contextlib
import functools
import re
import socket
import struct
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any
from unittest.mock import patch

import can
import numpy as np
import pyarrow as pa
from bench_machines import can as can_machine
from hypothesis import strategies as st
from signals_test_bench import DBC

from daq import parse_machine
from daq.acquisition.journal import Journal, journal_path, recover
from daq.acquisition.trace import read_trace
from daq.drivers.base import DriverContext
from daq.drivers.can.health import BusHealth
from daq.drivers.canopen import link as canopen_link
from daq.drivers.canopen.eds import pdo_places
from daq.drivers.canopen.link import CanLink
from daq.drivers.canopen.mapping import Mapping
from daq.drivers.canopen.node import Node
from daq.drivers.canopen.tpdo import Cycle
from daq.drivers.modbus.client import ModbusConnection
from daq.errors import AcquisitionError, HilfitError
from daq.machine.can_database import decoded, read_database
from daq.machine.machine_file import CanNode, CanopenBus, ModbusTcpBus
from daq.recordings.recording import recording_table
from daq.recordings.recording_files import read_table, write_table

Check = Callable[[Any], None]
PAYLOAD = st.binary(max_size=8)
EDS = Path(__file__).parents[2] / "sim_backends" / "devices" / "eds"
ROWS = 20


@dataclass(frozen=True)
class Target:
    """Something that is fuzzed.

    Attributes
    ----------
    opened : gives what is called with each value; what it needs is let go at the end
    strategy : of values; None: they are bytes of a file
    wholes : makes files that are as they should be, from which others are made
    """

    opened: Callable[[], AbstractContextManager[Check]]
    strategy: st.SearchStrategy[Any] | None = None
    wholes: Callable[[], tuple[bytes, ...]] = tuple

    def values(self) -> st.SearchStrategy[Any]:
        """What hypothesis tries."""
        return damaged(self.wholes()) if self.strategy is None else self.strategy


@st.composite
def damaged(draw: st.DrawFn, wholes: tuple[bytes, ...]) -> bytes:
    """A whole file in which some places were written over, cut out or put in; or any bytes."""
    if draw(st.integers(0, 9)) == 0:
        return draw(st.binary(max_size=200))
    content = draw(st.sampled_from(wholes))
    for _ in range(draw(st.integers(0, 4))):
        at = draw(st.integers(0, len(content)))
        gone, put = draw(st.integers(0, 8)), draw(st.binary(max_size=8))
        content = content[:at] + put + content[at + gone :]
    return content[: draw(st.integers(0, len(content)))] if draw(st.integers(0, 4)) == 0 else content


@contextlib.contextmanager
def refused_in_one_line() -> Iterator[None]:
    """Only an error on purpose, whose text is one line."""
    try:
        yield
    except HilfitError as error:
        assert "\n" not in str(error) and len(str(error)) < 2000, str(error)


def simply(check: Check) -> Callable[[], AbstractContextManager[Check]]:
    """A target that needs nothing."""
    return lambda: contextlib.nullcontext(check)


# What a CANopen node sends


def node() -> Node:
    mapping = Mapping(1, 0x185, (), 6, struct.Struct("<Ih"), ((0,), (1,)))
    context = DriverContext(0.02, 0.0, time.monotonic_ns)
    return Node(CanNode(node=5), "can0", "node 5", (mapping,), Cycle(), context, Counter())


def emcy_is_counted_by_code(frames: list[bytes]) -> None:
    found = node()
    for data in frames:
        found.on_emergency(bytearray(data), 0)
    # CiA 301, 7.2.7: error code in the first two bytes, error register in the third; 0x00xx: error reset or no error.
    codes = [int.from_bytes(data[:2], "little") for data in frames if len(data) >= 3]
    assert found.errors == sum(code >= 0x100 for code in codes)
    assert sum(found.emergencies.values()) == len(codes)
    last = codes[-1] if codes else 0
    assert found.emergency == (last if last >= 0x100 else None)


def a_tpdo_counts_only_in_its_length_and_for_a_sync(steps: list[tuple[bool, bytes]]) -> None:
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


def a_heartbeat_is_a_state_or_none(frames: list[bytes]) -> None:
    found = node()
    for data in frames:
        found.on_heartbeat(bytearray(data), 1)
        assert found.heartbeat_state == (data[0] & 0x7F if data else -1)
    assert found.boot_ups == sum(bool(data) and data[0] & 0x7F == 0 for data in frames)


_CHANNELS = count()


@contextlib.contextmanager
def link() -> Iterator[CanLink]:
    name = f"fuzzed-{next(_CHANNELS)}"
    bus = CanopenBus(name="can0", type="canopen", interface="virtual", channel=name)
    now = count(1)
    opened = CanLink(bus, DriverContext(1.0, 0.0, lambda: next(now)), BusHealth())
    try:
        yield opened
    finally:
        opened.close()


FRAME = st.tuples(
    st.integers(0, 0x1FFFFFFF), PAYLOAD, st.booleans(), st.booleans(), st.booleans(),
    st.floats(allow_nan=False, allow_infinity=False, width=32),
)  # fmt: skip


@contextlib.contextmanager
def every_frame_is_counted_once() -> Iterator[Check]:
    with link() as opened:

        def check(value: tuple[int, bytes, bool, bool, bool, float]) -> None:
            number, data, extended, remote, error, stamp = value
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

        yield check


@contextlib.contextmanager
def an_sdo_answer_is_a_value_or_one_line() -> Iterator[Check]:
    with link() as opened, patch.object(canopen_link, "SDO_ATTEMPTS", 1):

        def check(answers: list[bytes]) -> None:
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

        yield check


# What a Modbus unit answers


class Echo:
    """Answers every request with what it is told to, in one piece, and closes."""

    def __init__(self) -> None:
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port = self._server.getsockname()[1]
        self.answer: Callable[[bytes], bytes] = lambda request: request
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

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
        with contextlib.suppress(OSError):
            self._server.shutdown(socket.SHUT_RDWR)
        self._server.close()
        self._thread.join(5)


MODBUS = st.one_of(st.binary(min_size=1, max_size=40), st.tuples(st.integers(0, 16), st.integers(1, 255)))


@contextlib.contextmanager
def modbus_unit() -> Iterator[tuple[Echo, ModbusConnection]]:
    echo = Echo()
    bus = ModbusTcpBus(name="mb", type="modbus_tcp", host="127.0.0.1", port=echo.port)
    connection = ModbusConnection(bus, timeout_s=0.02)
    try:
        yield echo, connection
    finally:
        connection.close()
        echo.close()


def _answered(request: bytes, content: bytes | tuple[int, int], right: bytes) -> bytes:
    """Any bytes, or the right answer (from its length on) with one byte of it changed."""
    if isinstance(content, bytes):
        return content
    at, change = content
    whole = request[:4] + right
    at %= len(whole)
    return whole[:at] + bytes([whole[at] ^ change]) + whole[at + 1 :]


@contextlib.contextmanager
def a_modbus_answer_is_good_only_if_it_is_that_to_the_question() -> Iterator[Check]:
    with modbus_unit() as (echo, connection):

        def check(content: bytes | tuple[int, int]) -> None:
            sent: list[bytes] = []

            def answer(request: bytes) -> bytes:
                made = _answered(request, content, struct.pack(">HBBB4H", 11, 3, 3, 8, 1, 2, 3, 4))
                sent[:] = [request, made]
                return made

            echo.answer = answer
            connection._suspect.clear()
            found = connection.read(3, "holding", 0, 4)
            connection.close()
            if found.good:
                request, made = sent
                assert made[:2] == request[:2] and made[6:9] == b"\x03\x03\x08", "another question's answer"
                assert found.registers == struct.unpack_from(">4H", made, 9)
            else:
                assert found.registers == ()

        yield check


@contextlib.contextmanager
def a_modbus_identity_is_words_or_nothing() -> Iterator[Check]:
    told = b"\x2b\x0e\x01\x01\x00\x00\x02\x00\x04ACME\x01\x03P40"
    right = struct.pack(">HB", 1 + len(told), 3) + told
    with modbus_unit() as (echo, connection):

        def check(content: bytes | tuple[int, int]) -> None:
            echo.answer = lambda request: _answered(request, content, right)
            found = connection.identity(3)
            connection.close()
            assert set(found) <= {"vendor", "product", "revision"}
            assert all(text and text.isprintable() and len(text) <= 60 for text in found.values())

        yield check


# Files


@contextlib.contextmanager
def file_named(name: str, check: Callable[[Path], None]) -> Iterator[Check]:
    """The content as a file of that name in an empty folder, one after another."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name

        def written(content: bytes) -> None:
            path.write_bytes(content)
            with refused_in_one_line():
                check(path)

        yield written


def machine_file(content: bytes) -> None:
    with refused_in_one_line():
        parse_machine(content.decode("utf-8", errors="replace"))


def machine_files() -> tuple[bytes, ...]:
    return (can_machine("x").encode(),)


def eds_files() -> tuple[bytes, ...]:
    """What tells of the first PDO: a whole file of 75 objects takes 5 ms to read, a tenth as many inputs are tried."""
    return tuple(_with_one_pdo(path.read_text()).encode() for path in sorted(EDS.glob("*.eds")))


def _with_one_pdo(eds: str) -> str:
    sections = re.split(r"^(?=\[)", eds, flags=re.MULTILINE)
    return "".join(section for section in sections if re.match(r"\[(DeviceInfo|DummyUsage|1800|1A00)", section))


def eds_file(path: Path) -> None:
    for place in pdo_places(str(path), 5, "can0").values():
        assert 1 <= place.cob_id <= 0x7FF and 0 <= place.bits <= 0xFF


def dbc_file(path: Path) -> None:
    for message in read_database(str(path), "can0").messages[:20]:
        for data in (b"", bytes(8), b"\xff" * 8):
            decoded(message, data)


FRAMES = [
    can.Message(timestamp=1.7e9 + k, arbitration_id=0x181 + k, data=bytes(range(k)), is_extended_id=k > 2, channel=0)
    for k in range(5)
]


def trace_file(suffix: str) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"t{suffix}"
        with can.Logger(path) as logger:
            for frame in FRAMES:
                logger.on_message_received(frame)
        return path.read_bytes()


def trace(path: Path) -> None:
    for frame in read_trace(path):
        assert isinstance(frame, can.Message)


def recording() -> pa.Table:
    machine = parse_machine(can_machine("x"))
    values = {channel.name: np.linspace(0.0, 1.0, ROWS) for channel in machine.channels}
    return recording_table(machine, "train", np.arange(ROWS) / 50, values)


def journals() -> tuple[bytes, ...]:
    with tempfile.TemporaryDirectory() as folder:
        path, table = Path(folder) / "r.parquet", recording()
        made = Journal(path, table.schema)
        for start in range(0, ROWS, 10):
            made.append(table.slice(start, 10))
        made.abandon()
        return (journal_path(path).read_bytes(),)


@contextlib.contextmanager
def recovering() -> Iterator[Check]:
    """What is recovered can be read; what cannot be recovered is left as it is."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "r.parquet"

        def check(content: bytes) -> None:
            for old in Path(folder).iterdir():
                old.unlink()
            journal_path(path).write_bytes(content)
            (found,) = recover(folder)
            assert "\n" not in found.left
            kept = [other for other in Path(folder).iterdir() if other != path]
            assert [other.read_bytes() for other in kept] == [content], "a journal is never changed"
            assert (found.file is None) == (found.rows == 0) == (not path.exists())
            if found.file is not None:
                with refused_in_one_line():
                    assert read_table(found.file).rows == found.rows

        yield check


def tables(suffix: str) -> tuple[bytes, ...]:
    if suffix == ".csv":
        return (b"time,a\n0.0,1.5\n0.02,2.5\n", b"time;a\r\n0,0;1,5\r\n0,02;2,5\r\n", "time,ä\n0,1\n".encode("utf-16"))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"r{suffix}"
        write_table(path, recording())
        return (path.read_bytes(),)


def table(path: Path) -> None:
    found = read_table(path)
    assert all(len(column) == found.rows for column in found.columns.values())


TARGETS = {
    "emcy": Target(simply(emcy_is_counted_by_code), st.lists(PAYLOAD, max_size=30)),
    "tpdo": Target(
        simply(a_tpdo_counts_only_in_its_length_and_for_a_sync),
        st.lists(st.tuples(st.booleans(), PAYLOAD), max_size=30),
    ),
    "heartbeat": Target(simply(a_heartbeat_is_a_state_or_none), st.lists(PAYLOAD, max_size=10)),
    "can_frame": Target(every_frame_is_counted_once, FRAME),
    "sdo_answer": Target(an_sdo_answer_is_a_value_or_one_line, st.lists(PAYLOAD, min_size=1, max_size=6)),
    "modbus_answer": Target(a_modbus_answer_is_good_only_if_it_is_that_to_the_question, MODBUS),
    "modbus_identity": Target(a_modbus_identity_is_words_or_nothing, MODBUS),
    "machine_file": Target(simply(machine_file), wholes=machine_files),
    "eds": Target(lambda: file_named("node.eds", eds_file), wholes=eds_files),
    "dbc": Target(lambda: file_named("bus.dbc", dbc_file), wholes=lambda: (DBC.encode(),)),
    "trace_blf": Target(lambda: file_named("t.blf", trace), wholes=lambda: (trace_file(".blf"),)),
    "trace_asc": Target(lambda: file_named("t.asc", trace), wholes=lambda: (trace_file(".asc"),)),
    "trace_candump": Target(lambda: file_named("t.log", trace), wholes=lambda: (trace_file(".log"),)),
    "journal": Target(recovering, wholes=journals),
    "parquet": Target(lambda: file_named("r.parquet", table), wholes=functools.partial(tables, ".parquet")),
    "csv": Target(lambda: file_named("r.csv", table), wholes=functools.partial(tables, ".csv")),
}
