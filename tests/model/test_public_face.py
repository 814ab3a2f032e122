"""``import hilfit`` and the commands of a model, from files to numbers."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from synthetic_arm import make_recordings, planar_machine, truth

import hilfit
from daq.machine.machine_file import machine_to_yaml
from daq.recordings.recording import write_recording
from server.commands.command_line import main


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A two-joint arm on disk, recorded for 20 s a motion."""
    directory = tmp_path_factory.mktemp("arm")
    machine = planar_machine(2)
    (directory / "machine.yaml").write_text(machine_to_yaml(machine), encoding="utf-8")
    for recording in make_recordings(machine, truth(2), seconds=20.0):
        path = directory / f"{recording.role}.parquet"
        write_recording(path, machine, recording.role, recording.time, recording.values)
    return directory


@pytest.fixture(scope="module")
def result(arm: Path) -> hilfit.Result:
    """Both stages, without the loop."""
    machine = hilfit.Machine.load(arm / "machine.yaml")
    assert machine.joints == ("joint1", "joint2") and machine.name == "test-arm"
    files = {role: [arm / f"{role}.parquet"] for role in ("unloaded", "train", "repeat", "validate")}
    files["train"] = [hilfit.Recording.load(arm / "train.parquet", machine)]  # type: ignore[list-item]
    return hilfit.identify(machine, **files, output=arm / "report", language="de", loop=False)


def run(arguments: list[str]) -> int:
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    return int(caught.value.code or 0)


@pytest.mark.slow
def test_the_page_is_in_the_language_and_the_report_is_not(arm: Path, result: hilfit.Result) -> None:
    assert '<html lang="de">' in (arm / "report" / "report.html").read_text(encoding="utf-8")
    assert result.report["summary"]["label"].startswith("Fitted only")
    with pytest.raises(hilfit.InputError, match="in the language 'tlh'"):
        hilfit.identify(arm / "machine.yaml", train=[arm / "train.parquet"], language="tlh")


def test_prediction_has_the_errors_of_the_report(arm: Path, result: hilfit.Result) -> None:
    found = result.model.predict(arm / "validate.parquet")
    for number, errors in enumerate(result.report["errors"].values()):
        for size, key in (("std", ""), ("rms", "_rms"), ("mean", "_mean"), ("relative", "_relative")):
            assert found.filtered[size][number] == pytest.approx(errors["after"][f"validate{key}"], rel=1e-9)
    # Some 900 samples of nearly white noise: the share inside a right 95 % band has a deviation of 1 %.
    assert np.all(np.abs(found.coverage - 0.95) < 0.04)


def test_the_model_says_where_it_comes_from(arm: Path, result: hilfit.Result) -> None:
    made = result.model.content.provenance
    assert [source.sha256 for source in made.data] == [entry["sha256"] for entry in result.report["data"]]
    assert made.software == result.report["software"] and made.verdict == "not_examined"
    assert made.calibration is None
    values = {name: value for name, (value, _, _) in result.model.parameters.items()}
    cylinder = result.report["cylinders"]["joint1"]["parameters"]
    assert values["joint1.f_c"] == cylinder["f_c"]["value"]
    assert result.model.parameters["joint1.f_c"][1:] == (cylinder["f_c"]["std"], "N")


def test_a_saved_model_gives_the_same_numbers(result: hilfit.Result, tmp_path: Path) -> None:
    again = hilfit.Model.load(result.model.save(tmp_path / "model.json"))
    rng = np.random.default_rng(1)
    q, qd, qdd = 0.4 * rng.normal(size=(3, 20, 2))
    effort, std = result.model.effort(q, qd, qdd, return_std=True)
    np.testing.assert_array_equal(again.effort(q, qd, qdd), effort)
    np.testing.assert_array_equal(again.effort(q, qd, qdd, return_std=True)[1], std)
    # Without gravity, friction, stiffness of drives and inertia nothing is left.
    still = np.zeros_like(q)
    np.testing.assert_allclose(
        again.effort(q, still, qdd) - again.effort(q, still, still),
        np.einsum("nij,nj->ni", again.inertia_matrix(q), qdd),
        rtol=1e-9,
        atol=1e-9,
    )


def test_simulation_follows_a_motion_and_says_what_it_smoothed(result: hilfit.Result) -> None:
    t = np.arange(0.0, 2.0, 0.02)
    path = np.column_stack([0.3 * np.sin(t) ** 2, -0.2 * np.sin(t) ** 2])
    found = hilfit.simulate(result.model, hilfit.tracking(result.model, t, path), path[0], seconds=1.9)
    assert np.max(np.abs(found.q - path[: len(found.q)])) < 1e-3
    assert np.all(found.friction_speed > 0) and not found.left_out
    # Its accelerations are those that the efforts make.
    again = result.model.effort(found.q, found.qd, found.qdd, found.t)
    np.testing.assert_allclose(again, found.effort, rtol=1e-6, atol=1e-6)


def test_predict_writes_residual_and_band(arm: Path, result: hilfit.Result, tmp_path: Path) -> None:
    for name in ("out.csv", "out.parquet"):
        output = tmp_path / name
        assert run(["predict", str(arm / "report"), str(arm / "validate.parquet"), "-o", str(output)]) == 0
    table = pq.read_table(tmp_path / "out.parquet").to_pydict()
    found = result.model.predict(arm / "validate.parquet")
    for number, joint in enumerate(("joint1", "joint2")):
        np.testing.assert_array_equal(table[f"{joint}.residual"], found.residual[:, number])
        centre = (np.array(table[f"{joint}.low"]) + table[f"{joint}.high"]) / 2
        np.testing.assert_allclose(centre, found.predicted[:, number], rtol=1e-9, atol=1e-9)
    with (tmp_path / "out.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(found.t) and float(rows[0]["time"]) == found.t[0]


def test_compare_finds_the_changed_parameter(
    arm: Path, result: hilfit.Result, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    content = json.loads((arm / "report" / "model.json").read_text(encoding="utf-8"))
    names = [own["name"] for own in content["parameters"]]
    content["passes"][-1]["theta"][names.index("joint2.f_c")] += 40.0
    (tmp_path / "other.json").write_text(json.dumps(content), encoding="utf-8")
    assert run(["model", "show", str(tmp_path / "other.json")]) == 2
    said = capsys.readouterr().err
    assert "sha256: the file was changed after it was written" in said and said.count("\n") == 1
    del content["sha256"]  # who changes a file on purpose says so
    (tmp_path / "other.json").write_text(json.dumps(content), encoding="utf-8")
    arguments = ["compare", str(arm / "report"), str(tmp_path / "other.json"), str(arm / "validate.parquet"), "--json"]
    assert run(arguments) == 0
    found = json.loads(capsys.readouterr().out)
    assert [shift["name"] for shift in found["shifts"]] == ["joint2.f_c"]
    assert found["overall"]["ci95_percent"][0] > 0  # 40 N of friction too much: worse beyond doubt
    first, second = (found[key]["joints"] for key in ("first", "second"))
    assert first["joint1"] == second["joint1"]
    assert second["joint2"]["rms"] > first["joint2"]["rms"]


def test_show_lists_parameters(arm: Path, result: hilfit.Result, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["model", "show", str(arm / "report")]) == 0
    printed = capsys.readouterr().out
    assert "joint2.f_v" in printed and "not_examined" in printed


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"schema": "hilfit/model/9"}, "this version reads hilfit/model/1"),
        ({"schema": "hilfit/report/1"}, "is no model"),
        ({"filter": {"bandwidth_hz": -1.0}}, "filter.bandwidth_hz"),
        ({"told": [True]}, "told: has shape (1,)"),
        ({"terms": [{"effect": "magic", "law": None, "joint": 0, "shape": {}, "rebuilt": []}]}, "'magic' is not known"),
    ],
)
def test_a_broken_model_is_refused_in_one_line(
    change: dict[str, object], words: str, arm: Path, result: hilfit.Result, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    content = json.loads((arm / "report" / "model.json").read_text(encoding="utf-8")) | change
    (tmp_path / "model.json").write_text(json.dumps(content), encoding="utf-8")
    assert run(["predict", str(tmp_path / "model.json"), str(arm / "validate.parquet")]) == 2
    said = capsys.readouterr().err
    assert words in said and "model.json" in said and said.count("\n") == 1


def test_what_is_no_model_is_refused(arm: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "model.json").write_text("{", encoding="utf-8")
    for path, words in ((tmp_path / "model.json", "is not JSON"), (tmp_path / "none.json", "no such file")):
        assert run(["model", "show", str(path)]) == 2
        assert words in capsys.readouterr().err


def test_unknown_formats_and_places_leave_nothing(
    arm: Path, result: hilfit.Result, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["model", "export", str(arm / "report"), "--to", "fortran", "-o", str(tmp_path / "x")]) == 2
    assert "use one of" in capsys.readouterr().err
    with pytest.raises(hilfit.InputError, match=r"use \.parquet or \.csv"):
        from fitting.model.prediction import write_predicted

        write_predicted(tmp_path / "x.txt", result.model.predict(arm / "validate.parquet"))
    assert not list(tmp_path.iterdir())


def arrays_of(arm: Path, role: str) -> tuple[hilfit.Machine, hilfit.Recording]:
    machine = hilfit.Machine.load(arm / "machine.yaml")
    return machine, hilfit.Recording.load(arm / f"{role}.parquet", machine)


@pytest.mark.slow
def test_arrays_and_tables_are_as_good_as_files(arm: Path, result: hilfit.Result) -> None:
    machine, loaded = arrays_of(arm, "validate")
    channel = next(own for own in machine.content.channels if own.quantity == "joint_position")
    own = dict(loaded.values)
    own[channel.name] = np.rad2deg(own[channel.name])
    made = hilfit.Recording.from_arrays(loaded.time, own, units={channel.name: "deg"})
    frame = pd.DataFrame(dict(loaded.values), index=pd.to_datetime(1.7e9 + loaded.time, unit="s"))
    table = hilfit.Recording.from_pandas(frame)
    expected = result.model.predict(arm / "validate.parquet").filtered["std"]
    for recording in (made, table, hilfit.Recording.from_pandas(frame.assign(time=loaded.time))):
        np.testing.assert_allclose(result.model.predict(recording).filtered["std"], expected, rtol=1e-6)
    train = hilfit.Recording.from_arrays(*(lambda one: (one.time, one.values))(arrays_of(arm, "train")[1]))
    again = hilfit.identify(machine, train=[train], validate=[made], loop=False)
    files = hilfit.identify(machine, train=[arm / "train.parquet"], validate=[arm / "validate.parquet"], loop=False)
    for joint, errors in files.report["errors"].items():
        assert again.report["errors"][joint]["after"] == pytest.approx(errors["after"], rel=1e-6)


def test_arrays_that_cannot_be_a_recording_are_refused_in_one_line(arm: Path, result: hilfit.Result) -> None:
    machine, loaded = arrays_of(arm, "validate")
    name = machine.content.channels[0].name
    for values, units, said in (
        ({name: np.zeros(3)}, None, f"{name}: has 3 values, time has {len(loaded.time)}"),
        ({name: np.zeros((len(loaded.time), 2))}, None, f"{name}: has 2 dimensions"),
        ({name: ["a"] * len(loaded.time)}, None, f"{name}: is not an array of numbers"),
        (dict(loaded.values), {"boom": "deg"}, "boom: has a unit and no values"),
    ):
        with pytest.raises(hilfit.InputError) as caught:
            hilfit.Recording.from_arrays(loaded.time, values, units=units)
        assert said in str(caught.value) and "\n" not in str(caught.value)
    fewer = {key: values for key, values in loaded.values.items() if key != name}
    with pytest.raises(hilfit.InputError, match=f"{name}: this channel is missing"):
        result.model.predict(hilfit.Recording.from_arrays(loaded.time, fewer))


def test_what_was_not_measured_is_a_gap(arm: Path) -> None:
    machine, loaded = arrays_of(arm, "validate")
    values = {name: column.copy() for name, column in loaded.values.items()}
    next(iter(values.values()))[100:120] = np.nan
    read = hilfit.Recording.from_arrays(loaded.time, values).of(machine.content)
    assert len(read.segments()) == 2


@pytest.mark.slow
def test_results_are_short_in_words_and_whole_in_a_notebook(result: hilfit.Result) -> None:
    assert repr(result).startswith("Result(not_examined") and repr(result.model).startswith("Model(test-arm: 2 joints")
    assert "joint1.f_c" in result.model._repr_html_() and "<td>joint2</td>" in result._repr_html_()
    figure = result.plot(["joint2"])
    left, right = figure.axes
    assert left.get_ylabel() == "joint2 [N m]" and len(left.lines) == len(right.lines) == 2
    error = result.report["errors"]["joint2"]["after"]["validate"]
    assert np.std(right.lines[1].get_ydata()) == pytest.approx(error, rel=0.1)


def test_an_effect_that_was_misspelt_is_suggested(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["effects", "show", "stribek"]) == 2
    assert "did you mean 'stribeck'?" in capsys.readouterr().err


@pytest.mark.slow
def test_a_model_is_read_and_asked_without_what_only_fits_need(result: hilfit.Result, tmp_path: Path) -> None:
    path = result.model.save(tmp_path / "model.json")
    heavy = ("scipy.signal", "scipy.stats", "matplotlib")
    code = f"import sys, hilfit\nmodel = hilfit.Model.load({str(path)!r})\nmodel.gravity([0.1] * len(model.joints))\n"
    code += f"print([name for name in {heavy} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.splitlines()[-1] == "[]"
