"""MATLAB, FMU and tables against the model; Octave, fmpy and scipy's interpolation are the judges."""

from __future__ import annotations

import csv
import shutil
import subprocess
import zipfile
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from model_examples import model_of, model_with, session_of, term_of
from scipy.interpolate import RegularGridInterpolator
from test_exports import model, needs_compiler

from daq.errors import InputError
from fitting.model import motion
from fitting.model.arm_model import ArmModel
from fitting.model.export import export_model
from fitting.model.export.formats.fmu import binary_place

__all__ = ["model"]

needs_fmpy = pytest.mark.skipif(find_spec("fmpy") is None, reason="fmpy is not installed (pip install fmpy)")


def test_a_function_file_is_named_after_its_function(model: ArmModel, tmp_path: Path) -> None:
    for name in ("arm.txt", "2 joints.m"):
        with pytest.raises(InputError, match="name the file after its function"):
            export_model(model, "matlab", tmp_path / name)
    assert not list(tmp_path.iterdir())


@pytest.fixture(scope="module")
def units(model: ArmModel, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("units")
    export_model(model, "fmu", folder)
    return folder


@pytest.mark.slow
@needs_compiler
@needs_fmpy
def test_units_are_valid(units: Path) -> None:
    from fmpy.validation import validate_fmu

    assert [validate_fmu(str(unit)) for unit in sorted(units.glob("*.fmu"))] == [[]] * 4


@pytest.mark.slow
def test_units_hold_sources_and_without_a_compiler_say_so(
    model: ArmModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shutil, "which", lambda name: None)
    done = export_model(model, "fmu", tmp_path)
    assert "no C compiler" in done.left_out[-1]
    for path, version in zip(done.files, (3, 2, 3, 2), strict=True):
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
            assert "modelDescription.xml" in names and "sources/fmi.c" in names
            assert not [name for name in names if name.startswith("binaries")]
            assert ("sources/buildDescription.xml" in names) == (version == 3)
    assert binary_place(3)[0].count("-") == 1


@pytest.mark.slow
@needs_compiler
def test_the_units_sources_compile_without_a_warning(units: Path, tmp_path: Path) -> None:
    for unit in units.glob("*.fmu"):
        folder = tmp_path / unit.stem
        with zipfile.ZipFile(unit) as archive:
            archive.extractall(folder)
        strict = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-fsyntax-only"]
        done = subprocess.run(["cc", *strict, "fmi.c"], cwd=folder / "sources", capture_output=True, text=True)
        assert done.returncode == 0, done.stderr


def tables(folder: Path) -> dict[str, dict[str, str]]:
    with (folder / "tables.csv").open(encoding="utf-8") as file:
        return {row["value"]: row for row in csv.DictReader(file)}


def interpolated(folder: Path, name: str) -> RegularGridInterpolator:
    """What a controller makes of a table: linear interpolation between its rows."""
    rows = np.loadtxt(folder / f"{name}.csv", delimiter=",", skiprows=1, ndmin=2)
    axes = [np.unique(column) for column in rows[:, :-1].T]
    return RegularGridInterpolator(axes, rows[:, -1].reshape([len(axis) for axis in axes]))


def test_tables_give_gravity_and_friction_as_well_as_they_say(tmp_path: Path) -> None:
    session = session_of(2)
    model = model_with([term_of(session, "stribeck", 1)], session)
    done = export_model(model, "csv", tmp_path)
    assert not done.left_out
    index = tables(tmp_path)
    names = [f"{what}_joint{k}" for what in ("gravity", "held", "friction") for k in (1, 2)]
    assert list(index) == names
    assert "Error on another motion: joint1" in (tmp_path / "card.txt").read_text(encoding="utf-8")
    assert index["friction_joint1"]["unit"] == "N" and index["gravity_joint1"]["unit"] == "N m"
    limits = np.array([joint.limits.position for joint in model.machine.joints])
    q = np.random.default_rng(5).uniform(*limits.T, (500, 2))
    parts = [interpolated(tmp_path, f"gravity_joint{k + 1}")(q[:, : k + 1].sum(axis=1)) for k in range(2)]
    right = motion.gravity(model, q)
    held = np.column_stack([interpolated(tmp_path, f"held_joint{k + 1}")(q[:, k]) for k in range(2)])
    right = right - held
    errors = [float(index[f"{what}_joint{k}"]["interpolation_error"]) for k in (1, 2) for what in ("gravity", "held")]
    errors = [errors[0] + errors[1], errors[2] + errors[3]]
    assert np.max(np.abs(parts[1] - right[:, 1])) <= 1.05 * errors[1]
    assert np.max(np.abs(parts[0] + parts[1] - right[:, 0])) <= 1.05 * sum(errors)
    assert 0 < sum(errors) < 0.003 * np.max(np.abs(right))
    for joint in range(2):
        table, row = interpolated(tmp_path, f"friction_joint{joint + 1}"), index[f"friction_joint{joint + 1}"]
        speed = np.random.default_rng(6).uniform(-1, 1, 500) * float(np.max(table.grid[0]))
        lever = motion.levers(model, q)[:, joint]
        qd = np.zeros_like(q)
        qd[:, joint] = speed / lever
        right = motion.friction(model, q, qd)[:, joint] / lever
        error = float(row["interpolation_error"])
        assert np.max(np.abs(table(speed) - right)) <= 1.2 * error < 0.01 * np.max(np.abs(right))


@pytest.mark.slow
def test_a_table_has_the_variables_that_the_value_has(tmp_path: Path) -> None:
    """Friction that depends on the position has a table of two; on the load of all joints, none."""
    session = session_of(2)
    model = model_with(
        [term_of(session, "position_dependent_friction", 0), term_of(session, "load_dependent_friction", 1)], session
    )
    done = export_model(model, "csv", tmp_path)
    index = tables(tmp_path)
    assert index["friction_joint1"]["variables"].count("[") == 2
    assert len(done.left_out) == 1 and "friction_joint2" in done.left_out[0]
    found = interpolated(tmp_path, "friction_joint1")
    assert float(index["friction_joint1"]["interpolation_error"]) < 0.01 * np.max(np.abs(found.values))


def test_gravity_about_twisted_axes_is_over_positions(tmp_path: Path) -> None:
    """Each axis turned against the one before: no link angle says it all."""
    session = session_of(2)
    machine = session.machine
    first, second = machine.joints
    joints = first.model_copy(update={"dh": first.dh.model_copy(update={"alpha": 0.7})}), second
    twisted = machine.model_copy(update={"joints": joints})
    model = model_of(twisted, session)
    export_model(model, "csv", tmp_path)
    with pytest.raises(InputError, match="is a file"):
        export_model(model, "csv", tmp_path / "tables.csv")
    row = tables(tmp_path)["gravity_joint2"]
    assert "joint1.position [rad]" in row["variables"] and "joint2.position [rad]" in row["variables"]
    q = np.random.default_rng(5).uniform(*np.array([j.limits.position for j in model.machine.joints]).T, (200, 2))
    right = motion.gravity(model, q)[:, 1]
    found = interpolated(tmp_path, "gravity_joint2")(q) + interpolated(tmp_path, "held_joint2")(q[:, 1])
    assert np.max(np.abs(found - right)) <= 1.2 * float(row["interpolation_error"]) < 0.01 * np.max(np.abs(right))
