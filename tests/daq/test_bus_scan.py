"""Scanning buses: what is heard, what is asked, and above all what is not sent."""

from __future__ import annotations

import struct
import threading
import time
import uuid
from collections.abc import Iterator
from pathlib import Path

import can
import pytest
from canopen_test_node import FakeNode
from modbus_test_server import FakeModbus
from typer.testing import CliRunner

from daq.commissioning.can_scan import CanScan, scan_can
from daq.commissioning.modbus_scan import scan_modbus, span
from daq.errors import InputError
from daq.machine.buses import CanopenBus, ModbusTcpBus
from server.commands.command_line import build

NODE = 6


class Site:
    """A virtual bus with a pressure transducer, and somebody who writes down what is sent to it."""

    def __init__(self) -> None:
        self.channel = uuid.uuid4().hex
        self.listener = can.Bus(interface="virtual", channel=self.channel)
        self.bus = CanopenBus(name="can0", type="canopen", interface="virtual", channel=self.channel)
        self.nodes = [FakeNode(self.channel, NODE, self.objects())]
        self._ended = threading.Event()
        self._sender: threading.Thread | None = None

    @staticmethod
    def objects() -> dict[tuple[int, int], bytes]:
        return {
            (0x1000, 0): struct.pack("<I", 0x0002_0194),
            (0x1018, 4): struct.pack("<I", 0x1234),
            (0x6131, 1): struct.pack("<I", 0x004E_0000),
            (0x1A00, 0): b"\1",
            (0x1A00, 1): struct.pack("<I", 0x6130_0120),
        }

    def send_always(self, identifier: int, data: bytes, every_s: float) -> None:
        """Somebody else sends."""
        self._sender = threading.Thread(target=self._send, args=(identifier, data, every_s), daemon=True)
        self._sender.start()

    def _send(self, identifier: int, data: bytes, every_s: float) -> None:
        with can.Bus(interface="virtual", channel=self.channel) as bus:
            while not self._ended.wait(every_s):
                bus.send(can.Message(arbitration_id=identifier, is_extended_id=identifier > 0x7FF, data=data))

    def requests(self) -> list[int]:
        """Identifiers of what a master sends, as far as it was sent by the scan."""
        found = []
        while (message := self.listener.recv(0)) is not None:
            if message.arbitration_id == 0 or 0x600 <= message.arbitration_id <= 0x67F:
                found.append(message.arbitration_id)
        return found

    def scan(self, **options: object) -> CanScan:
        seconds = 0.3 if self._sender is None else 1.0  # a busy computer lets the sender run within that
        asked: dict[str, object] = {"ask": True} | options
        return scan_can(self.bus, seconds=seconds, nodes=range(1, 9), **asked)  # type: ignore[arg-type]

    def close(self) -> None:
        self._ended.set()
        if self._sender is not None:
            self._sender.join()
        for node in self.nodes:
            node.close()
        self.listener.shutdown()


@pytest.fixture
def site() -> Iterator[Site]:
    made = Site()
    yield made
    made.close()


def test_a_node_is_found_by_asking_and_nothing_is_written(site: Site) -> None:
    found = site.scan()
    (node,) = found.nodes
    assert (node.node, node.device_type, node.profile) == (NODE, 0x0002_0194, "transducer (CiA 404)")
    assert (node.vendor_id, node.product_code, node.serial_number, node.name) == (0x2A, 7, 0x1234, None)
    assert node.objects == {"0x6131:1": 0x004E_0000}
    assert [(pdo.number, pdo.cob_id, pdo.entries) for pdo in node.pdos] == [
        (1, 0x186, ((0x6130, 1, 32),)),
        (2, 0x286, ()),
    ]
    assert found.asked and not found.masters
    assert site.nodes[0].log == [] and site.nodes[0].commands == []  # not an NMT command, not a write


def test_the_command_sends_nothing_unless_it_is_told_to_ask(site: Site) -> None:
    code, said, told = run("--interface", "virtual", "--channel", site.channel, "--seconds", "0.2")
    assert code == 0 and "nothing was sent" in said and told == ""
    assert site.requests() == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("identifier", "data"),
    [(0x700 + NODE, b"\x05"), (0x181, bytes(4)), (0x201, bytes(4))],
    ids=["heartbeat", "TPDO", "RPDO"],
)
def test_a_master_without_sync_is_not_asked_beside(site: Site, identifier: int, data: bytes) -> None:
    site.send_always(identifier, data, 0.02)
    found = site.scan(ask=True)
    assert not found.asked and f"0x{identifier:03X}" in found.masters
    assert site.requests() == []


def test_listening_sends_nothing(site: Site) -> None:
    site.send_always(0x700 + NODE, b"\x05", 0.02)
    found = site.scan(ask=False)
    assert site.requests() == [] and not found.asked
    (heartbeat,) = [entry for entry in found.heard if entry.what == "heartbeat"]
    assert heartbeat.node == NODE and heartbeat.hz is not None
    assert 2 < heartbeat.hz < 75  # 50 Hz; a busy computer sends them late
    (node,) = found.nodes
    assert (node.state, node.device_type) == ("operational", None)


def test_a_bus_that_is_listen_only_is_never_asked(site: Site) -> None:
    site.bus = site.bus.model_copy(update={"listen_only": True})
    assert not site.scan().asked and site.requests() == []


@pytest.mark.slow
@pytest.mark.parametrize("identifier", [0x080, 0x000])
def test_where_somebody_else_leads_nothing_is_sent(site: Site, identifier: int) -> None:
    site.send_always(identifier, b"" if identifier else b"\1\x63", 0.02)
    found = site.scan()
    assert found.masters and not found.asked
    # the other master's own NMT commands are no requests of ours
    assert [i for i in site.requests() if i != identifier] == []
    assert "another master leads it" in found.notes[0] and "listen_only" in found.notes[0]


@pytest.mark.slow
def test_two_devices_with_one_id_are_told(site: Site) -> None:
    site.nodes.append(FakeNode(site.channel, NODE, site.objects()))
    found = site.scan()
    assert found.nodes[0].answers == 2
    assert any("2 devices answer as node 6" in note for note in found.notes)


def test_j1939_is_recognised(site: Site) -> None:
    site.send_always(0x18FEEE00, bytes(8), 0.02)
    found = site.scan(ask=False)
    (entry,) = found.heard
    assert entry.what == "29 bits, PGN 0xFEEE from 0x00" and entry.extended
    assert any("can_signals" in note for note in found.notes)


def test_a_scan_says_that_nothing_was_heard(site: Site) -> None:
    assert "nothing was heard" in site.scan(ask=False).notes[0]


# Modbus


def modbus(port: int) -> ModbusTcpBus:
    return ModbusTcpBus(name="mb", type="modbus_tcp", host="127.0.0.1", port=port)


def test_only_the_units_of_the_range_are_asked(server: FakeModbus) -> None:
    found = scan_modbus(modbus(server.port), [1, 2, 3], range(10))
    assert [unit.unit for unit in found.units] == [1, 2]  # behind a gateway: 3 answers with exception 11
    assert found.units[1].registers == {"holding": {4: 215}, "input": {4: 215}}
    assert {unit for unit, *_ in server.requests} == {1, 2, 3}
    assert {function for _, function, *_ in server.requests} <= {3, 4, 43}, "reading, nothing else"


def test_a_unit_that_is_broken_is_told_apart(server: FakeModbus) -> None:
    server.exceptions[2] = 4
    found = scan_modbus(modbus(server.port), [1, 2])
    assert [unit.unit for unit in found.units] == [1]
    assert "units 2 comes 'device failure'" in found.notes[0]


@pytest.mark.parametrize(("text", "numbers"), [("1-3", [1, 2, 3]), ("7", [7]), ("4,1-2", [1, 2, 4])])
def test_a_range_of_units_is_read_as_numbers(text: str, numbers: list[int]) -> None:
    assert span(text, "units", 0, 255) == numbers


@pytest.mark.parametrize("text", ["", "x", "1-", "0-300", "3-1"])
def test_a_wrong_range_of_units_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="units"):
        span(text, "units", 0, 255)


# The command


def run(*arguments: str) -> tuple[int, str, str]:
    result = CliRunner().invoke(build(), ["bus", "scan", *arguments])
    return result.exit_code, result.stdout, result.stderr


def test_the_command_writes_what_machine_new_reads(site: Site, tmp_path: Path) -> None:
    output = tmp_path / "scan.json"
    code, said, told = run(
        "--interface",
        "virtual",
        "--channel",
        site.channel,
        "--seconds",
        "0.2",
        "--nodes",
        "6",
        "-o",
        str(output),
        "--ask",
    )
    assert code == 0 and "transducer" in said
    assert "listens for 0.2 s, then sends an SDO read of the device type to each of 1 nodes" in told
    assert '"schema": "hilfit/scan/1"' in output.read_text()


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        ((), "says no bus"),
        (("--interface", "virtual", "--ask", "--listen-only"), "say the opposite"),
        (("--tcp", "127.0.0.1:1"), "say which units to ask"),
        (("--tcp", "127.0.0.1:x", "--units", "1"), "write HOST or HOST:PORT"),
        (("--tcp", "h", "--units", "1-300"), "units go from 0 to 255"),
        (("--interface", "virtual", "--option", "x"), "write KEY=VALUE"),
        (("--interface", "virtual", "-o", "scan.txt"), "end its name with .json"),
    ],
)
def test_bad_usage_is_one_line(arguments: tuple[str, ...], line: str) -> None:
    code, _, said = run(*arguments)
    assert code == 2 and line in said and said.count("\n") == 1


@pytest.mark.slow
def test_nothing_is_left_running(site: Site) -> None:
    before = {thread.name for thread in threading.enumerate()}
    site.scan()
    time.sleep(0.05)
    assert {thread.name for thread in threading.enumerate()} <= before
