"""Which verdict what every stage found leads to, strictest first."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from fitting.checks.findings import Finding
from fitting.effects import effect
from fitting.pipeline.results.loop_results import AcceptedTerm, Attributed, Kinematic, OtherBand
from fitting.pipeline.results.stage_results import Checked, Fitted, Physics, Refitted, Residual, StageResults
from fitting.pipeline.verdict import NEEDED, label, verdict
from fitting.residual.terms import Term

NOTHING = Fitted(np.zeros(2), np.ones(2), np.ones(2, dtype=bool), np.ones(2))
CLEAN: dict[str, Any] = {
    "check": Checked(3.0, 1e-15, 26, 6, repeated=True),
    "residual": Residual((0.5, 0.3), (True, True), measured=True),
    "attribution": Attributed("nothing_missing"),
    "refit": Refitted(
        chosen=None,
        comparison={},
        weights="whitened",
        estimation={},
        joint=NOTHING,
        before=NOTHING,
        after=NOTHING,
        parameter_error=0.2,
        predicted_std=(0.6, 0.4),
        independent_rows={"train": 4000.0, "validate": 4000.0},
        plausibility=Physics(),
        condition_number=10.0,
        drive_residual_std=(0.5, 0.3),
        errors={"after": {"validate_rms": [0.52, 0.31]}},
        overall={},
    ),
}


def results(**changes: Any) -> StageResults:
    """Stages of an identification in which everything speaks for 'nothing missing', with changes ``stage__key``."""
    content = dict(CLEAN)
    for key, value in changes.items():
        stage, name = key.split("__", 1)
        content[stage] = replace(content[stage], **{name: value})
    found = StageResults()
    for result in content.values():
        found = found.having(result)
    return found


def gap(*rivals: str) -> Kinematic:
    """A finding between two position sensors."""
    return Kinematic((), {"indistinguishable_from": [{"id": rival} for rival in rivals]}, {})


JOINTS = ("boom", "arm")
FINDING = Finding("swapped_chambers", "boom: the chambers look swapped", "swap them")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({}, "nothing_missing"),
        ({"check__findings": (FINDING,), "attribution__verdict": "effect_added"}, "check_input"),
        ({"check__findings": (replace(FINDING, severity="note"),)}, "nothing_missing"),
        (
            {"refit__plausibility": Physics(({"text": "x"},)), "attribution__verdict": "effect_added"},
            "implausible",
        ),
        ({"attribution__looked": False, "attribution__verdict": "not_examined"}, "not_examined"),
        ({"attribution__verdict": "ambiguous"}, "ambiguous"),
        ({"attribution__verdict": "unexplained", "residual__kinematics": (gap(),)}, "unexplained"),
        ({"residual__kinematics": (gap(),)}, "effect_added"),
        ({"residual__kinematics": (gap("linkage_geometry"),)}, "ambiguous"),
    ],
)
def test_the_strictest_finding_decides(changes: dict[str, Any], said: str) -> None:
    assert verdict(results(**changes), JOINTS)[0] == said


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"residual__floor_valid": (True, False)}, "the noise of arm is not known"),
        ({"refit__errors": {"after": {"validate_rms": [0.9, 0.5]}}}, "is 1.73 times the noise"),
        ({"attribution__other_bands": (OtherBand(2.1, ("stribeck at boom",)),)}, "2.1 Hz"),
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


@pytest.mark.parametrize(
    ("changes", "said", "beside"),
    [
        ({}, "nothing_missing", None),
        ({"attribution__nothing": NEEDED + 0.01}, "nothing_missing", None),
        ({"attribution__nothing": NEEDED - 0.01}, "nothing_missing", "cannot_tell"),
        ({"attribution__nothing": 0.51}, "nothing_missing", "cannot_tell"),
        ({"residual__floor_valid": (True, False)}, "unexplained", "cannot_tell"),
        ({"attribution__nothing": 0.4, "attribution__verdict": "unexplained"}, "unexplained", None),
        ({"attribution__other_bands": (OtherBand(2.1, ("stribeck at boom",)),)}, "unexplained", "depends_on_band"),
        ({"residual__kinematics": (gap(),), "attribution__nothing": 0.6}, "effect_added", None),
        ({"attribution__looked": False, "attribution__verdict": "not_examined"}, "not_examined", None),
    ],
)
def test_a_label_stands_beside_a_verdict_that_the_recordings_leave_open(
    changes: dict[str, Any], said: str, beside: str | None
) -> None:
    assert verdict(results(**changes), JOINTS)[0] == said
    assert label(results(**changes)) == beside


def test_what_cannot_be_told_says_what_to_record_next() -> None:
    reasons = verdict(results(attribution__nothing=0.6), JOINTS)[1]
    assert len(reasons) == 1 and "0.60" in reasons[0] and "record" in reasons[0]
    (reason,) = verdict(results(attribution__nothing=0.3, attribution__verdict="unexplained"), JOINTS)[1]
    assert "probability of 0.3 only" in reason


@pytest.mark.parametrize(("value", "beside"), [(100.0, None), (30.0, "depends_on_band")])
def test_a_name_that_another_bandwidth_would_not_give_depends_on_it(value: float, beside: str | None) -> None:
    """At three standard deviations nothing is named."""
    cutoffs = [{"hz": hz, "value": v, "std": 10.0} for hz, v in ((3.0, 100.0), (2.1, value), (3.9, 100.0))]
    named = AcceptedTerm(Term(effect("stribeck"), 0), evidence={"cutoffs": cutoffs}, probability=0.99)
    assert label(results(attribution__verdict="effect_added", attribution__accepted=(named,))) == beside
