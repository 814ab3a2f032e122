"""Machine files of joints without cylinders, of coupled motors, and of cylinders on a test bench."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
import yaml
from bench_machines import plain

from daq import Machine, MachineFileError, machine_to_yaml, parse_machine

WRIST = """
schema: hilfit/machine/1
name: wrist
rate_hz: 500
gravity: [0.0, 0.0, -9.81]
joints:
- name: bend
  dh: {a: 0.0, alpha: 1.5708, d: 0.0, theta: 0.0}
  limits: {position: [-2.0, 2.0], velocity: 5.0, acceleration: 50.0}
  drive: {ratio: 45.0, offset: true}
- name: turn
  dh: {a: 0.0, alpha: 0.0, d: 0.0, theta: 0.0}
  limits: {position: [-3.0, 3.0], velocity: 5.0, acceleration: 50.0}
  drive: {ratio: -32.0, coupled: [{joint: bend, ratio: 16.0}]}
channels:
- {name: m1.angle, quantity: motor_position, joint: bend, unit: rad}
- {name: m1.torque, quantity: motor_effort, joint: bend, unit: N m}
- {name: m2.angle, quantity: motor_position, joint: turn, unit: deg}
- {name: m2.torque, quantity: motor_effort, joint: turn, unit: N cm}
"""


def changed(text: str, **joint: Any) -> str:
    """The file with keys of its last joint replaced."""
    tree = yaml.safe_load(text)
    tree["joints"][-1].update(joint)
    return str(yaml.safe_dump(tree))


def without(text: str, name: str) -> str:
    return "\n".join(line for line in text.splitlines() if f"name: {name}," not in line)


def refuse(text: str, *words: str) -> None:
    with pytest.raises(MachineFileError) as caught:
        parse_machine(text, name="arm.yaml")
    line = str(caught.value)
    assert "\n" not in line and line.startswith("arm.yaml:")
    for word in words:
        assert word in line, line


def test_ratios_turn_joint_positions_into_motor_positions() -> None:
    machine = parse_machine(WRIST)
    np.testing.assert_array_equal(machine.ratios, [[45.0, 0.0], [16.0, -32.0]])
    assert machine.at_motors == (0, 1)
    assert parse_machine(machine_to_yaml(machine)) == machine
    torque = machine.channel("motor_effort", "turn")
    assert torque is not None and machine.conversion(torque).to_si(100.0) == pytest.approx(1.0)


def test_a_file_without_drives_has_the_ratio_one() -> None:
    machine = parse_machine(plain())
    np.testing.assert_array_equal(machine.ratios, np.eye(1))
    assert machine.at_motors == ()
    assert machine.joints[0].drive is None


def test_impossible_drives_are_refused() -> None:
    refuse(changed(WRIST, drive={"ratio": 0.0}), "drive", "ratio must not be 0")
    refuse(changed(WRIST, drive={"coupled": [{"joint": "bend", "ratio": 0.0}]}), "coupled[0].ratio must not be 0")
    refuse(changed(WRIST, drive={"coupled": [{"joint": "bent", "ratio": 1.0}]}), "joints.turn", "did you mean 'bend'?")
    refuse(changed(WRIST, drive={"coupled": [{"joint": "turn", "ratio": 1.0}]}), "names the joint itself")
    twice = [{"joint": "bend", "ratio": 1.0}, {"joint": "bend", "ratio": 2.0}]
    refuse(changed(WRIST, drive={"coupled": twice}), "'bend' is there 2 times")
    refuse(changed(WRIST, drive={"gear": 3}), "joints[1].drive.gear", "unknown key")
    cylinder = yaml.safe_load(plain())["joints"][0]["cylinder"]
    refuse(changed(plain(), cylinder=cylinder, drive={"ratio": 2.0}), "both a cylinder and a drive")


def test_motors_that_do_not_tell_their_joints() -> None:
    tree = yaml.safe_load(WRIST)
    tree["joints"][0]["drive"] = {"ratio": 16.0, "coupled": [{"joint": "turn", "ratio": -32.0}]}
    refuse(yaml.safe_dump(tree), "do not tell the joints", "correct ratio, coupled")


def test_every_motor_that_acts_on_a_joint_is_measured() -> None:
    refuse(without(WRIST, "m2.torque"), "joints.bend", "motor_effort of turn")
    refuse(without(WRIST, "m1.angle"), "joints.bend", "no position", "joint_position or motor_position")
    known = without(WRIST, "m1.torque") + "\n- {name: bend.torque, quantity: joint_effort, joint: bend, unit: N m}"
    parse_machine(known)
    refuse(changed(WRIST, drive=None), "turn has no drive", "add drive: with its ratio")


def test_a_vented_chamber_needs_no_channel_and_has_none() -> None:
    tree = yaml.safe_load(plain())
    tree["joints"][0]["cylinder"]["vented"] = "rod"
    refuse(yaml.safe_dump(tree), "channels[3] (j1.rod)", "vented")
    tree["channels"] = [c for c in tree["channels"] if c["name"] != "j1.rod"]
    machine = parse_machine(yaml.safe_dump(tree))
    assert machine.joints[0].cylinder is not None and machine.joints[0].cylinder.vented == "rod"
    tree["channels"] = [c for c in tree["channels"] if c["name"] != "j1.head"]
    refuse(yaml.safe_dump(tree), "joints.j1", "no effort")


def test_an_external_force_stands_beside_both_pressures() -> None:
    cell = "- {name: cell, quantity: external_force, joint: j1, unit: kN}\n"
    machine = parse_machine(plain() + cell)
    channel = machine.channel("external_force", "j1")
    assert channel is not None and machine.conversion(channel).to_si(2.0) == pytest.approx(2000.0)
    force = "- {name: f, quantity: cylinder_force, joint: j1, unit: kN}\n"
    lone = "\n".join(line for line in plain().splitlines() if "_pressure" not in line) + "\n" + force + cell
    refuse(lone, "joints.j1", "external_force needs head_pressure and rod_pressure")
    refuse(WRIST + "- {name: cell, quantity: external_force, joint: bend, unit: N}\n", "bend has no cylinder")


def test_the_json_schema_knows_the_extension() -> None:
    schema = json.loads(json.dumps(Machine.model_json_schema()))
    assert {"ratio", "coupled", "offset", "effort"} == set(schema["$defs"]["Drive"]["properties"])
    assert {"joint", "ratio"} == set(schema["$defs"]["Coupling"]["required"])
    assert "vented" in schema["$defs"]["Cylinder"]["properties"]
    quantities = schema["$defs"]["Channel"]["properties"]["quantity"]["enum"]
    assert {"motor_position", "motor_effort", "external_force"} <= set(quantities)
