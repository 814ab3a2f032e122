"""What stages hand on is kept as JSON and read back, equal in every number; what is of another version is refused."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daq.errors import HilfitError
from fitting.checks.findings import Finding
from fitting.effects import effect
from fitting.pipeline.cylinder_stage import CylinderEstimate
from fitting.pipeline.results.loop_results import AcceptedTerm, Attributed
from fitting.pipeline.results.stage_results import (
    RESULTS,
    Checked,
    Cylinders,
    Residual,
    RigidBody,
    Stacked,
    StageResults,
    from_json,
    to_json,
)
from fitting.pipeline.stages import STEPS
from fitting.residual.findings import Hypothesis
from fitting.residual.laws import Law
from fitting.residual.terms import Term

NUMBER = st.floats(allow_nan=False)


def through_a_file(result: Any) -> Any:
    """The same result, written as JSON text and read back."""
    return from_json(type(result), json.loads(json.dumps(to_json(result))), "stage.json")


@pytest.mark.slow
@given(st.lists(NUMBER, min_size=1, max_size=5))
def test_every_number_comes_back_with_all_its_digits(values: list[float]) -> None:
    theta = np.array(values)
    told = theta > 0
    stacked = Stacked("ols", {"steps": 3}, theta, np.abs(theta), told, 12.0, {"train": [None, *values]}, {"of": "x"})
    found = through_a_file(RigidBody(stacked, replace(stacked, estimator="ridge")))
    np.testing.assert_array_equal(found.two_stage.theta, theta)
    np.testing.assert_array_equal(found.two_stage.determined, told)
    assert found.two_stage.determined.dtype == bool
    assert found.one_shot.estimator == "ridge" and found.two_stage_ols is None
    assert found.two_stage.errors == {"train": [None, *values]}


def test_terms_and_hypotheses_come_back_as_they_are() -> None:
    named = Term(effect("stribeck"), 1, {"v_s": 0.03})
    law = Term(Law("position", 0, True, False, tuple(np.linspace(0.0, 1.0, 20))), 0)
    evidence = {"score": 90.0, "cutoffs": [{"hz": 2.1, "value": 1.0, "std": 0.1}], "replicas": 3}
    accepted = AcceptedTerm(named, ({"id": "law", "joint": "boom", "probability": None},), evidence, 0.7)
    result = Attributed("ambiguous", accepted=(accepted,), hypotheses=(Hypothesis((named, law), 0.7),))
    found = through_a_file(result)
    assert found == result
    assert found.terms == [named]


def test_estimates_of_cylinders_and_findings_come_back() -> None:
    estimate = CylinderEstimate("boom", ("m", "K"), np.array([1.0, 2.0]), np.array([0.1, np.inf]), 3.0, True, 90, None)
    (found,) = through_a_file(Cylinders((estimate,))).cylinders
    assert found.joint == "boom" and found.in_situ and found.covariance is None
    np.testing.assert_array_equal(found.std, [0.1, np.inf])
    checked = Checked(3.0, 1e-15, 26, 6, True, (Finding("swapped", "a", "b", alternatives=("c",)),))
    assert through_a_file(checked) == checked


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda content: content.pop("measured"), "stage.json: measured: this key is missing"),
        (
            lambda content: content.update(noise_floor=["much"]),
            "stage.json: noise_floor.0: must be",
        ),
        (lambda content: content.update(magic=1), "stage.json: magic: "),
    ],
)
def test_a_file_of_another_version_is_refused_in_one_line(change: Any, said: str) -> None:
    content = to_json(Residual((1.0,), (True,), True))
    change(content)
    with pytest.raises(HilfitError) as caught:
        from_json(Residual, content, "stage.json")
    assert str(caught.value).startswith(said) and "\n" not in str(caught.value)
    assert "run the stages again" in str(caught.value)


def test_every_stage_has_a_frozen_result_of_its_own() -> None:
    assert set(STEPS) == set(RESULTS) - {"report"}
    assert len(set(RESULTS.values())) == len(RESULTS)
    for kind in RESULTS.values():
        assert kind.__dataclass_params__.frozen and fields(kind)


def test_results_are_found_by_type() -> None:
    residual = Residual((1.0,), (True,), True)
    results = StageResults().having(residual)
    assert results[Residual] is residual
    assert results.get(Checked) is None
    with pytest.raises(KeyError):
        results[Checked]
