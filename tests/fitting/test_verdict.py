"""Which verdict what every stage found leads to, strictest first."""

from __future__ import annotations

from typing import Any

import pytest

from fitting.pipeline.verdict import verdict


def results(**changes: Any) -> dict[str, dict[str, Any]]:
    """Stages of an identification in which everything speaks for 'nothing missing', with changes ``stage__key``."""
    content: dict[str, dict[str, Any]] = {
        "check": {},
        "residual": {"kinematics": [], "noise_floor": [0.5, 0.3], "floor_valid": [True, True]},
        "attribution": {"verdict": "nothing_missing", "looked": True, "other_bands": []},
        "refit": {
            "plausibility": {"violations": []},
            "errors": {"after": {"validate_rms": [0.52, 0.31]}},
            "parameter_error": 0.2,
            "independent_rows": {"train": 4000.0, "validate": 4000.0},
        },
    }
    for key, value in changes.items():
        stage, name = key.split("__", 1)
        content[stage][name] = value
    return content


JOINTS = ("boom", "arm")
FINDING = {"code": "swapped_chambers", "severity": "mistake", "text": "boom: the chambers look swapped"}
KINEMATIC = {"rivals": []}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({}, "nothing_missing"),
        ({"check__findings": [FINDING], "attribution__verdict": "effect_added"}, "check_input"),
        ({"check__findings": [{**FINDING, "severity": "note"}]}, "nothing_missing"),
        (
            {"refit__plausibility": {"violations": [{"text": "x"}]}, "attribution__verdict": "effect_added"},
            "implausible",
        ),
        ({"attribution__looked": False, "attribution__verdict": "not_examined"}, "not_examined"),
        ({"attribution__verdict": "ambiguous"}, "ambiguous"),
        ({"attribution__verdict": "unexplained", "residual__kinematics": [KINEMATIC]}, "unexplained"),
        ({"residual__kinematics": [KINEMATIC]}, "effect_added"),
        ({"residual__kinematics": [{"rivals": ["linkage_geometry"]}]}, "ambiguous"),
    ],
)
def test_the_strictest_finding_decides(changes: dict[str, Any], said: str) -> None:
    assert verdict(results(**changes), JOINTS)[0] == said


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"residual__floor_valid": [True, False]}, "the noise of arm is not known"),
        ({"refit__errors": {"after": {"validate_rms": [0.9, 0.5]}}}, "is 1.73 times the noise"),
        ({"attribution__other_bands": [{"bandwidth_hz": 2.1, "found": ["stribeck at boom"]}]}, "2.1 Hz"),
    ],
)
def test_nothing_missing_needs_everything_to_speak_for_it(changes: dict[str, Any], reason: str) -> None:
    said, reasons = verdict(results(**changes), JOINTS)
    assert said == "unexplained"
    assert any(reason in text for text in reasons)


def test_what_short_recordings_cannot_tell_is_not_held_against_the_model() -> None:
    high = {"after": {"validate_rms": [0.7, 0.42]}}  # 1.4 times the noise
    long = results(refit__errors=high)
    short = results(refit__errors=high, refit__independent_rows={"train": 30.0, "validate": 30.0})
    assert verdict(long, JOINTS)[0] == "unexplained"
    assert verdict(short, JOINTS)[0] == "nothing_missing"


def test_uncertain_parameters_explain_their_own_error() -> None:
    high = {"after": {"validate_rms": [0.9, 0.5]}}
    assert verdict(results(refit__errors=high, refit__parameter_error=1.5), JOINTS)[0] == "nothing_missing"
