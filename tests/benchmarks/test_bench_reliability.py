"""Stated probabilities beside what is true."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from benchmarks.attribution import summary


def line(kind: str, effects: list[dict[str, Any]], **said: Any) -> dict[str, Any]:
    return {"kind": kind, "effects": effects, "said": {"sets": [], "laws": [], **said}}


PLAY = {"id": "backlash", "joint": "joint2", "reported": "joint2", "variables": []}
DENT = {"id": "dented_rod", "joint": "joint1", "reported": "joint1", "variables": ["piston_position"]}


def test_each_effect_of_a_set_counts_as_a_statement_of_its_own() -> None:
    said = [[["backlash", "joint2", 0.6], ["stribeck", "joint2", 0.3]]]
    lines = [line("large", [PLAY], sets=[[["backlash", "joint2"], ["stribeck", "joint2"]]], stated=said)]
    assert summary.statements(lines) == [(0.6, True), (0.3, False)]


def test_a_law_is_right_of_an_effect_that_is_in_no_catalogue_in_its_variable() -> None:
    stated = [[["piston_position", "joint1", 0.9]]]
    laws = [["piston_position", "joint1"]]
    assert summary.statements([line("outside", [DENT], laws=laws, stated=stated)]) == [(0.9, True)]
    elsewhere = [[["piston_speed", "joint1", 0.9]]]
    assert summary.statements([line("outside", [DENT], laws=laws, stated=elsewhere)]) == [(0.9, False)]
    known = {**DENT, "id": "position_friction"}
    assert summary.statements([line("large", [known], laws=laws, stated=stated)]) == [(0.9, False)]


def test_no_finding_counts_as_a_statement_that_nothing_is_missing() -> None:
    lines = [line("null", [], nothing=0.97), line("medium", [PLAY], nothing=0.8)]
    assert summary.statements(lines) == [(0.97, True), (0.8, False)]


def test_verdicts_without_probabilities_are_taken_at_their_word() -> None:
    lines = [line("large", [PLAY], sets=[[["stribeck", "joint2"], ["backlash", "joint2"]]]), line("null", [])]
    assert summary.statements(lines) == [(1.0, False), (1.0, True)]


@pytest.mark.parametrize(("share", "calibrated"), [(1.0, True), (0.5, False)])
def test_probabilities_that_are_frequencies_have_no_calibration_error(share: float, calibrated: bool) -> None:
    """Statements that are right with the chance they say; and with half of it."""
    rng = np.random.default_rng(1)
    stated = rng.uniform(0.05, 1.0, 20_000)
    said = list(zip(stated.tolist(), (rng.uniform(size=len(stated)) < share * stated).tolist(), strict=True))
    assert (summary.calibration_error(said) < 0.02) == calibrated
    # Brier: of calibrated statements the mean of p (1 - p).
    expected = float(np.mean(stated * (1 - stated)))
    assert (abs(summary.brier(said) - expected) < 0.01) == calibrated
    assert sum(b.count for b in summary.diagram(said)) == len(said)
    if calibrated:
        assert all(b.low <= b.stated <= b.high for b in summary.diagram(said) if 0.2 < b.stated < 0.8)


def test_few_statements_are_off_by_chance_as_far_as_is_expected() -> None:
    rng = np.random.default_rng(2)
    stated = [*rng.uniform(0.05, 0.95, 150).tolist(), *[1.0] * 50]
    drawn = [[(p, bool(rng.uniform() < p)) for p in stated] for _ in range(300)]
    measured = float(np.mean([summary.calibration_error(own) for own in drawn]))
    assert summary.calibration_error_by_chance(drawn[0]) == pytest.approx(measured, rel=0.1)
