"""What commissioning changes is read first, kept, and put back on request; what fits is not written at all."""

from __future__ import annotations

import json
import struct
import threading
from pathlib import Path

import pytest
import typer
from bench_machines import can
from canopen_test_bench import Bench, fresh
from typer.testing import CliRunner

from daq import parse_machine
from daq.commands import cli
from daq.drivers.canopen.commissioning import Restored, restore_nodes
from daq.drivers.canopen.driver import CanopenDriver
from daq.drivers.found_setups import FoundSetup, FoundSetups
from daq.errors import BusError

Objects = dict[tuple[int, int], bytes]


def keeping(bench: Bench, folder: Path) -> FoundSetups:
    """The bench's driver keeps what it finds."""
    found = FoundSetups(folder, bench.machine.name)
    bench.driver = bench.make(found=found)
    return found


def own_setup(bench: Bench) -> tuple[Objects, Objects]:
    """Somebody else's mapping in both nodes: two entries, event-driven, a heartbeat of its own."""
    for node in (bench.angle, bench.pressure):
        node.objects[0x1A00, 0] = b"\x02"
        node.objects[0x1A00, 1] = struct.pack("<I", 0x60040020)
        node.objects[0x1A00, 2] = struct.pack("<I", 0x60300010)
        node.objects[0x1800, 2] = b"\xfe"
        node.objects[0x1017, 0] = struct.pack("<H", 750)
    return dict(bench.angle.objects), dict(bench.pressure.objects)


def test_restore_writes_back_every_object_that_commissioning_changed(bench: Bench, tmp_path: Path) -> None:
    found = keeping(bench, tmp_path)
    before = own_setup(bench)
    assert bench.driver.start() == ()
    bench.until(fresh)
    bench.driver.stop()
    assert (bench.angle.objects, bench.pressure.objects) != before
    assert found.path("can0", 5).is_file() and found.path("can0", 6).is_file()
    assert restore_nodes(bench.machine, tmp_path) == [Restored("can0", 5), Restored("can0", 6)]
    assert (bench.angle.objects, bench.pressure.objects) == before
    assert not found.path("can0", 5).exists()  # and nothing is left to put back
    assert restore_nodes(bench.machine, tmp_path) == []


def test_a_node_whose_setup_fits_already_is_not_written_to(bench: Bench, tmp_path: Path) -> None:
    bench.driver.start()
    bench.until(fresh)
    bench.driver.stop()
    bench.angle.log.clear()
    bench.pressure.log.clear()
    bench.driver = bench.make()
    found = keeping(bench, tmp_path)
    assert bench.driver.start() == ()
    bench.until(fresh)
    assert bench.angle.log == bench.pressure.log == []
    assert not found.path("can0", 5).exists()  # nothing was changed, so nothing is to be put back


def test_only_what_differs_is_written(bench: Bench) -> None:
    bench.driver.start()
    bench.driver.stop()
    bench.angle.objects[0x1017, 0] = struct.pack("<H", 750)
    bench.angle.log.clear()
    bench.driver = bench.make()
    assert bench.driver.start() == ()
    assert bench.angle.log == [(0x1017, 0, struct.pack("<H", 400))]


def test_a_second_commissioning_keeps_the_first_find(bench: Bench, tmp_path: Path) -> None:
    found = keeping(bench, tmp_path)
    own_setup(bench)
    bench.driver.start()
    bench.driver.stop()
    first = found.read("can0", 6)
    bench.driver = bench.make(can(bench.channel).replace("heartbeat_ms: 300", "heartbeat_ms: 310"))
    keeping(bench, tmp_path)
    bench.driver.start()
    assert found.read("can0", 6) == first
    assert first is not None and first.found[0x1017, 0] == struct.pack("<H", 750)


def test_what_somebody_else_changed_since_is_a_new_find(tmp_path: Path) -> None:
    found = FoundSetups(tmp_path, "arm")
    key = (0x1017, 0)
    found.keep("can0", 5, FoundSetup({key: b"\x01\0"}, {key: b"\x02\0"}, {}))
    found.keep("can0", 5, FoundSetup({key: b"\x02\0"}, {key: b"\x03\0"}, {}))  # as we left it
    kept = found.read("can0", 5)
    assert kept is not None and kept.found == {key: b"\x01\0"}
    found.keep("can0", 5, FoundSetup({key: b"\x07\0"}, {key: b"\x03\0"}, {}))
    kept = found.read("can0", 5)
    assert kept is not None and kept.found == {key: b"\x07\0"}
    assert len(list((tmp_path / "found" / "arm").iterdir())) == 2  # the one before is still there


def test_where_it_cannot_be_kept_nothing_is_written(bench: Bench, tmp_path: Path) -> None:
    (tmp_path / "found").write_text("a file where a folder has to be")
    keeping(bench, tmp_path)
    problems = bench.driver.start()
    assert len(problems) == 2 and "cannot be written" in problems[0] and "nothing was changed" in problems[0]
    assert bench.angle.log == bench.pressure.log == []


def test_restore_leaves_an_exchanged_device_alone(bench: Bench, tmp_path: Path) -> None:
    keeping(bench, tmp_path)
    bench.driver.start()
    bench.driver.stop()
    bench.angle.objects[0x1018, 4] = struct.pack("<I", 4711)  # exchanged meanwhile
    bench.angle.log.clear()
    first, second = restore_nodes(bench.machine, tmp_path)
    assert "node 5: is another device" in first.failure and second.failure == ""
    assert bench.angle.log == []


def test_nothing_is_restored_where_another_master_leads(bench: Bench, tmp_path: Path) -> None:
    keeping(bench, tmp_path)
    bench.driver.start()
    bench.driver.stop()
    leader = bench.make()
    bench.driver = leader
    leader.start()
    machine = parse_machine(can(bench.channel).replace("listen_s: 0", "listen_s: 60"))
    ended = threading.Event()
    thread = threading.Thread(target=lambda: [bench.once() for _ in iter(ended.is_set, True)])
    thread.start()
    try:
        with pytest.raises(BusError, match="another master leads it"):
            restore_nodes(machine, tmp_path)
    finally:
        ended.set()
        thread.join()


@pytest.mark.slow
@pytest.mark.parametrize(("state", "command"), [(0x05, 0x01), (0x04, 0x02), (0x7F, 0x80), (-1, 0x80)])
def test_nodes_are_left_in_the_state_they_were_found_in(bench: Bench, state: int, command: int) -> None:
    assert isinstance(bench.driver, CanopenDriver)
    for node in bench.driver._nodes.values():
        node.heartbeat_state = state  # as it was heard before anything was sent
    bench.driver.start()
    bench.driver.stop()
    sent = [bytes(message.data) for message in bench.sent() if message.arbitration_id == 0]
    assert [data for data in sent if data[1] == 5][-1] == bytes((command, 5))


@pytest.mark.parametrize(
    ("key", "value", "line", "words"),
    [
        ((0x1018, 3), struct.pack("<I", 7), "revision_number: 8", "revision (0x1018:3) is 0x00000007"),
        ((0x1018, 4), struct.pack("<I", 7), "serial_number: 8", "serial number (0x1018:4) is 0x00000007"),
        ((0x100A, 0), b"1.07", 'firmware: "1.08"', "has firmware '1.07' (0x100A), the machine file says '1.08'"),
    ],
)
def test_revision_serial_number_and_firmware_are_checked_when_given(
    bench: Bench, key: tuple[int, int], value: bytes, line: str, words: str
) -> None:
    bench.angle.objects[key] = value
    bench.driver = bench.make(can(bench.channel).replace("node: 5, device", f"node: 5, {line}, device"))
    (problem,) = bench.driver.start()
    assert words in problem
    assert bench.angle.log == []


def test_the_restore_command_puts_nodes_back(bench: Bench, tmp_path: Path) -> None:
    app = typer.Typer()
    cli.register(app)
    keeping(bench, tmp_path)
    before = own_setup(bench)
    path = tmp_path / "bench.yaml"
    path.write_text(can(bench.channel))
    bench.driver.start()
    bench.driver.stop()
    arguments = ["bus", "restore", str(path), "--data-dir", str(tmp_path)]
    result = CliRunner().invoke(app, [*arguments, "--json"])
    assert result.exit_code == 0
    assert [entry["node"] for entry in json.loads(result.stdout)] == [5, 6]
    assert (bench.angle.objects, bench.pressure.objects) == before
    assert "nothing to put back" in CliRunner().invoke(app, arguments).stdout
