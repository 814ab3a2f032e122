"""Exported models against the model itself, on motions and states that no table of theirs holds."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np
import pytest
from model_examples import applies, law_of, model_of, model_with, session_of, term_of
from synthetic_arm import make_motion

from daq.errors import InputError
from fitting.effects import effects
from fitting.model import motion
from fitting.model.arm_model import ArmModel
from fitting.model.codec import save_model
from fitting.model.export import export_model, format_names, formats
from fitting.model.export.functions import identifier
from fitting.model.export.tracing.tracing import tracer_of
from fitting.residual.surfaces import Surface
from fitting.residual.terms import Term
from server.commands.command_line import main

CONTRIBUTING = Path(__file__).parents[2] / "CONTRIBUTING.md"
#: Effects of one moment whose formula asks for numbers, so that no expression can be made of it.
UNTRACED = {"linkage_geometry"}
COMPILER = shutil.which("cc")
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="there is no C compiler")


@pytest.fixture(scope="module")
def model() -> ArmModel:
    """Two joints with effects of every kind that an export carries, and one that it does not."""
    session = session_of(2)
    names = ("stribeck", "pressure_dependent_friction", "counterbalance_valve", "base_tilt", "velocity_root_friction")
    terms = [term_of(session, name, number % 2) for number, name in enumerate(names)]
    laws = [law_of(session, "piston_position", 1, signed=True), law_of(session, "cylinder_force", 0, signed=True)]
    return model_with([*terms, *laws, term_of(session, "pressure_gain", 1)], session)


def held_out(model: ArmModel) -> tuple[np.ndarray, ...]:
    moved = make_motion(model.machine, "validate", 77, 6.0)
    moved.qd[:5] = 0.0  # a moment at rest as well
    return moved.q, moved.qd, moved.qdd, moved.t + 3.0


def assert_same(found: np.ndarray, expected: np.ndarray, share: float = 1e-9) -> None:
    assert np.max(np.abs(found - expected)) <= share * np.max(np.abs(expected))


def python_answers(path: Path) -> dict[str, Any]:
    names: dict[str, Any] = {}
    exec(path.read_text(encoding="utf-8"), names)
    return names


@pytest.mark.slow
@pytest.mark.parametrize("name", [e.id for e in effects() if not e.over_time and e.level != "measurement"])
def test_every_effect_of_one_moment_is_carried(name: str, tmp_path: Path) -> None:
    session = session_of(2)
    joint = applies(next(e for e in effects() if e.id == name), session.machine)
    assert joint is not None
    # The last shape of a valve is one that lowers the other way: these loads never pull that way.
    term = term_of(session, name, joint, choice=0 if name == "counterbalance_valve" else -1)
    if name == "payload":
        term.shape["recording"] = -1.0  # type: ignore[index]
    model = model_with([term], session)
    done = export_model(model, "python", tmp_path / "arm.py")
    expected = {name} & UNTRACED
    assert bool(done.left_out) == bool(expected)
    q, qd, qdd, t = held_out(model)
    found = python_answers(tmp_path / "arm.py")["inverse_dynamics"](q, qd, qdd, t)
    assert_same(found, motion.on_motion(tracer_of(model).carried, q, qd, qdd, t).joint_effort(0))
    without = motion.on_motion(tracer_of(model_with((), session)).carried, q, qd, qdd, t).joint_effort(0)
    # What was carried is in the numbers, a thousand times the tolerance or more.
    assert expected or np.max(np.abs(found - without)) > 1e-6 * np.max(np.abs(found))


@pytest.mark.slow
@pytest.mark.parametrize("kinds", ["RPR", "rR", "RRRR"])
def test_prismatic_and_direct_joints_and_twists(kinds: str, tmp_path: Path) -> None:
    session = session_of(len(kinds), kinds)
    model = model_with((), session)
    export_model(model, "python", tmp_path / "arm.py")
    q, qd, qdd, t = held_out(model)
    found = python_answers(tmp_path / "arm.py")
    assert_same(found["inverse_dynamics"](q, qd, qdd, t), motion.on_motion(model, q, qd, qdd, t).joint_effort(0))
    assert_same(found["gravity"](q), motion.gravity(model, q))


@pytest.mark.slow
@pytest.mark.parametrize("twist", [False, True])
def test_laws_of_two_signals_are_carried(twist: bool, tmp_path: Path) -> None:
    session = session_of(2)
    ranges = (0.05, 0.25), (-0.1, 0.1)  # narrower than the motion: constant beyond
    law = Surface("piston_position", None, not twist, False, ranges[0], "", "piston_speed", 1, ranges[1], twist)
    model = model_with([Term(law, 0)], session)
    done = export_model(model, "python", tmp_path / "arm.py")
    assert not done.left_out
    q, qd, qdd, t = held_out(model)
    found = python_answers(tmp_path / "arm.py")["inverse_dynamics"](q, qd, qdd, t)
    assert_same(found, motion.on_motion(model, q, qd, qdd, t).joint_effort(0))
    without = motion.on_motion(model_with((), session), q, qd, qdd, t).joint_effort(0)
    assert np.max(np.abs(found - without)) > 1e-6 * np.max(np.abs(found))


def test_a_modified_table_is_traced_as_a_distal_one(tmp_path: Path) -> None:
    """Twisted axes and a slide in Craig's convention, against the regressor."""
    session = session_of(3, "RPR")
    machine = session.machine
    joints = [
        joint.model_copy(update={"dh": joint.dh.model_copy(update={"alpha": alpha, "d": 0.2, "theta": 0.3})})
        for joint, alpha in zip(machine.joints, (0.4, -1.2, 0.9), strict=True)
    ]
    modified = machine.model_copy(update={"convention": "modified", "joints": tuple(joints)})
    model = model_of(modified, session)
    export_model(model, "python", tmp_path / "arm.py")
    q, qd, qdd, t = held_out(model)
    found = python_answers(tmp_path / "arm.py")["inverse_dynamics"](q, qd, qdd, t)
    assert_same(found, motion.on_motion(model, q, qd, qdd, t).joint_effort(0))


@pytest.mark.slow
def test_what_is_left_out_and_where_it_comes_from_stand_in_the_file(model: ArmModel, tmp_path: Path) -> None:
    done = export_model(model, "python", tmp_path / "arm.py")
    assert len(done.left_out) == 1 and "belongs to the sensors" in done.left_out[0]
    text = (tmp_path / "arm.py").read_text(encoding="utf-8")
    assert done.left_out[0] in text and "validate-3" in text
    assert {line.split()[1] for line in text.splitlines() if line.startswith(("import", "from"))} == {"numpy"}


@pytest.mark.slow
@needs_compiler
def test_the_self_test_fails_where_the_code_is_wrong(model: ArmModel, tmp_path: Path) -> None:
    export_model(model, "c", tmp_path)
    name = identifier(model.machine.name)
    source = tmp_path / f"{name}.c"
    text = source.read_text(encoding="utf-8")
    assert "    tau[0] = " in text
    source.write_text(text.replace("    tau[0] = ", "    tau[0] = 1.0001 * "), encoding="utf-8")
    assert COMPILER is not None
    subprocess.run([COMPILER, "-o", "selftest", source.name, f"{name}_selftest.c", "-lm"], cwd=tmp_path, check=True)
    assert subprocess.run([tmp_path / "selftest"], capture_output=True, timeout=30).returncode == 1


@pytest.mark.parametrize(
    ("name", "word"), [("Folding arm 2", "folding_arm_2"), ("7-axis", "arm_7_axis"), ("int", "arm_int")]
)
def test_names_are_those_of_the_language(name: str, word: str) -> None:
    assert identifier(name) == word


def test_a_folder_that_is_a_file_is_refused(model: ArmModel, tmp_path: Path) -> None:
    (tmp_path / "x").write_text("", encoding="utf-8")
    with pytest.raises(InputError, match="is a file"):
        export_model(model, "c", tmp_path / "x")


def test_every_format_is_listed_in_the_help() -> None:
    from fitting.model.cli import export

    (option,) = get_type_hints(export, include_extras=True)["to"].__metadata__
    modules = {path.stem for path in Path(formats.__file__).parent.glob("[!_]*.py")}
    assert set(option.help.removeprefix("Format: ").removesuffix(".").split(", ")) == modules >= {"c", "csv", "urdf"}


def test_every_format_has_a_line_in_the_documentation() -> None:
    text = (CONTRIBUTING.parent / "docs" / "model.md").read_text(encoding="utf-8")
    _, _, table = text.partition("| format | is | carries |")
    described = re.findall(r"^\| `(\w+)` \|", table.partition("\n\n")[0], re.MULTILINE)
    assert sorted(described) == format_names(), "a line for each in the table of docs/model.md, and no other"


def test_a_format_of_its_own_is_one_module(
    model: ArmModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Added as CONTRIBUTING says, and nothing else touched: the command line offers it and writes it."""
    text = """from fitting.model.export.functions import program_of, written

def write(model, path, possible=False):
    program = program_of(model)
    asked = ", ".join(own.name for own in program.functions)
    return written(path.parent, {path.name: asked}, program.tracer.left_out)
"""
    (tmp_path / "formats").mkdir()
    (tmp_path / "formats" / "names.py").write_text(text, encoding="utf-8")
    monkeypatch.setattr(formats, "__path__", [*formats.__path__, str(tmp_path / "formats")])
    save_model(tmp_path / "model.json", model)
    with pytest.raises(SystemExit) as ended:
        main(["model", "export", str(tmp_path / "model.json"), "--to", "names", "-o", str(tmp_path / "names.txt")])
    assert not ended.value.code, capsys.readouterr().err
    assert "inverse_dynamics, drive_efforts" in (tmp_path / "names.txt").read_text(encoding="utf-8")
    with pytest.raises(InputError, match=f"there is no format 'name'; use one of {', '.join(format_names())}"):
        export_model(model, "name", tmp_path / "x")


def test_contributing_names_every_file_of_a_format() -> None:
    (row,) = (line for line in CONTRIBUTING.read_text(encoding="utf-8").splitlines() if line.startswith("| an export"))
    named = [word for word in re.findall(r"`([^` ]+)`", row) if "/" in word]
    assert named[0] == "fitting/model/export/formats/my_format.py"
    there = [word for word in named[1:] if (CONTRIBUTING.parent / word).exists()]
    assert there == named[1:] and "benchmarks/exports/conformance.py" in there
    own = CONTRIBUTING.parent / "fitting" / "model" / "export"
    names = "|".join(re.escape(name) for name in format_names())
    texts = [path.read_text(encoding="utf-8") for path in (own / "__init__.py", own.parent / "cli.py")]
    assert not [text for text in texts if re.search(f'"({names})"', text)]  # no second list of formats
