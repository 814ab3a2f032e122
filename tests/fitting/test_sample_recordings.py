"""The whole identification on recordings of a plant that shares no code with it; ``truth.yaml`` checks the answer.

One case of each kind: nothing missing, an effect of the catalogue, one outside. ``hilfit bench samples`` does all six,
with all of each recording.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
import yaml
from arm_examples import SHARED

from daq.machine.machine_file import load_machine
from daq.recordings.recording import read_recording
from fitting.loop.session import Session
from fitting.pipeline.results.results import build_report
from fitting.pipeline.results.stage_results import StageResults
from fitting.pipeline.stages import STEPS
from fitting.report.model import Figures

pytestmark = pytest.mark.slow

ROLES = {
    "unloaded": "unloaded",
    "train-1": "train",
    "train-2": "train",
    "repeat": "repeat",
    "validate": "validate",
}
#: Of each recording's minute.
SECONDS = 40.0


@cache
def made(case: str) -> tuple[dict[str, Any], Figures]:
    """The report of one case and its figures; computed once for all tests."""
    directory = SHARED / "samples" / case
    if not directory.exists():
        pytest.skip(f"sample {case} is not there")
    machine = load_machine(directory / "machine.yaml")
    whole = [read_recording(directory / f"{name}.parquet", machine, role) for name, role in ROLES.items()]
    session = Session(machine, [own.cut(slice(0, round(SECONDS * own.rate_hz))) for own in whole])
    results = StageResults()
    for compute in STEPS.values():
        results = results.having(compute(session, results, lambda fraction, text: None))
    return build_report(session, results)


def report(case: str) -> dict[str, Any]:
    """The report of one case."""
    return made(case)[0]


def truth_of(case: str) -> dict[str, Any]:
    """What the plant really was."""
    return dict(yaml.safe_load((SHARED / "samples" / case / "truth.yaml").read_text(encoding="utf-8")))


def named(case: str) -> list[tuple[str, str | None]]:
    """Effect and joint of every effect that stands in the report, without the other members of its set."""
    return [(e["id"], e["joint"]) for e in report(case)["loop"]["effects"]]


def over_floor(case: str) -> float:
    """Validate error over noise floor, root mean square over the joints."""
    ratios = [e["after"]["validate"] / e["noise_floor"] for e in report(case)["errors"].values()]
    return float(np.sqrt(np.mean(np.square(ratios))))


def test_nothing_missing_is_said_to_be_nothing() -> None:
    loop = report("nothing-missing")["loop"]
    assert loop["verdict"] == "nothing_missing"
    assert loop["effects"] == [] and loop["unexplained"] == []
    assert over_floor("nothing-missing") <= 1.15


def test_the_folding_arm_has_eighteen_base_parameters() -> None:
    assert report("nothing-missing")["reduction"] == {"standard_parameters": 78, "base_parameters": 18}


def test_friction_and_stiffness_are_the_plants() -> None:
    cylinders = report("nothing-missing")["cylinders"]
    for joint, true in truth_of("nothing-missing")["cylinders"].items():
        found = cylinders[joint]["parameters"]
        assert found["f_c"]["value"] == pytest.approx(true["f_c"], rel=0.05), joint
        assert found["K"]["value"] == pytest.approx(true["K"], rel=0.03), joint
        # And what is said of the deviation is true.
        for name in ("K", "f_c", "f_v", "f_s"):
            assert abs(found[name]["value"] - true[name]) < 5 * found[name]["std"], (joint, name)


def test_the_one_shot_regression_stands_beside_it_and_is_worse_conditioned() -> None:
    content = report("nothing-missing")
    assert content["one_shot"]["condition_number"] > content["rigid_body"]["stage_2"]["condition_number"]
    assert set(content["one_shot"]["errors"]) == set(content["errors"])


def test_position_friction_is_named_added_and_confirmed() -> None:
    content = report("position-friction-joint2")
    assert content["loop"]["verdict"] == "effect_added"
    assert named("position-friction-joint2") == [("position_dependent_friction", "joint2")]
    errors = content["errors"]["joint2"]
    assert errors["before"]["validate"] > 3 * errors["noise_floor"]
    assert errors["after"]["validate"] <= 1.2 * errors["noise_floor"]
    low, high = content["overall"]["ci95_percent"]
    assert high < 0 and low <= content["overall"]["change_percent"] <= high


def test_a_bent_guide_is_in_no_catalogue_and_gets_no_name() -> None:
    content = report("bent-guide-joint1")
    assert content["loop"]["verdict"] == "unexplained"
    assert named("bent-guide-joint1") == []
    places = {(u["joint"], u["variable"]) for u in content["loop"]["unexplained"]}
    assert places == {("joint1", "piston_position")}
    law = content["loop"]["unexplained"][0]["law"]
    assert len(law["grid"]) == len(law["value"]) == len(law["std"]) > 10
    assert content["errors"]["joint1"]["after"]["validate"] < 0.5 * content["errors"]["joint1"]["before"]["validate"]


def test_two_laws_of_one_signal_are_drawn_once_as_what_they_add_up_to() -> None:
    content, figures = made("bent-guide-joint1")
    even, odd = sorted(content["loop"]["unexplained"], key=lambda law: law["times_sign_of_speed"])
    assert (even["times_sign_of_speed"], odd["times_sign_of_speed"]) == (False, True)
    (drawn,) = figures.scatter
    assert drawn.direction is not None and drawn.law_back is not None and set(drawn.direction) <= {-1.0, 0.0, 1.0}
    same, turning = (np.interp(drawn.law_x, law["law"]["grid"], law["law"]["value"]) for law in (even, odd))
    scale = float(np.ptp(drawn.law_y))
    assert drawn.law_y == pytest.approx(same + turning, abs=1e-2 * scale)  # both grids are interpolated
    assert drawn.law_back == pytest.approx(same - turning, abs=1e-2 * scale)


@pytest.mark.parametrize(
    "case",
    ["nothing-missing", "position-friction-joint2"],
)
def test_no_joint_gets_worse_on_the_validation_motion(case: str) -> None:
    for joint, errors in report(case)["errors"].items():
        # One per cent, and what the floor's own estimate can do: the errors are those of 60 s.
        assert errors["after"]["validate"] <= 1.01 * errors["before"]["validate"] + 0.05 * errors["noise_floor"], joint


@pytest.mark.parametrize(
    "case",
    ["nothing-missing", "position-friction-joint2", "bent-guide-joint1"],
)
def test_every_candidate_has_a_reason_and_every_limit_a_size(case: str) -> None:
    loop = report(case)["loop"]
    assert loop["candidates"] and loop["detection_limits"]
    assert all(c["reason"] and c["status"] in STATUSES for c in loop["candidates"])
    assert all(entry["smallest"] > 0 for entry in loop["detection_limits"])


STATUSES = ("accepted", "rejected", "indistinguishable", "artefact")
