"""Reports of joints without cylinders speak of joints: rad and N m (or m and N), and of no part that is not there."""

from __future__ import annotations

import html
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from synthetic_arm import make_motion, make_recordings, planar_machine, truth

from daq.machine.linkages import Rack
from daq.machine.machine_file import Machine, machine_to_yaml
from daq.recordings.recording import write_recording
from fitting.effects import effect, effects
from fitting.loop.session import Options, Request
from fitting.pipeline.results.summary import print_summary
from fitting.pipeline.stages import identify
from fitting.report.joint_words import in_own_units, in_words_of, joint_words, machine_words, own_unit
from fitting.report.languages import NAMES

#: Parts that a joint without a cylinder does not have.
PARTS = re.compile(
    r"(?<![A-Za-z])(piston|cylinder|rod|chamber|hydraulic|oil|stroke|pressure sensor)s?(?![A-Za-z])", re.I
)
#: What slides out of a cylinder and wears: a joint that a rack turns has none of it.
NO_ROD = re.compile(r"\b(rods?|cylinder|piston)\b")
RECORDED = (("train", 2), ("train", 4), ("repeat", 2), ("validate", 3))
MIXED = planar_machine(kinds="Rrp")


def _slewing() -> Machine:
    """Two joints, the first turned by a rack."""
    machine = planar_machine(2)
    first = machine.joints[0]
    assert first.cylinder is not None
    rack = Rack(type="rack", radius=0.1, zero=0.0)
    slewing = first.model_copy(update={"cylinder": first.cylinder.model_copy(update={"linkage": rack})})
    return machine.model_copy(update={"joints": [slewing, *machine.joints[1:]]})


SLEWING = _slewing()


def texts(content: Any) -> list[str]:
    """Every text of a JSON content; keys are the contract's."""
    if isinstance(content, dict):
        return [text for key, value in content.items() if key not in ("file", "software") for text in texts(value)]
    if isinstance(content, list):
        return [text for value in content for text in texts(value)]
    return [content] if isinstance(content, str) else []


def units(content: Any) -> set[str]:
    if isinstance(content, dict):
        own = {str(content["unit"])} if "unit" in content else set()
        return own.union(*(units(value) for value in content.values()))
    return set().union(*(units(value) for value in content)) if isinstance(content, list) else set()


def spoken(page: str) -> str:
    """What a page says: no styles, no tags."""
    text = re.sub(r"<(style|script)>.*?</\1>", " ", page, flags=re.DOTALL)
    labels = " ".join(re.findall(r'(?:aria-label|title)="([^"]*)"', text))
    return html.unescape(re.sub(r"<[^>]*>", " ", text)) + " " + labels


def friction(machine: Machine, at: int, size: float) -> list[np.ndarray]:
    """Friction of one joint that grows with its position, for each of the recordings."""
    added = []
    for role, seed in RECORDED:
        motion = make_motion(machine, role, seed, 30.0, None)
        effort = np.zeros_like(motion.v)
        effort[:, at] = size * (motion.x[:, at] - motion.x[:, at].mean()) * np.tanh(motion.v[:, at] / 1e-3)
        added.append(effort)
    return added


def report_of(machine: Machine, directory: Path, added: list[np.ndarray], **options: Any) -> tuple[dict[str, Any], str]:
    (directory / "machine.yaml").write_text(machine_to_yaml(machine), encoding="utf-8")
    recordings = []
    made = make_recordings(machine, truth(len(machine.joints)), RECORDED, added=added, seconds=30.0)
    for number, recording in enumerate(made):
        path = directory / f"{recording.role}-{number}.parquet"
        write_recording(path, machine, recording.role, recording.time, recording.values)
        recordings.append((recording.role, path))
    output = directory / "out"
    content = identify(Request(directory / "machine.yaml", tuple(recordings), output, Options(**options)))
    return content, (output / "report.html").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], str]:
    machine = planar_machine(kinds="rr")
    return report_of(machine, tmp_path_factory.mktemp("robot"), friction(machine, 0, 60.0), bootstrap=0)


@pytest.mark.slow
def test_a_robots_report_speaks_of_joints(
    robot: tuple[dict[str, Any], str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    report, page = robot
    assert report["loop"]["effects"] or report["loop"]["unexplained"]  # there is something to speak of
    assert len(report["loop"]["candidates"]) > 10 and report["loop"]["detection_limits"]
    assert [text for text in texts(report) if PARTS.search(text.replace("_", " "))] == []
    assert PARTS.findall(spoken(page)) == []
    print_summary(report, tmp_path)
    assert PARTS.findall(capsys.readouterr().out) == []
    assert "joint position" in spoken(page)


@pytest.mark.slow
def test_a_robots_report_has_radians_and_newton_metres(robot: tuple[dict[str, Any], str]) -> None:
    report, _ = robot
    found = units(report)
    assert "N m" in found and "N m s/rad" in found
    assert {unit for unit in found if re.search(r"\bm\b", unit.replace("N m", "")) and "kg" not in unit} == set()
    assert {unit for unit in found if re.search(r"\bN\b(?! m)", unit)} == set()
    for entry in report["figures"]["scatter"]:
        assert entry["effort_unit"] == "N m" and entry["unit"] in ("rad", "rad/s", "rad/s^2", "N m", "N m/s", "s")


@pytest.mark.parametrize("name", [one.id for one in effects()])
def test_an_effect_speaks_of_no_part_that_its_joint_lacks(name: str) -> None:
    entry, robot = effect(name), planar_machine(kinds="rr")
    asked = [(SLEWING, "slew", NO_ROD, "look_at")]
    if entry.applies(robot, 0):
        asked += [(robot, "motor", PARTS, key) for key in ("title", "experiment", "variable", "look_at")]
    found = []
    for machine, drive, parts, key in asked:
        said = in_words_of(machine, {"joint": "joint1", key: getattr(entry, key)})[key]
        found += [f"{key} at a {drive}: {said}"] if parts.search(said.replace("_", " ")) else []
    assert not found, (
        "word these without the part, or add them to drives.motor.texts or drives.slew.texts of "
        f"fitting/report/languages/english.json, or set needs_cylinder where no other joint has the effect: {found}"
    )


def test_causes_of_impossible_parameters_have_words_without_oil() -> None:
    machine = planar_machine(kinds="rr")
    causes = [cause for kind, cause in NAMES["causes"].items() if kind not in ("m", "K")]  # a piston's own
    said = in_words_of(machine, {"violations": [{"joint": "joint1", "cause": causes}]})
    assert not PARTS.search(" ".join(said["violations"][0]["cause"])) and len(causes) > 1


def test_words_belong_to_the_joint_that_a_text_is_about() -> None:
    content = {
        "warnings": ["joint1: a small structure in piston_position is left", "joint2: in piston_speed", "all is well"],
        "unexplained": [{"joint": "joint1", "variable": "joint2.piston_speed"}],
        "effects": [{"joint": "joint2", "title": "friction that depends on the piston position"}],
        "own": [{"joint": "joint1", "title": "friction that depends on the piston position"}],
        "files": ["runs/piston_position.csv"],
    }
    said = in_words_of(MIXED, content)
    assert said["warnings"] == [content["warnings"][0], "joint2: in joint_speed", "all is well"]
    assert said["unexplained"][0]["variable"] == "joint2.joint_speed"
    assert said["effects"][0]["title"] == "friction that depends on the joint position"
    assert said["own"] == content["own"] and said["files"] == content["files"]


def test_machines_of_cylinders_are_left_as_they_are() -> None:
    machine = planar_machine(2)
    content = {"joint": "joint1", "title": "piston_position", "unit": "m"}
    assert in_words_of(machine, content) is content
    assert machine_words(machine) == joint_words(machine.joints[0]) and own_unit(machine, 0, "N/m") == "N/m"


def test_a_joint_that_a_rack_turns_has_a_slew_motor_and_no_rod() -> None:
    content = {"joint": "joint1", "look_at": effect("position_dependent_friction").look_at}
    assert in_words_of(SLEWING, content)["look_at"].startswith("slew motor, gear and slewing ring")
    assert in_words_of(SLEWING, content | {"joint": "joint2"})["look_at"] == content["look_at"]


@pytest.mark.parametrize(
    ("unit", "turning"),
    [
        ("m", "rad"),
        ("m/s", "rad/s"),
        ("m/s^2", "rad/s^2"),
        ("N", "N m"),
        ("N/s", "N m/s"),
        ("N/m", "N m/rad"),
        ("N/m^5", "N m/rad^5"),
        ("N/m^n", "N m/rad^n"),
        ("N/rad", "N m/rad"),
        ("N s/m", "N m s/rad"),
        ("N s^2/m^2", "N m s^2/rad^2"),
        ("N s^3/m^3", "N m s^3/rad^3"),
        ("N (s/m)^n", "N m (s/rad)^n"),
        *((unit, unit) for unit in ("1", "s", "Pa", "kg", "m^3/s", "rad", "N m", "kg m^2", "N m/rad^3", "rad/(N m)")),
    ],
)
def test_a_unit_of_a_piston_is_one_of_a_joint_that_turns(unit: str, turning: str) -> None:
    assert own_unit(MIXED, 1, unit) == turning


@pytest.mark.parametrize(
    ("unit", "sliding"),
    [
        ("rad", "m"),
        ("rad/s", "m/s"),
        ("N m", "N"),
        ("N m/rad", "N/m"),
        ("N m/rad^5", "N/m^5"),
        ("N m s/rad", "N s/m"),
        ("kg m^2", "kg"),
        ("rad/(N m)", "m/N"),
        *((unit, unit) for unit in ("1", "s", "Pa", "kg", "m^3/s", "m", "m/s^2", "N s^2/m^2", "N (s/m)^n")),
    ],
)
def test_a_unit_of_a_joint_that_turns_is_one_of_a_joint_that_slides(unit: str, sliding: str) -> None:
    assert own_unit(MIXED, 2, unit) == sliding


def test_units_are_those_of_the_joint() -> None:
    piston, turning, sliding = range(3)
    assert [own_unit(MIXED, joint, "N s/m") for joint in (piston, turning, sliding)] == ["N s/m", "N m s/rad", "N s/m"]
    assert [own_unit(MIXED, joint, "N m/rad") for joint in (piston, turning, sliding)] == ["N m/rad", "N m/rad", "N/m"]
    law = {"joint": "joint1", "variable": "joint2.piston_speed", "unit": "m/s", "law": {"grid": []}}
    assert in_own_units(MIXED, law) | {"law": 0} == law | {"unit": "rad/s", "effort_unit": "N", "law": 0}
    own = {"joint": "joint2", "variable": "piston_position", "unit": "m"}
    second = {"second": {"signal": "piston_speed", "other": 2, "unit": "m/s"}}
    said = in_own_units(MIXED, own | {"law": second})
    assert (said["unit"], said["effort_unit"], said["law"]["second"]["unit"]) == ("rad", "N m", "m/s")


@pytest.mark.slow
def test_a_report_of_a_law_speaks_of_joints(tmp_path: Path) -> None:
    """What no effect explains becomes a law of a variable: of the joint's own, in the joint's words."""
    machine = planar_machine(kinds="rr")
    added = []
    for role, seed in RECORDED:
        motion = make_motion(machine, role, seed, 30.0, None)
        effort = np.zeros_like(motion.v)
        effort[:, 0] = 30.0 * np.exp(-(((motion.x[:, 0] - 0.1) / 0.06) ** 2))
        added.append(effort)
    report, page = report_of(machine, tmp_path, added, bootstrap=0)
    laws = report["loop"]["unexplained"]
    assert {(law["joint"], law["variable"], law["unit"], law["effort_unit"]) for law in laws} == {
        ("joint1", "joint_position", "rad", "N m")
    }
    assert [text for text in texts(report) if PARTS.search(text.replace("_", " "))] == []
    assert PARTS.findall(spoken(page)) == [] and json.dumps(report)
