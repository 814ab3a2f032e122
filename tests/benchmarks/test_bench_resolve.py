"""`hilfit bench resolve`: which cases it looks at, what it counts, and the motions that the plant makes for it."""

from __future__ import annotations

from itertools import islice
from typing import Any

import numpy as np
import pytest

from benchmarks.attribution import resolving
from benchmarks.attribution.making import BenchCase, TrueEffect
from benchmarks.attribution.recipe import INSIDE, CaseKey, Selection, opened
from daq.motion_files import Motion
from fitting.loop.closing import Asked


def line(result: str, surplus: int = 0, there: bool = True) -> dict[str, Any]:
    return {
        "case": "large:1",
        "truth": [{"id": "stribeck", "reported": "joint1", "seen": 12.0}],
        "before": [{"terms": [["stribeck", "joint1"]], "probability": 0.7}, {"terms": [], "probability": 0.2}],
        "motions": [{"text": "a staircase", "chance": 0.5}],
        "after": [{"terms": [["stribeck", "joint1"]], "probability": 0.97}],
        "result": result,
        "surplus": surplus,
        "true_in_set": there,
        "anyway": None,
        "seconds": 12.3,
    }


def test_only_the_right_name_alone_counts() -> None:
    lines = [line("right"), line("right", surplus=1), line("in set"), line("wrong", there=False)]
    shares = {check.name: check.measured for check in resolving.checks(lines, looked_at=8)}
    assert shares["ambiguous, of the cases looked at"] == 0.5
    assert shares["end in the single right name"] == 0.25
    assert shares["the same, where the first set holds it"] == pytest.approx(1 / 3)
    assert shares["end in a wrong name alone"] == 0.25


def test_sets_that_no_motion_closes_are_counted_apart() -> None:
    no_motion = line("in set") | {"motions": []}
    lines = [line("right"), no_motion | {"anyway": False}]
    shares = {check.name: check.measured for check in resolving.checks(lines, looked_at=2)}
    assert shares["said to be closable"] == 0.5
    assert shares["of those, end in the single right name"] == 1.0
    assert shares["closable or not, as the best motion then showed"] == 1.0
    lines.append(no_motion | {"anyway": True})
    shares = {check.name: check.measured for check in resolving.checks(lines, looked_at=3)}
    assert shares["closable or not, as the best motion then showed"] == pytest.approx(2 / 3)


def test_a_case_is_printed_in_one_line() -> None:
    assert resolving.text(line("right")) == (
        "large:1    stribeck@joint1 (12.0): stribeck 70 %, nothing 20 % -> [a staircase] -> stribeck 97 %: right, 12 s"
    )


def test_every_effect_and_class_comes_once_before_the_next_case_number() -> None:
    count = len(resolving.ALIKE) * len(resolving.CLASSES)
    first = list(islice(resolving.keys(5), count + 1))
    assert len(set(first)) == count + 1
    assert {key.number for key, _ in first[:-1]} == {0}
    assert first[-1][0].number == 1
    assert {effect for _, effect in first} == set(resolving.ALIKE) <= set(INSIDE)


def test_the_plant_follows_the_motion_that_is_asked_for() -> None:
    pytest.importorskip("mujoco")
    key, selection = CaseKey("large", 0, 5), Selection(only="stribeck", seconds=20.0)
    _, plan, quality = opened(key, selection)
    joint = plan.machine.joints[1]
    effects = (TrueEffect("stribeck", joint.name, 50.0, 12.0, joint.name),)
    case = BenchCase(key, plan.machine, {}, plan.truth, quality, effects, ())
    time = np.arange(501) / 50.0
    low, high = joint.limits.position
    course = (low + high) / 2 + 0.1 * (high - low) * np.sin(np.pi * time / 10.0) ** 4
    motion = Motion(plan.machine.name, "pinned", time, {joint.name: course})
    asked = Asked(motion, "a swing", ("stribeck", "quadratic_loss"), 0.5)
    recorder = resolving.PlantRecorder(case, selection)
    recording, again = recorder(asked, 1), recorder(asked, 1)
    assert recording.role == "train"
    angle = recording.values[f"{joint.name}.angle"]
    np.testing.assert_allclose(angle, course[: len(angle)], atol=0.01)
    head = f"{joint.name}.head_pressure"
    np.testing.assert_array_equal(recording.values[head], again.values[head])
    assert not np.array_equal(recording.values[head], recorder(asked, 2).values[head])
