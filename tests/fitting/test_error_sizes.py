"""Standard deviation, RMS, mean and relative error: against their definitions, and what an offset does to a report."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from synthetic_arm import clean_session, make_recordings, planar_machine, truth

from daq.machine.machine_file import machine_to_yaml
from daq.recordings.recording import write_recording
from fitting.loop.session import Options, Request
from fitting.pipeline.results.summary import print_summary
from fitting.pipeline.stages import identify
from fitting.regression.design import effort_errors
from fitting.regression.error_sizes import errors_of, measured_efforts, overall_errors, overall_relative, sizes
from fitting.report.wording import is_offset

OFFSET = 25.0  # N m, on a joint whose noise is some 2 N m
ROLES = ("train", "validate")
RECORDED = (("train", 2), ("repeat", 2), ("validate", 3))

values = hnp.arrays(np.float64, st.integers(1, 40), elements=st.floats(-1e3, 1e3))


@given(values)
def test_rms_is_scatter_and_offset_together(error: np.ndarray) -> None:
    found = {key: entry[0] for key, entry in sizes("validate", [error], [np.ones_like(error)]).items()}
    std, rms, mean = (found[key] for key in ("validate", "validate_rms", "validate_mean"))
    assert std is not None and rms is not None and mean is not None
    assert rms**2 == pytest.approx(std**2 + mean**2, rel=1e-9, abs=1e-9)


def test_sizes_of_no_rows_are_none() -> None:
    assert sizes("train", [np.zeros(0)], [np.zeros(0)]) == {
        "train": [None],
        "train_rms": [None],
        "train_mean": [None],
        "train_relative": [None],
    }


def test_joints_of_one_unit_are_stacked_and_others_are_not() -> None:
    errors, efforts = [np.array([3.0, 4.0]), np.array([12.0])], [np.array([6.0, 8.0]), np.array([24.0, 0.0])]
    assert overall_relative(errors, efforts, ["N m", "N m"]) == pytest.approx(13.0 / np.hypot(10.0, 24.0))
    assert overall_relative(errors, efforts, ["N m", "N"]) == pytest.approx(0.5)
    assert overall_relative([errors[0], np.zeros(0)], [efforts[0], np.zeros(0)], ["N m", "N"]) == pytest.approx(0.5)
    assert overall_relative([np.zeros(0)], [np.zeros(0)], ["N"]) is None


def test_a_model_of_zeros_leaves_the_measured_effort() -> None:
    """With all parameters zero the error is the effort less what is known (the damping): relative errors are near 1."""
    session = clean_session(2)
    design = session.plain.design
    theta = np.zeros(len(design.parameters))
    indices = design.indices("validate")
    for error, effort in zip(effort_errors(design, theta, indices), measured_efforts(design, indices), strict=True):
        assert error.shape == effort.shape
        known = np.linalg.norm(error - effort) / np.linalg.norm(effort)  # c v, 150 N s/m at some 0.05 m/s
        assert 0.0 < known < 0.02
    found, series, relative = errors_of(design, theta)
    assert relative["validate"] == pytest.approx(1.0, abs=0.02) and relative["of"] == "stacked"
    assert np.allclose(series["validate"][0], effort_errors(design, theta, indices)[0])
    assert found["train_rms"][0] == pytest.approx(float(np.sqrt(np.mean(series["train"][0] ** 2))))


def test_all_joints_in_noise_floors() -> None:
    of_joints = {f"{role}_{size}": [6.0, 8.0] for role in ROLES for size in ("rms", "mean")}
    relative = {"train": 0.2, "validate": 0.1, "of": "stacked"}
    found = dict.fromkeys(("before", "after"), (of_joints, None, relative))
    overall = overall_errors(found, [2.0, 2.0], "validate")
    assert overall["rms"] == dict.fromkeys(
        ("before", "after", "train_before", "train_after"), pytest.approx(np.sqrt((9.0 + 16.0) / 2))
    )
    assert overall["relative"]["after"] == 0.1 and overall["relative"]["train_after"] == 0.2


def test_an_offset_is_more_than_half_of_the_power() -> None:
    assert is_offset(-8.0, 10.0) and not is_offset(7.0, 10.0)
    assert not is_offset(None, 10.0) and not is_offset(0.0, 0.0)


def electric(directory: Path, offset: float) -> Request:
    """Two joints driven directly; on ``validate`` joint1's torque sensor reads ``offset`` too much."""
    machine = planar_machine(kinds="rr")
    (directory / "machine.yaml").write_text(machine_to_yaml(machine), encoding="utf-8")
    recordings = []
    added = [np.array([offset, 0.0]) if role == "validate" else np.zeros(2) for role, _ in RECORDED]
    for recording in make_recordings(machine, truth(2), RECORDED, added=added, seconds=20.0):
        path = directory / f"{recording.role}.parquet"
        write_recording(path, machine, recording.role, recording.time, recording.values)
        recordings.append((recording.role, path))
    return Request(directory / "machine.yaml", tuple(recordings), directory / "out", Options(loop=False))


@pytest.fixture(scope="module")
def reports(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[dict[str, Any], Path]]:
    found = {}
    for name, offset in (("sound", 0.0), ("offset", OFFSET)):
        request = electric(tmp_path_factory.mktemp(name), offset)
        found[name] = identify(request), request.output
    return found


@pytest.mark.slow
def test_an_offset_on_validate_is_seen(
    reports: dict[str, tuple[dict[str, Any], Path]], capsys: pytest.CaptureFixture[str]
) -> None:
    (sound, _), (wrong, output) = reports["sound"], reports["offset"]
    before, after = sound["errors"]["joint1"]["after"], wrong["errors"]["joint1"]["after"]
    assert after["validate"] == pytest.approx(before["validate"], rel=1e-6)  # the standard deviation is blind
    assert after["validate_mean"] - before["validate_mean"] == pytest.approx(OFFSET, rel=1e-6)
    assert after["validate_rms"] > 5.0 * before["validate_rms"]
    assert after["validate_relative"] > 2.0 * before["validate_relative"]
    assert wrong["errors"]["joint2"]["after"] == pytest.approx(sound["errors"]["joint2"]["after"], rel=1e-6)
    assert wrong["overall"]["relative"]["after"] > sound["overall"]["relative"]["after"]
    assert wrong["overall"]["rms"]["after"] > wrong["overall"]["after"]  # the latter is of standard deviations
    assert not is_offset(before["validate_mean"], before["validate_rms"])
    page = (output / "report.html").read_text(encoding="utf-8")
    assert "Offset and relative size" in page and f"{after['validate_mean']:.1f} ⚠" in page
    print_summary(wrong, output)
    printed = capsys.readouterr().out
    assert f"{after['validate_mean']:.3g}" in printed and "relative error of all joints" in printed


@pytest.mark.slow
def test_one_shot_and_two_stages_carry_the_same_sizes(reports: dict[str, tuple[dict[str, Any], Path]]) -> None:
    report, _ = reports["sound"]
    wanted = {f"{role}{size}" for role in ROLES for size in ("", "_rms", "_mean", "_relative")}
    for joint, entry in report["errors"].items():
        assert set(entry["before"]) == set(entry["after"]) == set(entry["two_stage"]) == wanted
        assert set(report["one_shot"]["errors"][joint]) == wanted
    assert 0.0 < report["one_shot"]["relative"]["validate"] < 1.0
    assert report["overall"]["relative"]["of"] == "stacked"
