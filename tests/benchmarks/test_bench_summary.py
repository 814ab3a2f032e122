"""Intervals, targets, theory, and the comparison of two runs."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import binom

from benchmarks.attribution import summary
from benchmarks.targets import Check, clopper_pearson, lines_of, missed, rate


@settings(deadline=None)
@given(st.integers(1, 400), st.data())
def test_the_interval_of_a_share_holds_its_definition(of: int, data: st.DataObject) -> None:
    count = data.draw(st.integers(0, of))
    low, high = clopper_pearson(count, of)
    assert 0 <= low <= count / of <= high <= 1
    # At the ends of the interval the count, or a more extreme one, has a chance of 2.5 %.
    if count > 0:
        assert binom.sf(count - 1, of, low) == pytest.approx(0.025, rel=1e-6)
    if count < of:
        assert binom.cdf(count, of, high) == pytest.approx(0.025, rel=1e-6)


def test_no_accusation_in_a_hundred_does_not_prove_one_per_cent() -> None:
    assert clopper_pearson(0, 100)[1] == pytest.approx(0.0362, abs=1e-4)


def test_targets_are_printed_beside_what_was_measured() -> None:
    checks = [
        rate("accused", 2, 100, "at most", 0.01),
        rate("found", 97, 100, "at least", 0.97),
        Check("shown only", 1.0, "1 s"),
        Check("not measured", None, "no peer", "at most", 1.0, "1"),
    ]
    assert [check.met for check in checks] == [False, True, None, None]
    assert missed(checks) == 1
    first, second, third, _ = lines_of(checks)
    assert first.startswith("MISSED accused") and first.endswith("(2 of 100; 0.2 to 7.0 %), at most 1 %")
    assert second.startswith("ok ") and third.startswith("    ")


def test_theory_is_the_level_at_nothing_and_a_half_at_the_threshold() -> None:
    assert summary.seen_by_theory(0.0) == pytest.approx(summary.FALSE_ALARMS / summary.LOOKS, rel=1e-6)
    assert summary.seen_by_theory(summary.threshold() ** 0.5) == pytest.approx(0.5, abs=1e-3)
    assert summary.seen_by_theory(4.0) < summary.seen_by_theory(6.0) < summary.seen_by_theory(10.0)
    assert summary.seen_by_theory(10.0) > 0.999


def line(kind: str, number: int, result: str, seen: float = 12.0, **more: Any) -> dict[str, Any]:
    effect = {"id": "stribeck", "joint": "joint2", "reported": "joint2", "variables": [], "seen": seen}
    said = {"sets": [[["stribeck", "joint2"]]] if result == "right" and kind != "null" else [], "laws": []}
    content = {
        "kind": kind, "number": number, "seed": 0, "result": result, "arm": "folding-arm", "said": said,
        "effects": [] if kind == "null" else [effect], "redrawn": [], "wrong_alone": [], "surplus": 0, "widest": 1,
        "located": result == "right", "seconds": 2.0,
    }  # fmt: skip
    return content | more


def named(checks: list[Check]) -> dict[str, Check]:
    return {check.name: check for check in checks}


def test_rates_count_what_their_names_say() -> None:
    lines = [
        line("null", 0, "right"),
        line("null", 1, "accused", wrong_alone=[["stribeck", "joint1"]]),
        line("large", 0, "right"),
        line("kinematic", 0, "in set"),
        line("medium", 0, "silent"),
        line("medium", 1, "wrong", wrong_alone=[["gas_spring", "joint2"]]),
        line("outside", 0, "wrong"),
        line("pairs", 0, "partly", surplus=1),
    ]
    found = named(summary.checks(lines))
    assert found["no effect: accused"].measured == 0.5
    assert found["a wrong name alone"].measured == 2 / 8
    assert found["large: right or in the set"].measured == 1.0
    assert found["kinematic: right or in the set, no surplus"].measured == 1.0
    assert found["medium: right or in the set"].measured == 0.0
    assert found["medium: named, but wrong"].measured == 0.5
    assert found["outside: a catalogue name, likely"].met is False
    assert found["pairs: both right or in sets"].measured == 0.0
    assert found["surplus effects where one was found"].measured == 1 / 6
    assert "small: right or in the set" not in found  # there was none


def test_a_fit_that_fails_is_counted_against_it() -> None:
    lines = [line("null", 0, "right"), line("null", 1, "error", said=None), line("large", 0, "error", said=None)]
    found = named(summary.checks(lines))
    assert found["fit failed"].met is False
    assert found["no effect: accused"].measured == 0.5
    assert found["large: right or in the set"].measured == 0.0


def test_a_surplus_name_spoils_a_kinematic_case() -> None:
    found = named(summary.checks([line("kinematic", 0, "right", surplus=1), line("kinematic", 1, "right")]))
    assert found["kinematic: right or in the set, no surplus"].measured == 0.5


def test_a_name_outside_the_catalogue_counts_where_it_is_likely() -> None:
    said = {"sets": [[["stribeck", "joint2"]]], "laws": [], "stated": [[["stribeck", "joint2", 0.4]]]}
    unsure = line("outside", 0, "wrong", said=said)
    sure = line("outside", 1, "wrong", said={**said, "stated": [[["stribeck", "joint2", 0.6]]]})
    assert named(summary.checks([unsure, sure]))["outside: a catalogue name, likely"].measured == 0.5


def test_a_series_of_the_right_variable_at_the_right_joint_is_counted_by_itself() -> None:
    effects = [{"id": "dented_rod", "joint": "joint2", "reported": "joint2", "variables": ["piston_position"]}]
    names = [
        ("position_dependent_friction", "joint2"),
        ("position_dependent_friction", "joint1"),
        ("stribeck", "joint2"),
    ]
    cases = []
    for number, name in enumerate(names):
        said = {"sets": [[name]], "laws": [], "stated": [[[*name, 0.9]]]}
        cases.append(line("outside", number, "wrong", said=said, effects=effects))
    found = named(summary.checks(cases))
    series = found["outside: the name is a series of the right variable at the right joint"]
    assert series.measured == pytest.approx(1 / 3) and series.met is None
    assert found["outside: a catalogue name, likely"].measured == 1.0, "it counts as a name all the same"


def test_the_time_of_a_case_has_targets_with_and_without_the_bootstrap() -> None:
    lines = [line("null", 0, "right", seconds=7.0, bootstrap=18), line("null", 1, "right", seconds=4.0, bootstrap=0)]
    found = named(summary.checks(lines))
    tail = "CPU seconds a case {} bootstrap, 95th percentile"
    assert (found[tail.format("with")].measured, found[tail.format("with")].met) == (7.0, True)
    assert (found[tail.format("without")].measured, found[tail.format("without")].met) == (4.0, True)
    slow = named(summary.checks([line("null", 0, "right", seconds=8.1, bootstrap=0)]))
    assert slow[tail.format("without")].met is False


def test_coverage_counts_intervals_by_kind() -> None:
    values = {"joint1.f_c": [1.0, 0.1, 1.1], "joint2.f_c": [1.0, 0.1, 1.3], "ZZ2": [5.0, 1.0, 4.0], "MX1": [0, 1, 1]}
    found = named(summary.coverage([line("null", 0, "right", parameters=values)]))
    assert found["95 % intervals that hold the truth: f_c"].measured == 0.5
    assert found["95 % intervals that hold the truth: inertia"].measured == 1.0
    assert found["95 % intervals that hold the truth: first moment"].measured == 1.0
    assert found["95 % intervals that hold the truth: all"].measured == 0.75


def test_found_against_size_puts_cases_into_bins() -> None:
    lines = [line("small", 0, "silent", 4.5), line("small", 1, "right", 4.6), line("large", 0, "right", 25.0)]
    low, high = summary.found_against_size(lines)
    assert (low["low"], low["cases"], low["named"]) == (4.0, 2, 1)
    assert (high["low"], high["cases"], high["theory"]) == (20.0, 1, pytest.approx(1.0))


def test_comparison_names_the_cases_that_changed() -> None:
    old = [line("large", 0, "right"), line("large", 1, "silent"), line("null", 0, "right")]
    new = [line("large", 0, "right"), line("large", 1, "right"), line("null", 7, "right")]
    rows = summary.compared(old, new)
    assert rows[0] == "compared on 2 cases; 1 say something else than before"
    assert any("large:1" in row for row in rows) and not any("large:0" in row for row in rows)
    assert rows[-1].strip() == "1 large: silent -> right"
    other = [one | {"recipe": 4} for one in new]  # another recipe's cases of the same keys are other cases
    assert summary.compared(old, other)[0] == "compared on 0 cases; 0 say something else than before"


def test_everything_is_printed_for_people() -> None:
    lines = [line("null", 0, "accused", wrong_alone=[["stribeck", "joint1"]]), line("large", 0, "right")]
    printed = "\n".join(summary.text(lines))
    assert "accusations and failures" in printed and "null:0" in printed and "found against lambda" in printed
