"""``hilfit check``, and the checks inside ``hilfit identify``."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from synthetic_arm import make_recordings, planar_machine, truth

from daq.machine.machine_file import machine_to_yaml
from daq.messages import Sentence
from daq.recordings.recording import write_recording
from daq.recordings.recording_files import read_table
from fitting.checks.check import check_files
from server.commands.command_line import main

MACHINE = planar_machine(1)


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One joint with both sensors; ``swapped`` is the training motion with its chambers swapped."""
    directory = tmp_path_factory.mktemp("arm")
    (directory / "machine.yaml").write_text(machine_to_yaml(MACHINE), encoding="utf-8")
    for recording in make_recordings(MACHINE, truth(1), [("train", 2), ("validate", 3)], seconds=25.0):
        values = {name: np.array(column) for name, column in recording.values.items()}
        write_recording(directory / f"{recording.role}.parquet", MACHINE, recording.role, recording.time, values)
        values["joint1.head"], values["joint1.rod"] = values["joint1.rod"], values["joint1.head"]
        path = directory / f"swapped-{recording.role}.csv"
        write_recording(path, MACHINE, recording.role, recording.time, values)
    return directory


def run(*arguments: str) -> int:
    with pytest.raises(SystemExit) as caught:
        main(list(arguments))
    return int(caught.value.code or 0)


def test_nothing_is_wrong_with_a_sound_arm(arm: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = [str(arm / "train.parquet"), str(arm / "validate.parquet")]
    assert run("check", *files, "--machine", str(arm / "machine.yaml")) == 0
    assert "nothing was found to be wrong with 2 recording(s)" in capsys.readouterr().out


@pytest.mark.slow
def test_a_mistake_is_printed_with_its_cure_and_line(arm: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = ["--train", str(arm / "swapped-train.csv"), "--validate", str(arm / "swapped-validate.csv")]
    assert run("check", *files, "--machine", str(arm / "machine.yaml"), "--json") == 1
    found = json.loads(capsys.readouterr().out)["findings"]
    assert (found[0]["code"], found[0]["joint"], found[0]["severity"]) == ("swapped_chambers", "joint1", "mistake")
    assert run("check", *files, "--machine", str(arm / "machine.yaml")) == 1
    line = capsys.readouterr().out.splitlines()[0]
    assert line.startswith("MISTAKE [swapped_chambers] joint1: head and rod pressure look swapped")
    assert "swap the two channels in machine.yaml lines" in line


def test_a_refusal_of_the_reader_is_a_message_in_every_language(arm: Path, tmp_path: Path) -> None:
    table = read_table(arm / "train.parquet")
    values = {channel.name: np.array(table.columns[channel.name]) for channel in MACHINE.channels}
    values["joint1.rod"] = np.ones_like(values["joint1.rod"])
    path = write_recording(tmp_path / "still.csv", MACHINE, "train", table.columns["time"], values)
    found = next(own for own in check_files(MACHINE, [("train", path)]) if own.code == "constant")
    assert isinstance(found.text, Sentence) and found.line == found.text and "check the sensor" in found.line
    assert "joint1.rod" in found.text.worded("de") and "check the sensor" not in found.text.worded("de")


@pytest.mark.slow
def test_a_map_and_another_rate_are_taken_as_identify_takes_them(
    arm: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = read_table(arm / "swapped-train.csv")
    twice = np.arange(0.0, float(table.columns["time"][-1]), 0.01)
    renamed = {"t": twice} | {
        f"ai{k}": np.interp(twice, table.columns["time"], np.asarray(table.columns[c.name], dtype=float))
        for k, c in enumerate(MACHINE.channels)
    }
    rows = np.column_stack(list(renamed.values()))
    np.savetxt(tmp_path / "train.csv", rows, delimiter=",", header=",".join(renamed), comments="")
    (tmp_path / "map.yaml").write_text(
        "time: t\n" + "".join(f"{c.name}: {{column: ai{k}}}\n" for k, c in enumerate(MACHINE.channels)),
        encoding="utf-8",
    )
    call = ["check", str(tmp_path / "train.csv"), "--machine", str(arm / "machine.yaml")]
    assert run(*call, "--map", str(tmp_path / "map.yaml"), "--resample", "--json") == 1
    found = json.loads(capsys.readouterr().out)["findings"]
    assert [own["code"] for own in found if own["severity"] == "mistake"] == ["swapped_chambers"]
    run(*call)
    assert "columns" in capsys.readouterr().out


def test_bad_usage_is_one_line(arm: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("check", "--machine", str(arm / "machine.yaml")) == 2
    assert capsys.readouterr().err.startswith("hilfit: check: no recording; give at least one file")
    assert run("check", str(arm / "absent.csv"), "--machine", str(arm / "machine.yaml")) == 2
    assert "absent.csv: no such file" in capsys.readouterr().err


@pytest.mark.slow
def test_an_identification_says_it_first(arm: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = ["--train", str(arm / "swapped-train.csv"), "--validate", str(arm / "swapped-validate.csv")]
    assert run("identify", str(arm / "machine.yaml"), *files, "--no-loop", "-o", str(tmp_path / "report")) == 0
    assert "MISTAKE: joint1: head and rod pressure look swapped" in capsys.readouterr().out
    report = json.loads((tmp_path / "report" / "report.json").read_text(encoding="utf-8"))
    assert report["loop"]["verdict"] == "check_input"
    assert [(own["code"], own["joint"]) for own in report["checks"]] == [("swapped_chambers", "joint1")]
    page = (tmp_path / "report" / "report.html").read_text(encoding="utf-8")
    assert page.index("look swapped") < page.index("Parameters of the rigid body")
