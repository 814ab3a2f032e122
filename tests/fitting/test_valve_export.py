"""The exported inverse says what the model says: compiled, imported, and as a table."""

from __future__ import annotations

import csv
import importlib.util
import io
import math
import re
import shutil
import subprocess
import zipfile
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from daq import InputError
from fitting.valve.export import SAFETY, export_valve, formats, self_test_rows
from fitting.valve.inverse import CLIPPED, GIVEN, NO_NUMBER, NO_PRESSURE, Direction, ValveModel

PIECES = {"openings": (0.0, 0.1, 0.3, 0.6, 0.7), "speeds": (0.0, 0.05, 0.09, 0.16, 0.16)}
KINDS: dict[str, dict[str, Any]] = {
    "line": {},
    "power": {"power": 1.4},
    "pieces": PIECES,
    "meter_in": {"law": "meter_in"},
    "meter_out": {"law": "meter_out", "power": 0.8},
    "compensated": {"law": "compensated", "law_shape": {"margin": 8e5, "order": 4.0}},
    "free_exponent": {"law": "free_exponent", "law_shape": {"exponent": 0.37}, **PIECES},
}


def model(joint: str = "boom", **change: Any) -> ValveModel:
    """A valve in milliamperes that extends with less current."""

    def direction(edge: float, gain: float) -> Direction:
        own: dict[str, Any] = {
            "edge": edge, "gain": gain, "power": 1.0, "openings": (), "speeds": (), "law": "none", "law_shape": {},
            "drop_in": 1e7, "drop_out": 2e6, "largest": 0.8,
        }  # fmt: skip
        return Direction(**own | change)

    return ValveModel(
        joint=joint, unit="mA", neutral=12.0, full=8.0, extends=-1, least=4.0, most=20.0, delay=0.1,
        directions=(direction(0.06, 0.3), direction(0.12, 0.25)), areas=(5e-3, 3.4e-3), pump_limit=1e-3,
        left_out=("a leak past the piston",), error=0.012,
    )  # fmt: skip


def imported(file: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(file.stem, file)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("kind", KINDS)
def test_the_python_file_says_what_the_model_says(tmp_path: Path, kind: str) -> None:
    own = model(**KINDS[kind])
    export_valve(own, "python", tmp_path)
    command = imported(tmp_path / "valve_boom.py").command
    flags = set()
    for speed, head, rod, supply, tank, moving, expected, flag in self_test_rows(own):
        found = command(speed, head, rod, supply, tank, bool(moving))
        assert found[0] == pytest.approx(expected, abs=1e-9 * own.full) and found[1] == flag
        assert found[2] == (expected != own.neutral)
        flags.add(int(flag))
    assert NO_NUMBER in flags and any(flag & CLIPPED for flag in flags)
    assert any(flag & NO_PRESSURE for flag in flags) == (own.directions[0].law != "none")


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
@pytest.mark.parametrize("kind", KINDS)
def test_the_c_source_compiles_without_a_warning_and_passes_its_own_test(tmp_path: Path, kind: str) -> None:
    written = export_valve(model(**KINDS[kind]), "c", tmp_path)
    assert written.left_out == ("a leak past the piston",)
    flags = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Wpedantic", "-Werror"]
    sources = ["valve_boom.c", "valve_boom_selftest.c"]
    subprocess.run(["cc", *flags, *sources, "-lm", "-o", "test"], cwd=tmp_path, check=True, timeout=60)
    said = subprocess.run(["./test"], cwd=tmp_path, capture_output=True, text=True, check=False, timeout=60)
    assert said.returncode == 0, said.stdout
    source = (tmp_path / "valve_boom.c").read_text("utf-8")
    assert not re.search(r"\b(malloc|calloc|realloc|free)\b", source)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_the_self_test_fails_where_the_code_says_otherwise(tmp_path: Path) -> None:
    export_valve(model(), "c", tmp_path)
    source = tmp_path / "valve_boom.c"
    text = source.read_text("utf-8")
    assert "0.06" in text
    source.write_text(text.replace("0.06", "0.061"), encoding="utf-8")
    subprocess.run(
        ["cc", "-std=c99", "valve_boom.c", "valve_boom_selftest.c", "-lm", "-o", "test"], cwd=tmp_path, check=True
    )
    assert subprocess.run(["./test"], cwd=tmp_path, check=False, capture_output=True).returncode == 1


def moment_of(unit: Path, kind: str) -> Callable[[list[float]], tuple[float, float]]:
    """What a simulator does with a unit: inputs at a communication point, or accepted step, and the outputs of it."""
    from fmpy import extract, fmi2, fmi3, read_model_description

    about = read_model_description(str(unit))
    places = {own.name: own.valueReference for own in about.modelVariables}
    classes = {
        ("2.0", "CoSimulation"): fmi2.FMU2Slave,
        ("2.0", "ModelExchange"): fmi2.FMU2Model,
        ("3.0", "CoSimulation"): fmi3.FMU3Slave,
        ("3.0", "ModelExchange"): fmi3.FMU3Model,
    }
    made = classes[about.fmiVersion, kind](
        guid=about.guid,
        modelIdentifier="valve_boom",
        unzipDirectory=extract(str(unit), str(unit.with_suffix(f".{kind}"))),
        instanceName="own",
    )
    made.instantiate()
    if about.fmiVersion == "2.0":
        made.setupExperiment(startTime=0.0)
        made.enterInitializationMode()
        put, get = made.setReal, made.getReal
    else:
        made.enterInitializationMode(startTime=0.0)
        put, get = made.setFloat64, made.getFloat64
    made.exitInitializationMode()
    now = 0.0

    def moment(row: list[float]) -> tuple[float, float]:
        nonlocal now
        put([places[name] for name in GIVEN[:5]], row)
        if kind == "CoSimulation":
            made.doStep(now, 0.02)
            now += 0.02
        else:
            now += 0.02
            made.setTime(now)
        command, flags = get([places["command"], places["flags"]])
        if kind == "ModelExchange":
            assert tuple(get([places["command"], places["flags"]])) == (command, flags), "asked again, the same"
            made.completedIntegratorStep()
        return command, flags

    return moment


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
@pytest.mark.skipif(find_spec("fmpy") is None, reason="fmpy is not installed (pip install fmpy)")
@pytest.mark.parametrize("kind", KINDS)
def test_the_units_are_valid_and_say_what_the_model_says(tmp_path: Path, kind: str) -> None:
    """Both versions, both interfaces: commands, flags, numbers that are none, hysteresis from step to step."""
    from fmpy.validation import validate_fmu

    own = model(**KINDS[kind])
    rows = self_test_rows(own, chained=True)
    low = 0.005 * own.directions[0].fastest
    for speed in (2.0 * low, 4.0 * low, 2.0 * low, 0.5 * low, 2.0 * low, math.nan, 2.0 * low):
        moving = rows[-1][6] != own.neutral
        found = own.command(speed, moving=moving)
        rows.append((speed, math.nan, math.nan, math.nan, 0.0, float(moving), found.command, float(found.flags)))
    went = [row[6] != own.neutral for row in rows[-7:]]
    assert went[1:] == [True, True, False, False, False, False]
    for unit in export_valve(own, "fmu", tmp_path).files:
        assert validate_fmu(str(unit)) == []
        for interface in ("CoSimulation", "ModelExchange"):
            moment = moment_of(unit, interface)
            for *given, _, command, flags in rows:
                assert moment(given) == (pytest.approx(command, abs=1e-9 * own.full), flags)
        with zipfile.ZipFile(unit) as archive:
            table = list(csv.reader(io.StringIO(archive.read("resources/valve_boom_selftest.csv").decode())))
        assert table[0] == [*GIVEN[:5], "moving before", "command", "flags"]
        assert np.array_equal(np.array(table[1:], dtype=float), rows[:-7], equal_nan=True)


def test_an_axis_at_rest_starts_later_than_it_stops(tmp_path: Path) -> None:
    own = model()
    export_valve(own, "python", tmp_path)
    command = imported(tmp_path / "valve_boom.py").command
    slow = 2.0 * 0.005 * own.directions[0].fastest
    assert command(slow, moving=False)[2] is False and command(slow, moving=True)[2] is True
    assert command(math.nan)[0] == 12.0


def test_the_table_holds_the_commands(tmp_path: Path) -> None:
    own = model(law="meter_in")
    export_valve(own, "csv", tmp_path)
    lines = [line for line in (tmp_path / "valve_boom.csv").read_text("utf-8").splitlines() if line[0] != "#"]
    rows = list(csv.reader(lines))[1:]
    assert {row[0] for row in rows} == {"extend", "retract"}
    for way, speed, drop, command, _ in rows[5::17]:
        direction = own.directions[0 if way == "extend" else 1]
        share = direction.edge + abs(float(speed)) / (direction.gain * np.sqrt(float(drop) / 1e7))
        if share < direction.largest and float(speed):
            assert float(command) == pytest.approx(12.0 - np.sign(float(speed)) * 8.0 * share, rel=1e-9)


@pytest.mark.parametrize("kind", ["pieces", "meter_in"])
def test_structured_text_names_what_it_calls_and_declares_what_it_sets(tmp_path: Path, kind: str) -> None:
    export_valve(model(**KINDS[kind]), "st", tmp_path)
    text = (tmp_path / "valve_boom.st").read_text("utf-8")
    body = text[text.index("FUNCTION_BLOCK") :]
    declared = set(re.findall(r"\b(\w+)(?=[\w, ]* : (?:LREAL|BOOL|INT))", body))
    assert set(re.findall(r"^ +(\w+) :=", body, re.M)) <= declared
    called = set(re.findall(r"\b([A-Za-z_]\w*)\(", body))
    assert called <= {
        "MAX",
        "MIN",
        "ABS",
        "SQRT",
        "SEL",
        "EXPT",
        "LREAL_TO_INT",
        "valve_boom_curve_0",
        "valve_boom_curve_1",
    }
    assert body.count("IF ") + body.count("ELSIF ") >= body.count("END_IF")


@pytest.mark.parametrize("to", sorted(formats()))
def test_every_file_says_what_the_controller_owes_the_machine(tmp_path: Path, to: str) -> None:
    file = export_valve(model(), to, tmp_path).files[0]
    if to == "fmu":
        with zipfile.ZipFile(file) as archive:
            text = archive.read("modelDescription.xml").decode()
    else:
        text = file.read_text("utf-8")
    assert all(line in text for line in SAFETY)
    assert "watchdog" in text and "25 %" in text and "Not in this file: a leak past the piston." in text


def test_what_cannot_be_exported_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"^--to basic: there is no such format; use one of c, csv, fmu, python, st$"):
        export_valve(model(), "basic", tmp_path)
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(InputError, match=r"file: is a file; give a folder"):
        export_valve(model(), "c", tmp_path / "file")
    with pytest.raises(InputError, match=r"^boom: its valve was never seen to move it"):
        export_valve(model(gain=0.0), "c", tmp_path)


def test_a_joints_name_is_made_one_of_the_language(tmp_path: Path) -> None:
    names = [file.name for file in export_valve(model(joint="arm-2.boom"), "c", tmp_path).files]
    assert names == ["valve_arm_2_boom.h", "valve_arm_2_boom.c", "valve_arm_2_boom_selftest.c"]
