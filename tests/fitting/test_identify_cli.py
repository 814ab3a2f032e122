"""``hilfit identify`` and ``hilfit effects`` when all is well: what is printed, what is written."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline
from synthetic_arm import make_recordings, planar_machine, truth

from daq.machine.machine_file import machine_to_yaml
from daq.recordings.recording import write_recording
from fitting.effects import effects
from server.commands.command_line import main


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One joint, 20 s a motion, Parquet and CSV."""
    directory = tmp_path_factory.mktemp("arm")
    machine = planar_machine(1)
    (directory / "machine.yaml").write_text(machine_to_yaml(machine), encoding="utf-8")
    for recording in make_recordings(machine, truth(1), seconds=20.0):
        for suffix in ("parquet", "csv"):
            path = directory / f"{recording.role}.{suffix}"
            write_recording(path, machine, recording.role, recording.time, recording.values)
    return directory


def command(arm: Path, output: Path, suffix: str = "parquet") -> list[str]:
    recordings = [part for role in ("unloaded", "train", "repeat", "validate") for part in (f"--{role}", role)]
    files = [part if part.startswith("--") else str(arm / f"{part}.{suffix}") for part in recordings]
    return ["identify", str(arm / "machine.yaml"), *files, "-o", str(output)]


def run(arguments: list[str]) -> int:
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    return int(caught.value.code or 0)


@pytest.mark.slow
def test_the_report_is_written_and_the_table_printed(
    arm: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "deep" / "report"
    assert run(command(arm, output)) == 0
    printed = capsys.readouterr().out
    report = json.loads((output / "report.json").read_text(encoding="utf-8"))
    assert "joint1" in printed and "noise floor" in printed
    assert str(output / "report.html") in printed
    assert (output / "report.html").exists()
    assert report["loop"]["verdict"] == "nothing_missing"


@pytest.mark.slow
def test_json_prints_the_report_and_nothing_else(arm: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run([*command(arm, tmp_path / "out"), "--json", "--no-loop"]) == 0
    written = capsys.readouterr()
    report = json.loads((tmp_path / "out" / "report.json").read_text(encoding="utf-8"))
    assert json.loads(written.out) == report
    assert written.err == ""


@pytest.mark.slow
def test_the_page_is_in_the_language_that_is_asked_for(
    arm: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run([*command(arm, tmp_path / "out"), "--no-loop", "--language", "de"]) == 0
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert '<html lang="de">' in page and "Nur angepasst: Was fehlt, wurde nicht gesucht" in page
    report = json.loads((tmp_path / "out" / "report.json").read_text(encoding="utf-8"))
    assert report["summary"]["label"] == "Fitted only: what is missing was not looked for"
    assert not (tmp_path / "out" / "report.de.html").exists()
    capsys.readouterr()
    assert run([*command(arm, tmp_path / "none"), "--language", "tlh"]) == 2
    said = capsys.readouterr().err.strip()
    assert "--language" in said and "en, de" in said.replace("'", "") and "\n" not in said
    assert not (tmp_path / "none").exists()


@pytest.mark.slow
def test_csv_gives_the_same_parameters(arm: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    values = []
    for suffix in ("parquet", "csv"):
        assert run([*command(arm, tmp_path / suffix, suffix), "--json", "--no-loop"]) == 0
        report = json.loads(capsys.readouterr().out)
        values.append([p["value"] for p in report["cylinders"]["joint1"]["parameters"].values()])
    assert values[0] == pytest.approx(values[1], rel=1e-6)


def logged(source: Path, target: Path) -> None:
    """A CSV of ours as a logger would have it: 200 Hz, milliseconds, semicolons and decimal commas, its own names."""
    names = source.read_text(encoding="utf-8").splitlines()[0].replace('"', "").split(",")
    rows = np.loadtxt(source, delimiter=",", skiprows=1)
    time = np.arange(rows[0, 0], rows[-1, 0], 1 / 200)
    columns = make_interp_spline(rows[:, 0], rows[:, 1:], k=5)(time)
    header = ";".join(["t_ms", *(f"ch{number} ({unit})" for number, unit in enumerate(UNITS))])
    lines = [
        ";".join(f"{v:.9g}" for v in (1e3 * t, *row)).replace(".", ",") for t, row in zip(time, columns, strict=True)
    ]
    target.write_text("\n".join([header, *lines]), encoding="utf-16")
    assert names[1:] == list(CHANNELS)


CHANNELS = ("joint1.x", "joint1.head", "joint1.rod", "joint1.q")
UNITS = ("m", "Pa", "Pa", "rad")


@pytest.mark.slow
def test_a_loggers_files_are_identified_with_a_map_on_request(
    arm: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for role in ("unloaded", "train", "repeat", "validate"):
        logged(arm / f"{role}.csv", tmp_path / f"{role}.csv")
    (tmp_path / "machine.yaml").write_bytes((arm / "machine.yaml").read_bytes())
    written = tmp_path / "map.yaml"
    written.write_text("".join(f"{name}: ch{number}\n" for number, name in enumerate(CHANNELS)), encoding="utf-8")
    asked = [*command(tmp_path, tmp_path / "out", "csv"), "--json", "--no-loop", "--map", str(written)]
    assert run(asked) == 2
    line = capsys.readouterr().err
    assert len(line.splitlines()) == 1 and "200 Hz" in line and "rate_hz 50" in line and "--resample" in line
    assert run([*asked, "--resample"]) == 0
    report = json.loads(capsys.readouterr().out)
    said = [warning for warning in report["warnings"] if "resampled from 200 Hz to 50 Hz" in warning]
    assert len(said) == 4 and said[0].startswith("unloaded.csv: ")
    assert run([*command(arm, tmp_path / "plain"), "--json", "--no-loop"]) == 0
    plain = json.loads(capsys.readouterr().out)
    # The samples between were made up from the noisy ones, so only what the motion tells is the same.
    friction = [r["cylinders"]["joint1"]["parameters"]["f_c"] for r in (report, plain)]
    assert friction[0]["value"] == pytest.approx(friction[1]["value"], abs=4 * friction[1]["std"])
    assert not [warning for warning in plain["warnings"] if "resampled" in warning]


@pytest.mark.slow
def test_the_bandwidth_is_the_one_that_was_asked_for(
    arm: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run([*command(arm, tmp_path / "out"), "--json", "--no-loop", "--bandwidth", "4"]) == 0
    assert json.loads(capsys.readouterr().out)["bandwidth_hz"] == 4.0


def test_effects_are_listed_and_shown(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["effects", "list", "--json"]) == 0
    listed = json.loads(capsys.readouterr().out)
    assert [entry["id"] for entry in listed] == [e.id for e in effects()]
    assert run(["effects", "list"]) == 0
    table = capsys.readouterr().out
    assert all(e.id in table for e in effects())
    assert run(["effects", "show", "stribeck", "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)
    assert shown["equation"] and shown["experiment"] and shown["parameters"][0] == {"name": "f_b", "unit": "N"}
    assert run(["effects", "show", "stribeck"]) == 0
    text = capsys.readouterr().out
    assert "f_b [N]" in text and shown["title"] in text
