"""Stages one by one, in one process and as programs, give one and the same report."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from pydantic_core import PydanticSerializationError
from synthetic_arm import make_recordings, planar_machine, truth

from daq.errors import HilfitError, InputError
from daq.machine.machine_file import machine_to_yaml
from daq.recordings.recording import write_recording
from fitting.loop.session import Options, Request
from fitting.pipeline import stages
from fitting.pipeline.results.stage_results import Written
from fitting.pipeline.stage_program import load_request, main
from fitting.pipeline.stages import STAGES, identify, run_stage


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A two-joint arm on disk, recorded for 30 s a motion."""
    directory = tmp_path_factory.mktemp("arm")
    machine = planar_machine(2)
    (directory / "machine.yaml").write_text(machine_to_yaml(machine), encoding="utf-8")
    for recording in make_recordings(machine, truth(2), seconds=30.0):
        path = directory / f"{recording.role}.parquet"
        write_recording(path, machine, recording.role, recording.time, recording.values)
    return directory


def request_of(files: Path, output: Path, **options: Any) -> Request:
    recordings = tuple((role, files / f"{role}.parquet") for role in ("unloaded", "train", "repeat", "validate"))
    return Request(files / "machine.yaml", recordings, output, Options(**options))


def request_file(request: Request, path: Path) -> Path:
    content = {
        "machine": str(request.machine),
        "recordings": [[role, str(file)] for role, file in request.recordings],
        "output": str(request.output),
        "options": {"loop": request.options.loop},
        **({} if request.languages == ("en",) else {"languages": request.languages}),
    }
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def at_once(files: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], Path, list[float]]:
    """The report of :func:`identify`, where it was written, and the fractions that were reported."""
    output = tmp_path_factory.mktemp("at-once") / "report"
    fractions: list[float] = []
    return identify(request_of(files, output), lambda f, text: fractions.append(f)), output, fractions


@pytest.fixture(scope="module")
def one_by_one(files: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Request, dict[str, dict[str, Any]]]:
    """All stages through :func:`run_stage`, each from the files of those before."""
    request = request_of(files, tmp_path_factory.mktemp("one-by-one") / "report")
    return request, {stage: run_stage(stage, request) for stage in STAGES}


def undated(report: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in report.items() if key != "created"}


@pytest.mark.slow
def test_one_by_one_is_the_same_as_at_once(
    at_once: tuple[dict[str, Any], Path, list[float]], one_by_one: tuple[Request, dict[str, dict[str, Any]]]
) -> None:
    report, output, _ = at_once
    request, results = one_by_one
    written = json.loads((request.output / "report.json").read_text(encoding="utf-8"))
    assert undated(written) == undated(json.loads(json.dumps(report)))
    assert undated(json.loads((output / "report.json").read_text(encoding="utf-8"))) == undated(written)
    assert results["report"] == {"report": "report.json", "page": "report.html"}
    assert (request.output / "report.html").stat().st_size > 1000


@pytest.mark.slow
def test_the_report_is_that_of_the_contract(at_once: tuple[dict[str, Any], Path, list[float]]) -> None:
    report, output, _ = at_once
    assert report["schema"] == "hilfit/report/1" and report["machine"] == "test-arm"
    assert report["loop"]["verdict"] == "nothing_missing"
    assert report["reduction"]["base_parameters"] == 6
    assert [d["role"] for d in report["data"]] == ["unloaded", "train", "repeat", "validate"]
    for joint in ("joint1", "joint2"):
        assert set(report["cylinders"][joint]["parameters"]) == {"m", "K", "f_c", "f_v", "f_s"}
        errors = report["errors"][joint]
        # Nothing was missing: the validation error is the noise.
        assert errors["after"]["validate"] == pytest.approx(errors["noise_floor"], rel=0.35)
    assert sorted(p.name for p in output.iterdir()) == ["model.json", "report.html", "report.json"]


@pytest.mark.slow
def test_progress_rises_from_nothing_to_done(at_once: tuple[dict[str, Any], Path, list[float]]) -> None:
    fractions = at_once[2]
    assert fractions == sorted(fractions)
    assert fractions[0] == 0.0 and fractions[-1] == 1.0 and len(fractions) >= len(STAGES)


@pytest.mark.slow
def test_a_finished_stage_is_read_not_computed(
    one_by_one: tuple[Request, dict[str, dict[str, Any]]], monkeypatch: pytest.MonkeyPatch
) -> None:
    request, results = one_by_one

    def refuse(*args: object) -> None:
        raise AssertionError("computed again")

    monkeypatch.setattr(stages, "STEPS", dict.fromkeys(stages.STEPS, refuse))
    monkeypatch.setattr(stages, "build_report", refuse)
    monkeypatch.setattr(stages.Session, "load", refuse)
    for stage in STAGES:
        assert run_stage(stage, request) == results[stage]


def test_a_stage_before_its_time_says_which_one_is_missing(files: Path, tmp_path: Path) -> None:
    request = request_of(files, tmp_path / "report")
    with pytest.raises(HilfitError, match="stage 'check' has not been run") as caught:
        run_stage("residual", request)
    assert not isinstance(caught.value, InputError)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "report").exists()


def test_an_unknown_stage_is_an_input_error(files: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there is no stage 'magic'; use one of check, "):
        run_stage("magic", request_of(files, tmp_path))


def test_a_stage_that_fails_leaves_nothing_half(files: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    request = request_of(files, tmp_path / "report")
    monkeypatch.setitem(stages.STEPS, "check", lambda *args: Written({1, 2}, ""))
    with pytest.raises(PydanticSerializationError):
        run_stage("check", request)
    assert not [p for p in (tmp_path / "report").rglob("*") if p.is_file()]


@pytest.mark.slow
def test_without_the_loop_both_stages_are_reported(files: Path, tmp_path: Path) -> None:
    report = identify(request_of(files, tmp_path / "report", loop=False))
    assert report["loop"]["effects"] == [] and report["loop"]["candidates"] == []
    assert report["errors"]["joint1"]["before"] == pytest.approx(report["errors"]["joint1"]["after"], rel=1e-6)


@pytest.mark.slow
def test_the_program_speaks_json_lines(files: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = request_file(request_of(files, tmp_path / "report"), tmp_path / "request.json")
    assert main([str(path), "check"]) == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert all(line.keys() - {"messages"} == {"fraction", "text"} for line in lines[:-1]) and len(lines) > 1
    assert lines[-1]["summary"]["base_parameters"] == 6
    assert json.loads((tmp_path / "report" / "stages" / "check.json").read_text()) == lines[-1]["summary"]

    assert main([str(path), "report"]) == 1  # a stage in between has not been run
    assert "has not been run" in json.loads(capsys.readouterr().out.splitlines()[-1])["error"]


@pytest.mark.parametrize(
    ("content", "what"),
    [
        (None, "No such file"),
        ("{", "not a request"),
        ('{"machine": "m.yaml"}', "recordings"),
        ('{"machine": "m.yaml", "recordings": [], "output": "x", "options": {"lop": true}}', "lop"),
    ],
)
def test_a_bad_request_is_exit_code_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], content: str | None, what: str
) -> None:
    path = tmp_path / "request.json"
    if content is not None:
        path.write_text(content, encoding="utf-8")
    assert main([str(path), "check"]) == 2
    (line,) = capsys.readouterr().out.splitlines()
    error = json.loads(line)["error"]
    assert "request.json" in error and what in error and "\n" not in error


def test_bad_usage_and_bad_files_are_exit_code_2(
    files: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([]) == 2
    assert "usage" in json.loads(capsys.readouterr().out)["error"]
    request = request_of(files, tmp_path / "report")
    path = request_file(Request(tmp_path / "absent.yaml", request.recordings, request.output), tmp_path / "r.json")
    assert main([str(path), "check"]) == 2
    assert "absent.yaml" in json.loads(capsys.readouterr().out.splitlines()[-1])["error"]
    assert not (tmp_path / "report").exists()


def test_a_request_survives_its_file(files: Path, tmp_path: Path) -> None:
    request = request_of(files, tmp_path / "report", loop=False)
    assert load_request(request_file(request, tmp_path / "request.json")) == request
    both = replace(request, languages=("en", "de"))
    assert load_request(request_file(both, tmp_path / "request.json")) == both


@pytest.mark.slow
def test_one_process_does_all_stages_and_reads_the_recordings_once(
    files: Path, tmp_path: Path, one_by_one: tuple[Request, dict[str, dict[str, Any]]]
) -> None:
    copies = tmp_path / "files"
    shutil.copytree(files, copies)
    request = replace(request_of(copies, tmp_path / "report"), languages=("en", "de"))
    path = request_file(request, tmp_path / "request.json")
    with subprocess.Popen(
        [sys.executable, "-m", "fitting.pipeline.stage_program", "--stay", str(path), STAGES[0]],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    ) as program:  # fmt: skip
        assert program.stdin is not None and program.stdout is not None and program.stderr is not None
        for stage in STAGES:
            said = next(line for line in map(json.loads, program.stdout) if "fraction" not in line)
            assert said["stays"] is True
            expected = one_by_one[1][stage]
            assert {key: said["summary"][key] for key in expected} == expected
            if stage == STAGES[0]:
                for recording in copies.glob("*.parquet"):
                    recording.unlink()
            if stage != STAGES[-1]:
                order = {"arguments": [str(path), STAGES[STAGES.index(stage) + 1]], "log": str(tmp_path / "log")}
                program.stdin.write(json.dumps(order) + "\n")
                program.stdin.flush()
        program.stdin.close()
        assert program.wait(60) == 0
        assert program.stderr.read() == ""
    assert (tmp_path / "report" / "report.json").is_file()
    assert '<html lang="de">' in (tmp_path / "report" / "report.de.html").read_text(encoding="utf-8")
    assert (tmp_path / "log").read_text() == ""


@pytest.mark.slow
def test_as_a_process_of_its_own(files: Path, tmp_path: Path) -> None:
    path = request_file(request_of(files, tmp_path / "report"), tmp_path / "request.json")
    done = subprocess.run(
        [sys.executable, "-m", "fitting.pipeline.stage_program", str(path), "check"],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    assert "summary" in json.loads(done.stdout.splitlines()[-1])
    assert done.stderr == ""
