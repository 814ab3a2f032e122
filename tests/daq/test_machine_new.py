"""A machine file's buses and channels from what devices say: profiles worked out by hand from CiA 404, 406, 410."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest
import yaml
from bench_machines import plain
from typer.testing import CliRunner

from daq.drivers.canopen.profiles import measured
from daq.machine.machine_file import load_machine
from server.commands.command_line import build

EDS = Path(__file__).parents[2] / "sim_backends" / "devices" / "eds"
DBC = """
VERSION ""
BU_: X
BO_ 291 Arm: 8 X
 SG_ BoomAngle : 0|16@1- (0.01,0) [-180|180] "deg" X
 SG_ HeadPressure : 16|16@1+ (0.1,0) [0|400] "bar" X
 SG_ Counter : 32|8@1+ (1,0) [0|255] "" X
"""


def node(number: int, device_type: int, objects: dict[str, int], pdos: list[Any]) -> dict[str, Any]:
    return {
        "node": number, "device_type": device_type, "vendor_id": 1, "product_code": 2, "name": "X", "profile": "",
        "objects": objects, "pdos": pdos,
    }  # fmt: skip


def scan_file(folder: Path, masters: str = "") -> Path:
    tpdo = {
        "number": 1,
        "cob_id": 0x186,
        "transmission": 1,
        "event_ms": 0,
        "entries": [[0x6130, 1, 32], [0x6130, 2, 32]],
    }
    encoder = {
        "number": 1,
        "cob_id": 0x185,
        "transmission": 255,
        "event_ms": 20,
        "entries": [[0x2000, 0, 16], [0x6004, 0, 32]],
    }
    content = {
        "schema": "hilfit/scan/1",
        "buses": [
            {
                "bus": {"name": "can", "type": "canopen", "interface": "socketcan", "channel": "can0"},
                "masters": masters,
                "nodes": [
                    node(5, 0x0001_0196, {"0x6001:0": 4096, "0x6002:0": 4096}, [encoder]),
                    node(6, 0x0002_0194, {"0x6131:1": 0x004E_0000, "0x6131:2": 0x004E_0000}, [tpdo]),
                ],
            }
        ],
    }
    path = folder / "scan.json"
    path.write_text(json.dumps(content))
    return path


def run(*arguments: object, typed: str | None = None) -> tuple[int, str, str]:
    result = CliRunner().invoke(build(), ["machine", "new", *map(str, arguments)], input=typed)
    return result.exit_code, result.stdout, result.stderr


def joints_file(folder: Path) -> Path:
    path = folder / "joints.yaml"
    path.write_text(plain())
    return path


def test_a_scan_and_joints_make_a_machine_file_that_can_be_acquired(tmp_path: Path) -> None:
    output = tmp_path / "machine.yaml"
    code, said, _ = run("--scan", scan_file(tmp_path), "--joints", joints_file(tmp_path), "--yes", "-o", output)
    assert code == 0 and "3 channels" in said and "note:" not in said
    machine = load_machine(output)
    angle, head, rod = machine.channels
    assert (angle.quantity, angle.joint, angle.unit) == ("joint_position", "j1", "rad")
    assert angle.source is not None and angle.source.scale == pytest.approx(2 * math.pi / 4096)
    assert angle.source.modulo == 4096  # type: ignore[union-attr]
    assert (head.quantity, rod.quantity, head.unit) == ("head_pressure", "rod_pressure", "bar")
    assert [n.device_type for n in machine.buses[0].nodes] == [0x0001_0196, 0x0002_0194]  # type: ignore[union-attr]


def test_what_was_written_and_fails_the_check_is_no_success(tmp_path: Path) -> None:
    output, joints = tmp_path / "machine.yaml", joints_file(tmp_path)
    joints.write_text(joints.read_text().replace("rod: 0.04", "rod: 0.09"))  # wider than its bore
    code, said, _ = run("--scan", scan_file(tmp_path), "--joints", joints, "--yes", "-o", output)
    assert code == 1 and "note:" in said and "rod" in said and f"hilfit machine check {output}" in said
    assert CliRunner().invoke(build(), ["machine", "check", str(output)]).exit_code != 0
    code, said, _ = run("--scan", scan_file(tmp_path), "--joints", joints, "--json", "-o", output, "--force")
    assert code == 1 and json.loads(said)["notes"]


def test_where_another_master_leads_pdos_are_taken_as_they_are(tmp_path: Path) -> None:
    output = tmp_path / "machine.yaml"
    scan = scan_file(tmp_path, masters="12 SYNC")
    assert run("--scan", scan, "--joints", joints_file(tmp_path), "--yes", "-o", output)[0] == 0
    machine = load_machine(output)
    sources = [channel.source for channel in machine.channels]
    assert machine.buses[0].listen_only  # type: ignore[union-attr]
    assert [(s.cob_id, s.byte, s.synchronous) for s in sources] == [  # type: ignore[union-attr]
        (0x185, 2, False), (0x186, 0, True), (0x186, 4, True),
    ]  # fmt: skip


def test_the_wizard_asks_and_refuses_what_cannot_be(tmp_path: Path) -> None:
    output = tmp_path / "part.yaml"
    typed = "joint9 joint_position\nhead_pressure\njoint2 joint_position\n\nskip\n"
    code, said, _ = run("--scan", scan_file(tmp_path), "-o", output, typed=typed)
    assert code == 0
    assert "there is no joint 'joint9'" in said and "there is no 'head_pressure' for this" in said
    channels = yaml.safe_load(output.read_text())["channels"]
    assert [channel["name"] for channel in channels] == ["joint2.angle", "joint1.head_pressure"]
    assert "# left out: can node 6 (X) 0x6130:2" in output.read_text()


def test_eds_files_tell_objects_and_scaling(tmp_path: Path) -> None:
    output = tmp_path / "part.yaml"
    files = [f"5={EDS / 'rotary_encoder.eds'}", f"9={EDS / 'inclinometer.eds'}"]
    code, _, said = run("--eds", files[0], "--eds", files[1], "--yes", "-o", output)
    assert code == 0, said
    content = yaml.safe_load(output.read_text())
    (angle,) = [channel for channel in content["channels"] if channel["quantity"] == "joint_position"]
    assert angle["source"]["object"] == 0x6004 and angle["source"]["scale"] == pytest.approx(2 * math.pi / 2**20)
    assert [entry["node"] for entry in content["buses"][0]["nodes"]] == [5, 9]


def test_dbc_files_tell_signals_by_their_units(tmp_path: Path) -> None:
    (tmp_path / "arm.dbc").write_text(DBC)
    output = tmp_path / "part.yaml"
    code, said, _ = run("--dbc", tmp_path / "arm.dbc", "--yes", "-o", output)
    assert code == 0 and "2 channels" in said
    content = yaml.safe_load(output.read_text())
    assert content["buses"] == [
        {"name": "can", "type": "can_signals", "interface": "socketcan", "channel": "can0", "dbc": ["arm.dbc"]}
    ]
    assert [(c["quantity"], c["unit"], c["source"]["signal"]) for c in content["channels"]] == [
        ("joint_position", "deg", "BoomAngle"), ("head_pressure", "bar", "HeadPressure"),
    ]  # fmt: skip


def test_a_valves_command_is_what_a_person_says_and_never_proposed(tmp_path: Path) -> None:
    signals = ' SG_ BoomValve : 0|16@1- (0.1,0) [-100|100] "%" X\n SG_ PortA : 16|16@1+ (0.1,0) [0|250] "bar" X\n'
    (tmp_path / "valve.dbc").write_text('VERSION ""\nBU_: X\nBO_ 600 Valve: 8 X\n' + signals)
    output = tmp_path / "part.yaml"
    code, said, _ = run("--dbc", tmp_path / "valve.dbc", "--yes", "-o", output)
    assert code == 0 and "1 channel" in said and "# left out: can Valve BoomValve (sent)" in output.read_text()
    typed = "joint1 head_pressure\njoint1 command\njoint1 rod_port_pressure\n"
    code, said, _ = run("--dbc", tmp_path / "valve.dbc", "-o", output, "--force", typed=typed)
    assert code == 0 and "there is no 'head_pressure' for this; one of command, spool_position" in said
    channels = yaml.safe_load(output.read_text())["channels"]
    assert [(c["name"], c["quantity"], c["unit"]) for c in channels] == [
        ("joint1.command", "command", "%"), ("joint1.rod_port_pressure", "rod_port_pressure", "bar"),
    ]  # fmt: skip


def test_an_inclinometer_and_a_linear_transducer() -> None:
    tilt = measured(0x0003_019A, {(0x6000, 0): 100})
    assert [(own.index, own.data_type, own.unit, own.scale) for own in tilt] == [
        (0x6010, "int16", "deg", pytest.approx(0.1)), (0x6020, "int16", "deg", pytest.approx(0.1)),
    ]  # fmt: skip
    (length,) = measured(0x000A_0196, {(0x6005, 1): 5000})  # 5000 nm
    assert (length.index, length.unit, length.scale) == (0x6020, "mm", pytest.approx(0.005))


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        ((), "give --scan, --eds or --dbc"),
        (("--eds", "encoder.eds"), "write NODE=FILE"),
        (("--scan", "nowhere.json"), "no such file"),
        (("--scan", __file__), "is no scan"),
    ],
)
def test_bad_usage_is_one_line_and_writes_nothing(arguments: tuple[str, ...], line: str, tmp_path: Path) -> None:
    output = tmp_path / "machine.yaml"
    code, _, said = run(*arguments, "-o", output)
    assert code == 2 and line in said and said.count("\n") == 1
    assert not output.exists()


@pytest.mark.parametrize("bus", [{}, {"bus": {}}, {"bus": {"name": "can", "type": "canopen"}}, {"bus": 3}, None])
def test_a_scan_without_its_buses_is_none(bus: object, tmp_path: Path) -> None:
    scan, output = tmp_path / "scan.json", tmp_path / "machine.yaml"
    scan.write_text(json.dumps({"schema": "hilfit/scan/1", "buses": [bus]}))
    code, _, said = run("--scan", scan, "--yes", "-o", output)
    assert code == 2 and "scan.json: is no scan" in said and said.count("\n") == 1
    assert not output.exists()


def test_machine_new_does_not_overwrite_a_file(tmp_path: Path) -> None:
    output = tmp_path / "machine.yaml"
    output.write_text("mine")
    assert run("--scan", scan_file(tmp_path), "--yes", "-o", output)[0] == 2
    assert output.read_text() == "mine"
