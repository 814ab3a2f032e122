"""Hierarchical against one-shot: what is measured, and that the words follow the numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from synthetic_arm import clean_session, exact_design, planar_machine, truth

from fitting.arm.base_parameters import condition_number
from fitting.pipeline.comparison import compare, cylinder_conditions, in_words, stage_condition
from fitting.pipeline.results.stage_results import Stacked


def contender(theta: np.ndarray, std: float = 1.0) -> Stacked:
    return Stacked("ols", {}, theta, np.full(len(theta), std), np.ones(len(theta), dtype=bool), 10.0, {}, {})


def test_a_perfect_and_a_spoiled_model_differ_by_what_was_spoiled() -> None:
    session, arm = clean_session(2), truth(2)
    design = session.plain.design
    right = arm.theta(session.machine)
    wrong = right.copy()
    wrong[design.parameters.base_slice.start + 1] *= 1.5  # a first moment: gravity is half as large again
    result = compare(
        design,
        {"hierarchical": contender(right), "one_shot": contender(wrong), "one_shot_with_unloaded": contender(right)},
        np.ones(2),
        np.random.default_rng(0),
    )
    ways = result["contenders"]
    assert result["role"] == "validate"
    assert ways["one_shot"]["overall"] > 5 * ways["hierarchical"]["overall"]
    assert ways["hierarchical"]["errors"] == ways["one_shot_with_unloaded"]["errors"]
    assert result["against"]["one_shot"]["ci95_percent"][1] < -50
    assert result["against"]["one_shot_with_unloaded"]["change_percent"] == 0.0
    assert "smaller than that of the one-shot" in result["said"]
    assert "what helps is the unloaded recordings, not fitting in two stages" in result["said"]
    assert [entry["name"] for entry in result["apart"]] == [design.parameters.names[11]]


def test_relative_deviations_are_counted_and_compared() -> None:
    session = clean_session(2)
    theta = np.ones(len(session.plain.design.parameters))
    result = compare(
        session.plain.design,
        {"hierarchical": contender(theta, 0.2), "one_shot": contender(theta, 0.4)},
        np.ones(2),
        np.random.default_rng(0),
    )
    assert result["deviation_ratio"] == pytest.approx(0.5)
    assert result["contenders"]["hierarchical"]["flagged"] == 0
    assert result["contenders"]["one_shot"]["flagged"] == len(theta)


def test_without_a_validation_motion_the_errors_are_of_the_fitted_one() -> None:
    machine, arm = planar_machine(2), truth(2)
    design = exact_design(machine, arm, (("unloaded", 1), ("train", 2)))
    theta = arm.theta(machine)
    result = compare(
        design,
        {"hierarchical": contender(0.9 * theta), "one_shot": contender(0.9 * theta)},
        np.ones(2),
        np.random.default_rng(0),
    )
    assert result["role"] == "train" and "on the motion that was fitted" in result["said"]


def test_each_cylinders_condition_is_that_of_its_own_columns() -> None:
    machine, arm = planar_machine(2), truth(2)
    design = exact_design(machine, arm)
    index = design.indices("unloaded")[0]
    own = design.blocks[1][index].reduced[:, design.parameters.drive_slice(1)]
    conditions = cylinder_conditions(design)
    assert set(conditions) == {"joint1", "joint2"}
    assert conditions["joint2"] == pytest.approx(condition_number(own))


def test_the_hierarchy_is_as_badly_conditioned_as_its_worst_part() -> None:
    assert stage_condition({"joint1": 3.0, "joint2": 40.0}, 12.0) == 40.0
    assert stage_condition({}, 12.0) == 12.0


def outcome(one_shot: list[float], unloaded: list[float] | None = None, **conditions: float) -> dict[str, Any]:
    """A comparison with these intervals in per cent."""
    numbers = {"hierarchical": 5.0, "one_shot": 9.0, **conditions}
    against = {"one_shot": {"change_percent": float(np.mean(one_shot)), "ci95_percent": one_shot}}
    if unloaded is not None:
        against["one_shot_with_unloaded"] = {"change_percent": float(np.mean(unloaded)), "ci95_percent": unloaded}
    contenders = {name: {"condition_number": number} for name, number in numbers.items()}
    return {"contenders": contenders, "against": against, "role": "validate"}


@pytest.mark.parametrize(
    ("result", "says"),
    [
        (outcome([-9.0, -4.0]), "smaller than that of the one-shot regression"),
        (outcome([4.0, 9.0]), "larger than that of the one-shot regression"),
        (outcome([-1.0, 1.0]), "the same within its uncertainty as that of the one-shot regression"),
        (outcome([-9.0, -4.0], [-5.0, -2.0]), "two-stage fitting is better here"),
        (outcome([-9.0, -4.0], [2.0, 5.0]), "two-stage fitting costs accuracy here"),
        (outcome([-1.0, 1.0], [-1.0, 1.0]), "two-stage fitting makes no difference here"),
        (outcome([-1.0, 1.0], hierarchical=20.0), "worse conditioned"),
        (outcome([-1.0, 1.0], hierarchical=2.0), "better conditioned"),
    ],
)
def test_the_words_follow_the_numbers(result: dict[str, Any], says: str) -> None:
    assert says in in_words(result)


def test_where_there_is_nothing_to_compare_it_says_so() -> None:
    result = outcome([0.0, 0.0])
    result["against"]["one_shot"] = {"change_percent": None, "ci95_percent": None}
    assert in_words(result).endswith("There is no error to compare.")
