"""Checks of the samples, the speed and the length of recordings, by example."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from benchmarks import samples, speed
from benchmarks.targets import Check
from sim_backends.plant.cases import simulate_case

JOINTS = ("joint1", "joint2")


def report(verdict: str, effects: list[str], laws: tuple[tuple[str, str], ...] = (), after: float = 1.0) -> Any:
    """A report with these findings; ``"a@joint2|b@joint2"`` is a set, no joint: the machine."""
    found = []
    for text in effects:
        first, *rest = [
            {"id": effect, "joint": joint or None}
            for effect, _, joint in (part.partition("@") for part in text.split("|"))
        ]
        found.append(first | {"indistinguishable_from": rest})
    error = {"noise_floor": 2.0, "before": {"validate": 6.0}, "after": {"validate": 2.0 * after}}
    values = {"f_c": {"value": 103.0}, "K": {"value": 980.0}}
    return {
        "loop": {
            "verdict": verdict,
            "effects": found,
            "unexplained": [{"joint": joint, "variable": variable} for joint, variable in laws],
        },
        "errors": dict.fromkeys(JOINTS, error),
        "cylinders": {joint: {"parameters": values} for joint in JOINTS},
    }


def truth(name: str | None = None, joint: str | None = None, there: bool = True) -> dict[str, Any]:
    effects = [{"name": name, "joint": joint, "size": 1.0}] if there else []
    return {"effects": effects, "cylinders": {j: {"f_c": 100.0, "K": 1000.0} for j in JOINTS}}


def verdicts(case: str, said: Any, true: dict[str, Any]) -> dict[str, bool | None]:
    return {check.name.removeprefix(f"{case}: "): check.met for check in samples.checks(case, said, true)}


def test_nothing_missing_is_judged_by_verdict_floor_and_parameters() -> None:
    found = verdicts("nothing-missing", report("nothing_missing", []), truth(there=False))
    assert found == {
        "validate over noise floor": None,
        "verdict nothing_missing": True,
        "error over noise floor": True,
        "f_c, worst cylinder": True,  # 3 % of 5
        "K, worst cylinder": True,  # 2 % of 3
    }
    accused = report("effect_added", ["stribeck@joint1"], after=1.2)
    found = verdicts("nothing-missing", accused, truth(there=False))
    assert not found["verdict nothing_missing"] and not found["error over noise floor"]


def met(checks: Iterator[Check]) -> list[bool | None]:
    return [check.met for check in checks]


def test_sizes_of_a_delay_and_of_a_tilt_are_those_of_the_truth() -> None:
    late = report("effect_added", ["sensor_latency@joint2"])  # a third of the error is left
    for tau, right in ((1.0005, True), (1.002, False)):
        late["loop"]["effects"][0]["parameters"] = {"tau": {"value": tau}}
        assert met(samples.of_sizes("latency-joint3", late, truth("sensor_latency", "joint2"))) == [right, True]
    tilted = report("effect_added", ["base_tilt"], after=1.6)
    for side, right in ((0.7, True), (0.9, False)):
        tilted["loop"]["effects"][0]["parameters"] = {f"tilt_{n}": {"value": side} for n in (1, 2)}
        assert met(samples.of_sizes("tilted-base", tilted, truth("base_tilt"))) == [right, False]


def test_a_report_is_complete_and_no_joint_worse() -> None:
    said = report("ambiguous", [])
    said["loop"] |= {"candidates": [{"reason": "too small"}], "detection_limits": [{"smallest": 1.0}]}
    said["loop"]["next_experiment"] = {"separates": ["a", "b"]}
    assert met(samples.complete("x", said)) == [True, True, True]
    said["loop"] |= {"candidates": [{"reason": ""}], "next_experiment": {"separates": []}}
    said["errors"] = {"joint1": {"noise_floor": 2.0, "before": {"validate": 6.0}, "after": {"validate": 6.2}}}
    assert met(samples.complete("x", said)) == [False, False, False]


@pytest.mark.parametrize(
    ("case", "said", "right"),
    [
        ("latency-joint3", ["sensor_latency@joint2"], True),
        ("latency-joint3", ["sensor_latency@joint2|stribeck@joint2"], False),  # has to be alone
        ("load-friction-joint2", ["stribeck@joint2|sensor_latency@joint2"], True),
        ("load-friction-joint2", ["stribeck@joint2"], False),
        ("latency-joint3", ["sensor_latency@joint1"], False),
        ("latency-joint3", ["sensor_latency@joint2", "stribeck@joint1"], False),
        ("latency-joint3", [], False),
    ],
)
def test_an_effect_has_to_be_named_at_its_joint(case: str, said: list[str], right: bool) -> None:
    found = verdicts(case, report("effect_added", said), truth("sensor_latency", "joint2"))
    (named,) = [met for name, met in found.items() if name.startswith("named")]
    assert named is right
    assert found["joint2 over its noise floor"] is True


def test_an_effect_of_the_machine_has_no_joint() -> None:
    found = verdicts("tilted-base", report("effect_added", ["base_tilt@"]), truth("base_tilt", "joint2"))
    assert all(met is not False for met in found.values())


@pytest.mark.parametrize(
    ("effects", "laws", "right"),
    [
        ([], (("joint1", "piston_position"),), True),
        ([], (("joint1", "piston_position"), ("joint2", "time")), False),
        ([], (("joint1", "piston_speed"),), False),
        (["position_harmonic@joint1"], (("joint1", "piston_position"),), False),
        ([], (), False),
    ],
)
def test_what_is_in_no_catalogue_is_a_law_of_the_right_variable(
    effects: list[str], laws: tuple[tuple[str, str], ...], right: bool
) -> None:
    found = verdicts("bent-guide-joint1", report("unexplained", effects, laws), truth(None, "joint1"))
    assert [met for name, met in found.items() if "law" in name] == [right]


def test_cost_that_grows_faster_than_the_recording_is_told() -> None:
    even = speed.linear((10, 30, 60), (3 + 1 * 10, 3 + 1 * 30, 3 + 1 * 60))
    square = speed.linear((10, 30, 60), (100, 900, 3600))
    assert isinstance(even, Check) and even.met and even.measured == pytest.approx(1.0)
    assert square.met is False and square.measured == pytest.approx(90 / 40)
    assert speed.linear((10, 60), (3 + 10, 3 + 60)).measured == pytest.approx(60 / 63)


@pytest.mark.slow
def test_long_recordings_have_no_jump_between_their_pieces() -> None:
    case = simulate_case("folding", 2, seconds=20.0)
    table = speed._long(case, 1.0)
    rows = len(case.recordings["train-1"]["time"])
    assert len(table["time"]) == 3 * rows
    assert np.allclose(np.diff(table["time"]), 0.02)
    for joint in case.machine.joints:
        angle = table[f"{joint.name}.angle"]
        steps = np.abs(np.diff(angle))
        for seam in (rows - 1, 2 * rows - 1):
            assert steps[seam] < 0.02 * joint.limits.velocity
