"""``machine check``: all findings at once, with line, key and cure; ranges of motion; pictures; sound files pass."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
import yaml
from bench_machines import can, modbus, plain
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from daq import messages
from daq.commands import cli_machine
from daq.machine.machine_check import Checked, check_machine
from daq.machine.machine_file import parse_machine
from daq.machine.plausible import unusual_values
from daq.machine.travel import travel_of

#: Keys that plausibility looks at.
KEYS = [
    "joints",
    "channels",
    "dh",
    "limits",
    "position",
    "cylinder",
    "linkage",
    "bore",
    "rod",
    "stroke",
    "a",
    "alpha",
    "range",
    "unit",
    "quantity",
    "joint",
    "name",
    "gravity",
    "hydraulics",
    "retracted",
    "type",
    "velocity",
]
HERE = Path(__file__).parents[2]
SHARED = HERE.parent / "shared"


def three(**changes: Any) -> dict[str, Any]:
    """A sound excavator of three joints as YAML content; ``changes`` are dotted places in it, with ``__`` for dots."""
    joints, channels = [], []
    for number, (bore, length) in enumerate(((0.12, 5.0), (0.11, 2.5), (0.1, 1.2))):
        name = f"j{number}"
        joints.append(
            {
                "name": name,
                "dh": {"a": length, "alpha": 0.0, "d": 0.0, "theta": 0.0},
                "limits": {"position": [-0.6, 0.6], "velocity": 0.6, "acceleration": 1.5},
                "cylinder": {
                    "bore": bore, "rod": 0.07, "stroke": 0.9, "damping": 100.0, "moving_mass": None,
                    "linkage": {"type": "three_pin", "a": 1.3, "b": 0.46, "offset": 1.72, "retracted": 1.1},
                },
            }
        )  # fmt: skip
        for quantity, unit in (("joint_position", "deg"), ("head_pressure", "bar"), ("rod_pressure", "bar")):
            channels.append({"name": f"{name}.{quantity}", "quantity": quantity, "joint": name, "unit": unit})
    content: dict[str, Any] = {
        "schema": "hilfit/machine/1", "name": "digger", "rate_hz": 50, "gravity": [0.0, -9.81, 0.0], "joints": joints,
        "channels": channels, "hydraulics": {"supply_pressure": 25e6, "pump_flow": 2e-3},
    }  # fmt: skip
    for place, value in changes.items():
        *way, last = (int(part) if part.isdigit() else part for part in place.split("__"))
        node: Any = content
        for part in way:
            node = node[part]
        node[last] = value
    return content


def checked(tmp_path: Path, content: dict[str, Any] | str) -> Checked:
    file = tmp_path / "arm.yaml"
    file.write_text(content if isinstance(content, str) else yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return check_machine(file)


def test_a_sound_file_has_no_findings(tmp_path: Path) -> None:
    for content in (three(), plain(), can("c"), modbus(502)):
        result = checked(tmp_path, content)
        assert result.machine is not None and result.findings == ()


def test_machines_that_are_there_have_no_findings() -> None:
    files = [*(HERE / "benchmarks/measured/machines").glob("*.yaml"), HERE / "sim_backends/machines/folding_arm.yaml"]
    files += [*SHARED.glob("samples/*/machine.yaml"), *SHARED.glob("data/*/machine.yaml")]
    assert len(files) >= 4
    for file in files:
        assert check_machine(file).findings == (), file


MISTAKES: list[tuple[str, Any, str, str]] = [
    # place, what was written, key of the warning, words of its text and cure
    ("joints__0__cylinder__bore", 0.8, "joints[0].cylinder.bore", "0.8 m is outside the usual 0.005 to 0.5 m"),
    ("joints__0__cylinder__rod", 0.007, "joints[0].cylinder.rod", "0.0583 of the bore"),
    ("joints__0__cylinder__rod", 0.119, "joints[0].cylinder.rod", "0.992 of the bore"),
    ("joints__1__cylinder__bore", 0.011 * 91, "joints[1].cylinder.bore", "outside"),
    ("joints__0__cylinder__stroke", 900.0, "joints[0].cylinder.stroke", "in mm, write 0.9"),
    ("joints__0__cylinder__stroke", 9.0, "joints[0].cylinder.stroke", "75 bores"),
    ("joints__0__cylinder__moving_mass", 20000.0, "joints[0].cylinder.moving_mass", "times a steel rod"),
    ("joints__0__dh__a", 5000.0, "joints[0].dh.a", "in mm, write 5 (m)"),
    ("joints__0__dh__alpha", 90, "joints[0].dh.alpha", "in degrees, write 1.570796"),
    ("joints__0__dh__alpha", 1.57, "joints[0].dh.alpha", "write 1.5707963 if that is meant"),
    ("joints__0__dh__theta", -45.0, "joints[0].dh.theta", "in degrees, write -0.7853982"),
    ("joints__0__limits__velocity", 34.0, "joints[0].limits.velocity", "in degrees, write 0.593412"),
    ("joints__0__limits__acceleration", 90000.0, "joints[0].limits.acceleration", "outside the usual"),
    ("joints__0__limits__position", [-0.06, 0.06], "joints[0].limits.position", "5.5 % of its stroke"),
    ("joints__0__cylinder__linkage__offset", 1.72 + 4 * np.pi, "joints[0].cylinder.linkage.offset", "than a turn"),
    ("gravity", [0.0, -98.1, 0.0], "gravity", "98.1 m/s^2, on Earth it is 9.81"),
    ("gravity", [0.0, -1.0, 0.0], "gravity", "magnitude of 1 m/s^2"),
    ("rate_hz", 0.05, "rate_hz", "0.05 Hz is unusual"),
    ("hydraulics__supply_pressure", 250, "hydraulics.supply_pressure", "in bar, write 2.5e+07"),
    ("hydraulics__pump_flow", 120, "hydraulics.pump_flow", "in l/min, write 0.002"),
    ("channels__1__range", [0, 25e6], "channels[1].range", "ends at 2.5e+07 bar"),
    ("channels__0__range", [-3.2, 3.2], "channels[0].range", "covers 9 % of the joint's limits"),
    ("channels__0__noise_std", 60.0, "channels[0].noise_std", "more than a tenth"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("place", "value", "key", "words"), MISTAKES, ids=[f"{m[0]}-{m[1]}" for m in MISTAKES])
def test_a_mistake_is_named_with_line_key_and_cure(
    tmp_path: Path, place: str, value: Any, key: str, words: str
) -> None:
    content = three(**{place: value})
    if place.endswith("noise_std"):
        content["channels"][0]["range"] = [-180, 180]
    result = checked(tmp_path, content)
    found = {finding.key: finding for finding in result.findings}
    assert key in found, result.findings
    line = found[key].under("arm.yaml")
    assert words in line, line
    assert found[key].cure
    text = (tmp_path / "arm.yaml").read_text(encoding="utf-8").splitlines()
    assert key.split(".")[-1].split("[")[0] in text[(found[key].line or 0) - 1]


def test_a_slipped_decimal_of_one_bore_is_seen_beside_the_others(tmp_path: Path) -> None:
    result = checked(tmp_path, three(joints__1__cylinder__bore=0.011, joints__1__cylinder__rod=0.007))
    assert any("slipped decimal" in finding.under("arm") for finding in result.findings)


def test_lever_arms_and_piston_speeds_come_from_the_linkage(tmp_path: Path) -> None:
    near = three(joints__0__limits__position=[0.0, 1.4195])  # offset 1.72: dead centre at 1.4216 rad
    near["joints"][0]["cylinder"]["linkage"]["retracted"] = 1.0
    words = " ".join(f.under("arm") for f in checked(tmp_path, near).findings)
    assert "near a dead centre" in words
    rack = three(joints__0__cylinder__linkage={"type": "rack", "radius": 0.0008, "zero": -0.7})
    assert "lever arm of 0.0008" in " ".join(f.under("arm") for f in checked(tmp_path, rack).findings)
    fast = three(joints__0__limits__velocity=4.9)
    assert "moves the piston at 2.25 m/s" in " ".join(f.under("arm") for f in checked(tmp_path, fast).findings)


def test_all_errors_and_warnings_are_said_at_once(tmp_path: Path) -> None:
    content = three(
        gravity=[0.0, -981.0, 0.0],
        joints__0__cylinder__bore=-0.12,
        joints__1__cylinder__linkage__offset=0.0,
        channels__1__unit="kg",
        channels__3__joint="j7",
    )
    content["joints"][2]["cylinder"]["strok"] = 1
    result = checked(tmp_path, content)
    assert result.machine is None
    said = "\n".join(finding.under("arm.yaml") for finding in result.findings)
    for words in (
        "joints[0].cylinder.bore: must be greater than 0",
        "joints[1]: cylinder.linkage",
        "joints[2].cylinder.strok: unknown key; did you mean 'stroke'?",
        "unit 'kg' cannot be turned into Pa",
        "no joint 'j7'",
        "warning: gravity",
    ):
        assert words in said
    assert [f.level for f in result.findings] == sorted(f.level for f in result.findings)
    assert all(finding.line for finding in result.findings)


def test_an_invalid_joint_does_not_hide_findings_of_the_others(tmp_path: Path) -> None:
    content = three(joints__0__cylinder__bore=-0.12)
    content["channels"] = [c for c in content["channels"] if c["name"] != "j1.rod_pressure"]
    said = "\n".join(finding.under("arm") for finding in checked(tmp_path, content).findings)
    assert "joints.j1: has no effort: one pressure is not enough" in said
    assert "j0: has no" not in said  # what is broken is not thereby missing


PLACES: list[tuple[dict[str, Any], str, str]] = [
    # what was written, its line, and words of what is said of it
    ({"joints__1__cylinder__rod": 0.2}, "    rod: 0.2", "rod 0.2 m"),
    ({"joints__1__cylinder__linkage__offset": 0.0}, "    linkage:", "cylinder.linkage cannot close"),
    ({"hydraulics": {"supply_pressure": 1e6, "tank_pressure": 2e6}}, "  supply_pressure: 1000000.0", "must be above"),
    ({"channels__3__joint": "j7"}, "- name: j1.joint_position", "there is no joint"),
    ({"channels__4__quantity": "rod_pressure", "joints__0__dh__a": "x"}, "- name: j1", "joints.j1: has more than one"),
    ({"channels__4__name": "j0.head_pressure"}, "- name: j0.head_pressure", "is there 2 times"),
    # What is refused as a name and looks like the place of another part: what its joint lacks is told all the same.
    ({"joints__2__name": "j1: x", "channels__6__joint": "j1: x"}, "- name: 'j1: x'", "joints.j1: x: has no effort"),
    ({"joints__2__name": "channels[0]", "channels__6__joint": "channels[0]"}, "- name: channels[0]", "has no effort"),
]  # fmt: skip


@pytest.mark.parametrize(("changes", "line", "words"), PLACES, ids=[place[2] for place in PLACES])
def test_a_line_is_no_matter_of_words(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, changes: dict[str, Any], line: str, words: str
) -> None:
    content = three(**changes)
    if "joints__2__name" in changes:
        content["channels"] = content["channels"][:7]
    english = checked(tmp_path, content).findings
    lines = (tmp_path / "arm.yaml").read_text(encoding="utf-8").splitlines()
    assert line in [lines[(f.line or 0) - 1] for f in english if words in f.text], english
    worded = messages._worded
    monkeypatch.setattr(messages, "_worded", lambda code, values, *_: f"Fehler: {worded(code, values, 'de')}")
    german = checked(tmp_path, content).findings
    assert [(f.line, f.key) for f in german] == [(f.line, f.key) for f in english]
    assert not {f.text for f in german} & {f.text for f in english}


def test_text_that_is_no_machine_file(tmp_path: Path) -> None:
    for text, words in (("joints: [", "not valid YAML"), ("just text", "not a machine file")):
        (finding,) = checked(tmp_path, text).findings
        assert finding.level == "error" and words in finding.text and finding.key == ""
        assert finding.under("x").startswith("x") and "arm.yaml" not in finding.text


@pytest.mark.slow
@given(
    st.recursive(
        st.none() | st.booleans() | st.floats() | st.text(max_size=4),
        lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.sampled_from(KEYS), inner, max_size=5),
        max_leaves=25,
    )
)
@settings(max_examples=80, deadline=None)
def test_malformed_content_is_passed_over(content: Any) -> None:
    found = list(unusual_values(content if isinstance(content, dict) else {"joints": content, "channels": content}))
    assert all(unusual.text and unusual.cure for unusual in found)


def test_travel_is_that_of_the_linkage() -> None:
    joint = parse_machine(yaml.safe_dump(three())).joints[0]
    facts = travel_of(joint).facts()
    q = np.array([-0.6, 0.6])
    x = np.sqrt(1.3**2 + 0.46**2 - 2 * 1.3 * 0.46 * np.cos(q + 1.72)) - 1.1
    assert facts["motion_deg"] == pytest.approx(np.degrees(q))
    assert facts["piston_mm"] == pytest.approx(1e3 * x)
    grid = np.linspace(-0.6, 0.6, 5001) + 1.72
    lever = 1e3 * 1.3 * 0.46 * np.sin(grid) / np.sqrt(1.3**2 + 0.46**2 - 2 * 1.3 * 0.46 * np.cos(grid))
    assert facts["lever_arm_mm"] == pytest.approx([lever.min(), lever.max()], rel=1e-5)


def run(*arguments: str) -> Any:
    app = typer.Typer()
    cli_machine.register(app)
    app.command("other")(lambda: None)
    return CliRunner().invoke(app, list(arguments))


@pytest.mark.slow
def test_the_command_says_ranges_and_draws(tmp_path: Path) -> None:
    checked(tmp_path, three(rate_hz=1.0))
    picture = tmp_path / "pictures" / "one.svg"
    picture.parent.mkdir()
    done = run("machine", "check", str(tmp_path / "arm.yaml"), "--draw", str(picture))
    assert done.exit_code == 0, done.output
    assert "j0: -34.38 to 34.38 deg, piston at" in done.output and "of 900 mm, lever arm" in done.output
    assert "warning: rate_hz" in done.output and f"drawn: {picture}" in done.output
    text = "".join(ET.parse(picture).getroot().itertext())
    for words in ("j0: piston (three_pin)", "j2: lever arm", "x [mm]", "r = dx/dq [mm/rad]", "q [deg]"):
        assert words in text
    done = run("machine", "check", str(tmp_path / "arm.yaml"), "--draw", str(tmp_path / "folder"), "--json")
    content = json.loads(done.output)
    assert content["valid"] and content["joints"] == 3 and content["findings"][0]["key"] == "rate_hz"
    assert sorted(Path(p).name for p in content["drawn"]) == ["j0.svg", "j1.svg", "j2.svg"]
    first = (tmp_path / "folder" / "j0.svg").read_bytes()
    run("machine", "check", str(tmp_path / "arm.yaml"), "--draw", str(tmp_path / "folder"))
    assert (tmp_path / "folder" / "j0.svg").read_bytes() == first


def test_the_command_prints_findings_as_json_on_failure_too(tmp_path: Path) -> None:
    checked(tmp_path, three(joints__0__cylinder__bore=-1.0, gravity=[0, 0, -1.0]))
    done = run("machine", "check", str(tmp_path / "arm.yaml"), "--json")
    assert done.exit_code == 2
    content = json.loads(done.stdout)
    assert content["valid"] is False
    assert [f["level"] for f in content["findings"]] == ["error", "warning"]
    assert {"level", "line", "key", "text", "cure"} == set(content["findings"][0])
    done = run("machine", "check", str(tmp_path / "arm.yaml"))
    assert done.exit_code == 2 and "hilfit: " in done.stderr and "warning: gravity" in done.stdout


def test_a_picture_of_no_linkage_or_another_kind_is_refused(tmp_path: Path) -> None:
    checked(tmp_path, three())
    done = run("machine", "check", str(tmp_path / "arm.yaml"), "--draw", str(tmp_path / "x.png"))
    assert done.exit_code == 2 and "end the name with .svg" in done.stderr
    content = three()
    for joint in content["joints"]:
        joint["cylinder"] = None
    content["channels"] = [
        {"name": f"{name}.{q}", "quantity": q, "joint": name, "unit": unit}
        for name in ("j0", "j1", "j2")
        for q, unit in (("joint_position", "rad"), ("joint_effort", "N m"))
    ]
    checked(tmp_path, content)
    done = run("machine", "check", str(tmp_path / "arm.yaml"), "--draw", str(tmp_path / "x.svg"))
    assert done.exit_code == 2 and "no joint has a cylinder" in done.stderr


JUNK = st.sampled_from([None, -1, "x", [], {}, [1], True, 1e30])


def leaves(content: Any, way: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Places of everything in a tree of YAML content."""
    items = content.items() if isinstance(content, dict) else enumerate(content) if isinstance(content, list) else ()
    return [place for key, value in items for place in [(*way, key), *leaves(value, (*way, key))]]


@pytest.mark.slow
@given(st.lists(st.tuples(st.integers(0, 10_000), JUNK), max_size=4))
@settings(max_examples=25, deadline=None)
def test_whatever_is_written_is_answered(tmp_path_factory: pytest.TempPathFactory, changes: list[Any]) -> None:
    content = three()
    for number, value in changes:
        places = leaves(content)
        *way, last = places[number % len(places)]
        node: Any = content
        for part in way:
            node = node[part]
        node[last] = value
    result = checked(tmp_path_factory.getbasetemp(), content)
    assert (result.machine is None) == bool(result.errors)
    assert all(finding.under("arm.yaml").count("\n") == 0 for finding in result.findings)
