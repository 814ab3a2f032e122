"""Valves in machine files: every key's meaning, what is refused, and what a file that says less costs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from bench_machines import plain

from daq import Machine, MachineFileError, Recording, machine_to_yaml, parse_machine, read_recording, write_recording
from daq.machine.machine_check import check_machine

VALVE = {
    "unit": "mA",
    "range": [4.0, 20.0],
    "neutral": 12.0,
    "extends": -1,
    "compensated": False,
    "counterbalance": True,
}
COMMAND = {"name": "j1.command", "quantity": "command", "joint": "j1", "unit": "mA"}


def bench(valve: dict[str, Any] | None = None, *channels: dict[str, Any], **keys: Any) -> dict[str, Any]:
    """The plain bench with a valve, and further channels and keys."""
    tree: dict[str, Any] = yaml.safe_load(plain())
    tree["joints"][0]["cylinder"]["valve"] = VALVE | (valve or {})
    tree["channels"] += [COMMAND, *channels]
    return tree | keys


def parsed(tree: dict[str, Any]) -> Machine:
    return parse_machine(yaml.safe_dump(tree), name="arm.yaml")


def refused(tree: dict[str, Any], *words: str) -> None:
    with pytest.raises(MachineFileError) as caught:
        parsed(tree)
    line = str(caught.value)
    assert "\n" not in line and line.startswith("arm.yaml")
    for word in words:
        assert word in line, line


def test_a_valve_says_what_its_command_means() -> None:
    supply = {"pressure": 19e6, "kind": "load_sensing", "flow_limit": 5e-4}
    machine = parsed(bench(None, supply=supply))
    assert machine.joints[0].cylinder is not None
    valve = machine.joints[0].cylinder.valve
    assert valve is not None
    assert (valve.range, valve.neutral, valve.extends, valve.full) == ((4.0, 20.0), 12.0, -1, 8.0)
    assert (valve.compensated, valve.counterbalance) == (False, True)
    assert (machine.supplied_at, machine.pump_limit) == (19e6, 5e-4)
    assert parse_machine(machine_to_yaml(machine)) == machine


def test_no_setting_of_a_node_may_write_a_command() -> None:
    def bus(setting: str) -> dict[str, Any]:
        node = {"node": 6, "settings": {setting: 0.0, "0x61A1:1 uint16": 3.0}}
        return {"name": "can0", "type": "canopen", "interface": "virtual", "channel": "none", "nodes": [node]}

    tree = bench()
    source = {"bus": "can0", "node": 6, "object": 0x6300, "subindex": 1, "data_type": "int16"}
    tree["channels"] = [c | {"source": source} if c["quantity"] == "command" else c for c in tree["channels"]]
    refused(tree | {"buses": [bus("0x6300:1 int16")]}, "node 6", "j1.command", "no command is ever sent")
    assert parsed(tree | {"buses": [bus("0x6300:2 int16")]}).buses[0].name == "can0"


def test_what_a_valve_leaves_out_is_unknown() -> None:
    tree = bench(supply={})
    tree["joints"][0]["cylinder"]["valve"] = {}
    tree["channels"][-1] = COMMAND | {"unit": "1"}
    machine = parsed(tree)
    valve = machine.joints[0].cylinder.valve  # type: ignore[union-attr]
    assert valve is not None and machine.supply is not None
    assert (valve.unit, valve.range, valve.neutral, valve.extends) == ("1", (-1.0, 1.0), 0.0, 1)
    assert (valve.compensated, valve.counterbalance, machine.supply.kind) == ("unknown", "unknown", "unknown")
    assert machine.supplied_at is None and machine.pump_limit is None


def test_a_supply_may_stand_below_hydraulics_and_must_not_contradict_it() -> None:
    hydraulics = {"supply_pressure": 21e6, "pump_flow": 6e-4}
    machine = parsed(bench(hydraulics=hydraulics))
    assert (machine.supplied_at, machine.pump_limit) == (21e6, 6e-4)
    assert parsed(bench(hydraulics=hydraulics, supply={"pressure": 21e6})).supplied_at == 21e6
    refused(bench(hydraulics=hydraulics, supply={"pressure": 20e6}), "pressure is 2e+07", "hydraulics.supply_pressure")
    refused(bench(hydraulics=hydraulics, supply={"flow_limit": 1e-4}), "hydraulics.pump_flow")


@pytest.mark.parametrize(
    ("valve", "words"),
    [
        ({"neutral": 0.0}, ("joints[0].cylinder.valve", "neutral 0 is not inside range 4 to 20")),
        ({"range": [20.0, 4.0]}, ("from low to high",)),
        ({"extends": 2}, ("valve.extends", "1 or -1")),
        ({"extends": True}, ("valve.extends", "1 or -1")),
        ({"unit": "bar"}, ("valve.unit", "'bar' is no unit of a command", "mA")),
        ({"compensated": "maybe"}, ("valve.compensated",)),
        ({"deadband": 0.05}, ("valve.deadband", "unknown key")),
        ({"neutral": float("nan")}, ("valve.neutral",)),
        ({"unit": "V"}, ("channels[5] (j1.command)", "is in mA", "in V")),
    ],
)
def test_valves_that_cannot_be_are_refused(valve: dict[str, Any], words: tuple[str, ...]) -> None:
    refused(bench(valve), *words)


def test_commands_and_spools_belong_to_a_valve() -> None:
    without = bench()
    del without["joints"][0]["cylinder"]["valve"]
    refused(without, "j1 has no valve, so no command", "add cylinder.valve:")
    refused(bench(None, {"name": "c", "quantity": "command", "unit": "mA"}), "belongs to a joint")
    refused(
        bench(None, {"name": "s", "quantity": "spool_position", "joint": "j1", "unit": "bar"}), "no unit of a command"
    )
    refused(bench(supply={"colour": "red"}), "supply.colour", "unknown key")
    refused(bench(supply={"kind": "gravity"}), "supply.kind")
    refused(bench(supply={"pressure": -1.0}), "supply.pressure")


def test_a_command_is_kept_as_it_was_sent() -> None:
    spool = {"name": "spool", "quantity": "spool_position", "joint": "j1", "unit": "%"}
    port = {"name": "port", "quantity": "head_port_pressure", "joint": "j1", "unit": "bar"}
    machine = parsed(bench(None, spool, port))
    sent = {channel.name: machine.conversion(channel).to_si(7.5) for channel in machine.channels}
    assert sent["j1.command"] == sent["spool"] == 7.5
    assert sent["port"] == pytest.approx(7.5e5)
    assert machine.si_unit(machine.channels[5]) == "mA"


def test_a_valve_needs_a_position_and_no_effort() -> None:
    tree = bench()
    pressures = ("head_pressure", "rod_pressure")
    tree["channels"] = [c for c in tree["channels"] if c["quantity"] not in pressures]
    assert parsed(tree).channel("command", "j1") is not None
    tree["channels"] = [c for c in tree["channels"] if c["quantity"] != "command"]
    refused(tree, "joints.j1: has no effort")


def findings(tmp_path: Path, tree: dict[str, Any]) -> str:
    file = tmp_path / "arm.yaml"
    file.write_text(yaml.safe_dump(tree), encoding="utf-8")
    checked = check_machine(file)
    assert not checked.errors
    return " | ".join(finding.under("") for finding in checked.findings)


def test_the_check_says_what_a_missing_channel_costs(tmp_path: Path) -> None:
    tree = bench()
    assert "supply pressure" in findings(tmp_path, tree)
    assert findings(tmp_path, tree | {"supply": {"pressure": 2e7}}) == ""
    supplied = {"name": "ps", "quantity": "supply_pressure", "unit": "bar"}
    assert findings(tmp_path, bench(None, supplied)) == ""
    tree["channels"] = [c for c in tree["channels"] if not c["quantity"].endswith("_pressure")]
    assert "only the curve and the delay" in findings(tmp_path, tree)
    mute = bench()
    mute["channels"] = [c for c in mute["channels"] if c["quantity"] != "command"]
    assert "no channel shows what this valve is told" in findings(tmp_path, mute)
    assert "a supply pressure of 210 Pa" in findings(tmp_path, tree | {"supply": {"pressure": 210.0}})


def recorded(tmp_path: Path, command: np.ndarray) -> Recording:
    machine = parsed(bench({"range": [4.0, 20.0]}))
    rng, t = np.random.default_rng(1), np.arange(500) / 50.0
    q = 0.3 * np.sin(t)
    values = {
        "j1.angle": q + 1e-5 * rng.normal(size=500), "j1.piston": 0.1 * (q + 1.2) + 1e-5 * rng.normal(size=500),
        "j1.head": 5e6 + 1e4 * rng.normal(size=500), "j1.rod": 4e6 + 1e4 * rng.normal(size=500),
        "oil": 300.0 + 0.1 * t, "j1.command": command,
    }  # fmt: skip
    file = tmp_path / "run.parquet"
    write_recording(file, machine, "train", t, values)
    return read_recording(file, machine, "train")


def test_a_command_may_stay_at_its_limit_and_may_stand_still(tmp_path: Path) -> None:
    full = np.where(np.arange(500) < 250, 20.0, 4.0)
    assert recorded(tmp_path, full).values["j1.command"].tolist() == full.tolist()
    assert np.ptp(recorded(tmp_path, np.full(500, 12.0)).values["j1.command"]) == 0
