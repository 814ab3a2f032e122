"""The real programs behind jobs: a designed motion, and two calibrations judged by one recording."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from live_lever import signals
from service_fakes import MACHINE

from daq import parse_machine, write_recording
from daq.motion_files import read_motion
from fitting.loop.session import Options, Request
from fitting.pipeline.stage_names import STAGES
from fitting.pipeline.stages import run_stage
from server.excitations import excitation_job as excitation
from server.platform.processes.children import ChildResult, run_child
from server.recalibrations import recalibration_job as recalibration
from server.recalibrations.recalibration_comparison import BETTER, GREW, WORSE, sentence, table

pytestmark = pytest.mark.slow


def run(command: tuple[str, ...], request: Path) -> ChildResult:
    return run_child([*command, str(request)], log=request.with_suffix(".log"), timeout_s=200)


def test_a_design_moves_within_the_limits_and_is_not_made_again(tmp_path: Path) -> None:
    machine = tmp_path / "lever.yaml"
    machine.write_text(MACHINE)
    request = tmp_path / "request.json"
    options = {"duration_s": 8.0, "starts": 1, "seed": 3, "rods": "pinned", "joints": None, "use": None}
    request.write_text(json.dumps({"machine": str(machine), "output": str(tmp_path), "options": options}))
    first = run(excitation.PROGRAM, request)
    assert first.outcome == "done", first.error
    described = parse_machine(MACHINE)
    motion = read_motion(tmp_path / "motion.csv", described)
    assert (motion.rods, motion.seconds) == ("pinned", first.summary["seconds"])
    q = motion.joint_positions(described)[:, 0]
    low, high = described.joints[0].limits.position
    assert low <= q.min() < q.max() <= high
    assert np.abs(np.gradient(q, motion.time)).max() <= described.joints[0].limits.velocity
    assert first.summary["condition_number"] >= 1
    before = (tmp_path / "motion.csv").stat().st_mtime_ns
    assert run(excitation.PROGRAM, request) == first
    assert (tmp_path / "motion.csv").stat().st_mtime_ns == before


def identified(directory: Path, coulomb: float, seed: int) -> dict[str, Any]:
    """Model and validation recording of a real identification of a lever with this friction."""
    directory.mkdir()
    machine_file = directory / "lever.yaml"
    machine_file.write_text(MACHINE)
    machine, files = parse_machine(MACHINE), []
    for number, (role, seconds) in enumerate((("train", 60.0), ("validate", 40.0))):
        time, values = signals(seconds, seed + number, coulomb=coulomb)
        files.append((role, write_recording(directory / f"{role}.parquet", machine, role, time, values)))
    request = Request(machine_file, tuple(files), directory, Options(loop=False, bandwidth_hz=3.0))
    for stage in STAGES:
        run_stage(stage, request)
    return {"model": str(directory / "model.json"), "recordings": [str(files[1][1])]}


def test_the_residual_of_the_old_model_is_the_growth_of_friction(tmp_path: Path) -> None:
    active, new = identified(tmp_path / "active", 6.0, 10), identified(tmp_path / "new", 18.0, 20)
    request = tmp_path / "request.json"
    request.write_text(json.dumps({"active": active, "new": new}))
    result = run(recalibration.PROGRAM, request)
    assert result.outcome == "done", result.error
    joint = result.summary["joints"]["joint1"]
    # Coulomb friction 12 N m larger than the model has it: an error of +-12 N m, less what the filter takes of it.
    assert 8 < joint["before"] < 13
    assert joint["after"] < 0.3 * joint["before"]
    assert joint["then"] < 0.3 * joint["before"]
    assert (result.summary["better"], result.summary["grew"], result.summary["worse"]) == (True, ["joint1"], [])


def test_a_recording_that_is_too_short_is_refused_in_one_line(tmp_path: Path) -> None:
    made = identified(tmp_path / "active", 6.0, 10)
    time, values = signals(0.8, 3)
    short = write_recording(tmp_path / "short.parquet", parse_machine(MACHINE), "validate", time, values)
    request = tmp_path / "request.json"
    request.write_text(json.dumps({"active": made, "new": {**made, "recordings": [str(short)]}}))
    result = run(recalibration.PROGRAM, request)
    assert result.outcome == "input"
    assert "short" in str(result.error)


@pytest.mark.parametrize(
    ("before", "after", "then", "better", "worse", "grew"),
    [
        ((1.0, 1.0), (0.5, 1.0), (1.0, 1.0), True, [], []),
        ((1.0, 1.0), (0.1, 1 + 2 * WORSE), (1.0, 1.0), False, ["b"], []),
        ((1.0, 1.0), (1 - BETTER / 2, 1.0), (1.0, 1.0), False, [], []),
        ((1.0, 1.0), (1.0, 1.0), (1.0, 0.9 / GREW), False, [], ["b"]),
        ((0.0, 0.0), (0.0, 0.0), (0.0, 0.0), False, [], []),
    ],
)
def test_a_comparison_says_which_joints_got_better_or_worse(
    before: tuple[float, float],
    after: tuple[float, float],
    then: tuple[float, float],
    better: bool,
    worse: list[str],
    grew: list[str],
) -> None:
    def named(values: tuple[float, float]) -> dict[str, float]:
        return dict(zip("ab", values, strict=True))

    found = table(named(before), named(after), named(then), {"a": "N m", "b": "N m"})
    assert (found["better"], found["worse"], found["grew"]) == (better, worse, grew)
    assert ("worse at b" in sentence(found)) == bool(worse)
