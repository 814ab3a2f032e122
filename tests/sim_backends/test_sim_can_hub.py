"""The hub: socketcand as python-can's stock interface speaks it, several clients, lockstep with the plant."""

from __future__ import annotations

import socket
from pathlib import Path

import can
import pytest
from sim_bus_client import SYNC, connect, receive

pytestmark = pytest.mark.slow


def talk(port: int, *commands: bytes) -> list[bytes]:
    """Raw socketcand: each command, each answer."""
    with socket.create_connection(("127.0.0.1", port), timeout=60) as connection:
        answers = [connection.recv(256)]
        for command in commands:
            connection.sendall(command)
            answers.append(connection.recv(256))
        return answers


def test_handshake_and_what_is_not_spoken(simulated):
    answers = talk(simulated.can_port, b"< open can0 >", b"< echo >", b"< bcmmode >", b"< send 123 0 >", b"< rawmode >")
    assert answers[:3] == [b"< hi >", b"< ok >", b"< echo >"]
    assert answers[3].startswith(b"< error") and answers[4].startswith(b"< error")  # send before rawmode
    assert answers[5] == b"< ok >"
    assert talk(simulated.can_port, b"< open can7 >")[1].startswith(b"< error")


@pytest.mark.parametrize(
    "command", [b"< send 123 2 11 >", b"< send xyz 0 >", b"< send 123 9 1 2 3 4 5 6 7 8 9 >", b"< send 800 0 >"]
)
def test_a_frame_that_cannot_be_is_refused(simulated, command):
    assert talk(simulated.can_port, b"< open can0 >", b"< rawmode >", command)[3].startswith(b"< error")


def test_a_client_that_speaks_something_else_is_dropped(simulated):
    with socket.create_connection(("127.0.0.1", simulated.can_port), timeout=60) as connection:
        connection.recv(256)
        connection.sendall(b"GET / HTTP/1.1\r\n" + b"x" * 5000)
        assert connection.recv(256) == b""


@pytest.mark.parametrize("identifier", [0x321, 0x1ABCDE01])
def test_frames_go_to_all_other_clients_and_not_back(simulated, bus, identifier):
    with connect(simulated) as one, connect(simulated) as other:
        bus.send(can.Message(arbitration_id=identifier, is_extended_id=identifier > 0x7FF, data=[1, 2, 255]))
        for client in (one, other):
            message = receive(client, lambda m: m.arbitration_id == identifier)
            assert bytes(message.data) == b"\x01\x02\xff"
            assert message.is_extended_id == (identifier > 0x7FF)
        other.send(can.Message(arbitration_id=0x7EF, is_extended_id=False, data=b""))
        seen = receive(bus, lambda m: m.arbitration_id in (identifier, 0x7EF))
        assert seen.arbitration_id == 0x7EF, "nobody hears himself"


def test_each_sync_is_one_period_whoever_sends_it(simulated, bus):
    before = simulated.order("hub", "counts")["sync"]
    with connect(simulated) as other:
        for _ in range(5):
            bus.send(SYNC)
            other.send(SYNC)
        other.send(can.Message(arbitration_id=0x7EF, is_extended_id=False, data=b""))
        receive(bus, lambda m: m.arbitration_id == 0x7EF)
    assert simulated.order("hub", "counts")["sync"] == before + 10


def test_of_syncs_that_wait_only_the_newest_count(simulated, bus):
    """A client that sends on while the plant is kept from running does not keep the hub from the nodes for ever."""
    before = simulated.order("hub", "counts")
    with socket.create_connection(("127.0.0.1", simulated.can_port), timeout=60) as connection:
        connection.recv(256)
        for command in (b"< open can0 >", b"< rawmode >"):
            connection.sendall(command)
            connection.recv(256)
        connection.sendall(100 * b"< send 80 0 >" + b"< send 7EF 0 >")
        receive(bus, lambda m: m.arbitration_id == 0x7EF)
    after = simulated.order("hub", "counts")
    steps, lost = (after[name] - before[name] for name in ("sync", "lost_sync"))
    assert steps + lost == 100
    assert 1 <= steps <= 16  # eight, and as many once more if it came in two parts


def test_nothing_is_lost_for_a_client_that_does_not_read(simulated, bus):
    count = 4000
    with connect(simulated) as lazy:
        for k in range(count):
            bus.send(can.Message(arbitration_id=0x300, is_extended_id=False, data=k.to_bytes(8, "little")))
        for k in range(count):
            message = receive(lazy, lambda m: m.arbitration_id == 0x300)
            assert int.from_bytes(message.data, "little") == k


def test_everything_listens_on_the_loopback_interface_only(simulated):
    """By the kernel's own table: local address in hexadecimal, state 0A is listening."""
    for port in (simulated.can_port, *simulated.modbus_ports.values()):
        listening = [
            line.split()[1]
            for table in ("tcp", "tcp6")
            for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]
            if line.split()[3] == "0A" and int(line.split()[1].rpartition(":")[2], 16) == port
        ]
        assert listening == [f"0100007F:{port:04X}"]
