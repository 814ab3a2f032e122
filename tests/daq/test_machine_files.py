"""Machine files: every mistake is one line with file, line and key; what is valid survives a round trip."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from bench_machines import can, modbus, plain
from hypothesis import given
from hypothesis import strategies as st

from daq import Machine, MachineFileError, load_machine, machine_to_yaml, parse_machine
from daq.machine.linkages import Direct, Polynomial, Rack, ThreePin
from daq.units import conversion

SAMPLES = Path(__file__).parents[2].parent / "shared" / "samples"


def refuse(text: str, *words: str) -> str:
    with pytest.raises(MachineFileError) as caught:
        parse_machine(text, name="arm.yaml")
    line = str(caught.value)
    assert "\n" not in line
    assert line.startswith("arm.yaml")
    for word in words:
        assert word in line, line
    return line


def without(text: str, quantity: str) -> str:
    return "\n".join(line for line in text.splitlines() if f"quantity: {quantity}" not in line)


def test_a_valid_file_describes_the_machine() -> None:
    machine = parse_machine(plain())
    assert machine.joint("j1").effort_unit == "N m"
    cylinder = machine.joints[0].cylinder
    assert cylinder is not None
    assert cylinder.head_area == pytest.approx(np.pi * 0.04**2)
    assert cylinder.rod_area == pytest.approx(np.pi * (0.04**2 - 0.02**2))
    head = machine.channel("head_pressure", "j1")
    assert head is not None
    assert machine.conversion(head).to_si(2.0) == pytest.approx(2e5)
    assert machine.channel("tank_pressure") is None
    with pytest.raises(KeyError):
        machine.joint("j2")


@pytest.mark.parametrize("text", [plain(), can("bus"), modbus(502)])
def test_a_machine_written_as_yaml_and_read_is_the_same(text: str) -> None:
    machine = parse_machine(text)
    assert parse_machine(machine_to_yaml(machine)) == machine


@pytest.mark.slow
def test_sample_machines_load() -> None:
    files = sorted(SAMPLES.glob("*/machine.yaml"))
    if not files:
        pytest.skip("shared/samples is not beside the repository")
    for file in files:
        machine = load_machine(file)
        assert parse_machine(machine_to_yaml(machine)) == machine


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(MachineFileError, match="no such file"):
        load_machine(tmp_path / "absent.yaml")
    binary = tmp_path / "binary.yaml"
    binary.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(MachineFileError, match=r"binary\.yaml: is not a text file; give a machine file \(YAML\)$"):
        load_machine(binary)
    binary.write_bytes(b"PAR1\x00\x00")  # valid UTF-8 all the same
    with pytest.raises(MachineFileError, match="is not a text file"):
        load_machine(binary)
    with pytest.raises(MachineFileError, match="is a directory; give the machine file itself"):
        load_machine(tmp_path)


def test_text_that_is_no_machine_file() -> None:
    refuse("joints: [", "not valid YAML", "docs/machine-file.md")
    refuse("just a text", "not a machine file")
    refuse("schema: hilfit/machine/7", "hilfit/machine/7")
    refuse("", "not a machine file")


def test_a_name_that_cannot_be_is_shown_short_with_what_it_may_be() -> None:
    refuse(re.sub("^name: .*$", "name: ../x y", plain(), flags=re.M), ":3: name: write letters, digits", "'../x y'")
    refuse(re.sub("^name: .*$", f"name: {'n' * 300}", plain(), flags=re.M), "80 characters or fewer", "nnn\u2026nnn")


def test_unknown_keys_are_named_with_their_line_and_a_guess() -> None:
    text = plain().replace("rod: 0.04", "rodd: 0.04")
    line = 1 + text[: text.index("rodd")].count("\n")
    refuse(text, f"arm.yaml:{line}", "joints[0].cylinder.rodd", "unknown key", "did you mean 'rod'")
    refuse(plain() + "colour: red\n", "colour", "unknown key")
    refuse(plain().replace("unit: degC", "unit: degC, nose_std: 1"), "channels[4].nose_std", "noise_std")


@pytest.mark.parametrize("unit", ["furlongs_per_fortnight", "kg", "", "bar bar", "3 bar +"])
def test_wrong_units_are_named(unit: str) -> None:
    refuse(
        plain().replace("joint: j1, unit: bar}", f"joint: j1, unit: '{unit}'}}"),
        "channels[3] (j1.rod)",
        f"'{unit}'",
        "Pa",
    )


def test_a_joint_has_a_position_and_an_effort() -> None:
    neither = without(without(plain(), "joint_position"), "piston_position")
    refuse(neither, "joints.j1", "no position", "joint_position or piston_position")
    parse_machine(without(plain(), "joint_position"))
    parse_machine(without(plain(), "piston_position"))
    refuse(without(plain(), "rod_pressure"), "joints.j1", "one pressure is not enough", "rod_pressure")
    refuse(without(without(plain(), "rod_pressure"), "head_pressure"), "joints.j1", "no effort", "cylinder_force")
    effort = without(without(plain(), "rod_pressure"), "head_pressure")
    parse_machine(effort + "\n- {name: f, quantity: cylinder_force, joint: j1, unit: kN}")
    parse_machine(effort + "\n- {name: tau, quantity: joint_effort, joint: j1, unit: N m}")


def test_channels_belong_where_they_can() -> None:
    line = 1 + plain().count("\n")
    refuse(plain() + "- {name: x, quantity: joint_position, unit: rad}", f"arm.yaml:{line}: channels[5]")
    refuse(without(plain(), "rod_pressure"), f"arm.yaml:{1 + plain()[: plain().index('- name: j1')].count(chr(10))}:")
    refuse(plain() + "- {name: x, quantity: joint_position, joint: j9, unit: rad}", "no joint 'j9'", "there are j1")
    refuse(plain() + "- {name: x, quantity: joint_position, unit: rad}", "belongs to a joint")
    refuse(plain() + "- {name: x, quantity: base_roll, joint: j1, unit: rad}", "remove joint")
    refuse(plain() + "- {name: x, quantity: rod_pressure, joint: j1, unit: bar}", "more than one rod_pressure")
    refuse(plain() + "- {name: oil, quantity: tank_pressure, unit: bar}", "channel 'oil' is there 2 times")
    refuse(
        plain().replace("quantity: oil_temperature", "quantity: oil_colour"), "channels[4].quantity", "oil_temperature"
    )
    refuse(plain().replace("range: [-1, 250]", "range: [250, -1]"), "channels[2].range", "from low to high")


def test_linkages_that_cannot_close() -> None:
    pins = "linkage: {type: three_pin, a: 0.45, b: 0.15, offset: 1.7, retracted: 0.38}"
    rack = "linkage: {type: rack, radius: 0.1, zero: -1.2}"
    narrow = plain().replace("position: [-1.0, 1.0]", "position: [-0.6, 0.6]")
    parse_machine(narrow.replace(rack, pins))
    refuse(narrow.replace(rack, pins.replace("0.38", "0.7")), "cannot close", "0.3 to 0.6 m")
    refuse(narrow.replace(rack, pins.replace("b: 0.15", "b: 1.5")), "cannot close")
    refuse(narrow.replace(rack, pins.replace("1.7", "0.0").replace("0.38", "0.25")), "dead centre")
    refuse(plain().replace("zero: -1.2", "zero: 5.0"), "cannot close", "zero")
    refuse(plain().replace("type: rack", "type: rope"), "linkage", "rope")


def test_joint_limits_that_exceed_the_stroke_are_refused() -> None:
    refuse(plain().replace("stroke: 0.3", "stroke: 0.15"), "joints[0]", "stroke 0.15 m is exceeded", "0.22")


def test_impossible_dimensions_are_refused() -> None:
    refuse(plain().replace("rod: 0.04", "rod: 0.09"), "thinner than the bore")
    refuse(plain().replace("bore: 0.08", "bore: -0.08"), "bore", "greater than 0")
    refuse(plain().replace("bore: 0.08", "bore: .nan"), "bore")
    refuse(plain().replace("bore: 0.08", "bore: thick"), "bore", "'thick'")
    refuse(plain().replace("position: [-1.0, 1.0]", "position: [1.0, -1.0]"), "limits.position", "from low to high")
    refuse(plain().replace("alpha: 0.0, ", ""), "dh.alpha", "missing")


def test_sources_fit_their_buses() -> None:
    text = can("c")
    refuse(text.replace("bus: can0, node: 5", "bus: can1, node: 5"), "no bus 'can1'", "'can0'")
    refuse(text.replace("node: 5, object: 0x6004", "node: 5, object: sixty"), "sixty", "0x6004")
    refuse(text.replace("node: 5, object", "node: 500, object"), "node", "127")
    refuse(text.replace("data_type: uint32", "data_type: uint20"), "data_type")
    refuse(text.replace('"0x61A1:1 uint16"', '"filter"'), "'filter' is no object")
    refuse(text.replace('"0x61A1:1 uint16"', '"0x61A1:1 uint9"'), "unknown data type")
    other = text.replace(
        "{bus: can0, node: 5, object: 0x6004, data_type", "{bus: can0, unit: 5, register: 4, data_type"
    )
    refuse(other, "j1.angle", "does not fit bus 'can0'")


def test_buses_of_other_packages() -> None:
    text = can("c").replace("type: canopen", "type: ethercat").replace("interface: virtual\n", "options: {nic: eth1}\n")
    text = text[: text.index("  channel: c")]
    refuse(text, "does not fit bus 'can0' of type ethercat")
    for number in range(3):
        text = text.replace("{bus: can0, node", f"{{bus: can0, address: {{slot: {number}}}, node", 1)
    refuse(text, "source.node", "unknown key")
    plain_text = "\n".join(
        line.split(", node")[0] + "}}" if "node:" in line and "source" in line else line for line in text.splitlines()
    )
    machine = parse_machine(plain_text)
    assert machine.buses[0].type == "ethercat"
    assert parse_machine(machine_to_yaml(machine)) == machine
    refuse(can("c").replace("type: canopen", "type: canopenn"), "buses[0]", "'canopenn'; did you mean 'canopen'?")


def test_a_prismatic_joint_is_measured_in_metres() -> None:
    text = plain().replace("- name: j1\n", "- name: j1\n  type: prismatic\n").replace("unit: deg}", "unit: mm}")
    machine = parse_machine(text)
    angle = machine.channel("joint_position", "j1")
    assert angle is not None and machine.si_unit(angle) == "m"
    assert machine.joints[0].effort_unit == "N"
    refuse(plain().replace("- name: j1\n", "- name: j1\n  type: prismatic\n"), "unit 'deg'", "m")


def test_a_joint_without_cylinder_has_no_pressures() -> None:
    tree = yaml.safe_load(plain())
    tree["joints"][0]["cylinder"] = None
    refuse(yaml.safe_dump(tree), "j1 has no cylinder")


@given(q=st.floats(-3, 3), a=st.floats(0.1, 2), b=st.floats(0.1, 2), offset=st.floats(-3, 3))
def test_three_pins_form_a_triangle(q: float, a: float, b: float, offset: float) -> None:
    # Independent of the law of cosines: the distance of the two pins in the plane.
    pin = a * np.array([1.0, 0.0]) - b * np.array([np.cos(q + offset), np.sin(q + offset)])
    linkage = ThreePin(type="three_pin", a=a, b=b, offset=offset, retracted=0.2)
    assert linkage.piston_position(q) == pytest.approx(np.linalg.norm(pin) - 0.2, abs=1e-7)


def test_rack_direct_and_polynomial_linkages_give_the_piston_position() -> None:
    q = np.linspace(-1, 1, 5)
    np.testing.assert_allclose(Rack(type="rack", radius=0.1, zero=-0.5).piston_position(q), 0.1 * (q + 0.5))
    np.testing.assert_allclose(Direct(type="direct").piston_position(q), q)
    np.testing.assert_allclose(
        Polynomial(type="polynomial", coefficients=(0.1, 0.2, 0.3)).piston_position(q), 0.1 + 0.2 * q + 0.3 * q**2
    )


@pytest.mark.parametrize(
    ("unit", "si", "value", "expected"),
    [
        ("bar", "Pa", 1.0, 1e5),
        ("psi", "Pa", 1.0, 6894.757293168),
        ("mm", "m", 2.0, 2e-3),
        ("deg", "rad", 180.0, np.pi),
        ("degC", "K", 20.0, 293.15),
        ("degF", "K", 32.0, 273.15),
        ("kN", "N", 1.5, 1500.0),
    ],
)
def test_units_are_converted_to_si_and_back(unit: str, si: str, value: float, expected: float) -> None:
    there = conversion(unit, si)
    assert there.to_si(value) == pytest.approx(expected, rel=1e-9)
    assert there.from_si(expected) == pytest.approx(value, rel=1e-9)


def test_the_schema_of_machine_files_is_a_json_schema() -> None:
    schema = json.loads(json.dumps(Machine.model_json_schema()))
    assert {"schema", "name", "gravity", "joints", "channels"} <= set(schema["required"])
    assert schema["additionalProperties"] is False
