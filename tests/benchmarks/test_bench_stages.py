"""``hilfit bench stages``: the truth in the design's order, and what is made of errors and intervals."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.attribution.judging import recordings_of
from benchmarks.attribution.verdicts import truth_vector
from benchmarks.stages import kind_of, parameter_errors, stages
from fitting.loop.session import Session
from sim_backends.plant.cases import simulate_case


@pytest.mark.parametrize(
    ("name", "kind"),
    [("joint1.K", "K"), ("joint3.f_s", "f_s"), ("ZZ1 - 0.855 (m1 + m2)", "base"), ("MY6", "base"), ("m4", "base")],
)
def test_parameters_are_sorted_by_kind(name: str, kind: str) -> None:
    assert kind_of(name) == kind


def test_errors_are_over_those_of_the_joint_refit_of_the_same_arms() -> None:
    errors = {
        ("joint refit", "folding", "joint1.K"): [1.0, -1.0],
        ("joint refit", "folding", "joint2.K"): [2.0, 2.0],
        ("joint refit", "slewing", "joint1.K"): [1.0, 1.0],
        ("one-shot", "folding", "joint1.K"): [3.0, 3.0],
        ("one-shot", "folding", "joint2.K"): [2.0, -2.0],
        ("one-shot", "slewing", "joint1.K"): [0.5, 0.5],
    }
    found = parameter_errors(errors)
    assert found["joint refit", "K"] == 1.0
    assert found["one-shot", "K"] == pytest.approx(1.0)  # the middle of 3, 1 and 0.5


@pytest.mark.slow
@pytest.mark.parametrize("arm", ["folding", "slewing"])
def test_the_truth_stands_where_the_fit_has_its_estimate(arm: str) -> None:
    case = simulate_case(arm, 3, (), seconds=30.0)  # type: ignore[arg-type]
    session = Session(case.machine, recordings_of(case.machine, case.recordings))
    fit = session.base_model.fit
    z = (fit.theta - truth_vector(case.machine, case.truth, session.plain.design)) / fit.std
    # Some fifty to seventy deviations of size one; a misplaced parameter is off by hundreds.
    assert np.sqrt(np.mean(z**2)) < 2.0


@pytest.mark.slow
def test_two_arms_give_every_number() -> None:
    lines: list[str] = []
    outcome = stages(2, 100, ("folding",), show=lines.append)
    assert len(lines) == 2 and all("intervals hold the truth" in line for line in lines)
    names = [check.name for check in outcome.checks]
    assert names[:2] == ["95 % intervals that hold the truth"] * 2
    assert "two stages better conditioned than one-shot" in names and "of base" in names
    assert all(check.measured is not None for check in outcome.checks)
    assert [line.split("  ")[0] for line in outcome.notes[2:]] == [
        "two stages",
        "one-shot",
        "one-shot, unloaded too",
        "joint refit",
    ]
