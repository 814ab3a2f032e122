"""Parameters that are poorly determined are marked and listed."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fitting.regression.flags import mark


def content(value: float | None, std: float | None) -> dict[str, Any]:
    """A report with one drive, one base and one effect parameter; the first as given, the others well told."""
    good = {"value": 2.0, "std": 0.1, "unit": "N"}
    return {
        "cylinders": {"joint1": {"parameters": {"K": {"value": value, "std": std, "unit": "N/m"}}}},
        "rigid_body": {"parameters": [{"name": "ZZ1", "expression": "ZZ1 + m1", **good}]},
        "loop": {"effects": [{"id": "stribeck", "joint": "joint1", "parameters": {"f": dict(good)}}]},
        "warnings": [],
    }


@given(st.floats(-1e6, 1e6).filter(lambda v: abs(v) > 1e-6), st.floats(0, 1e6))
def test_thirty_percent_is_the_line(value: float, std: float) -> None:
    report = content(value, std)
    mark(report)
    entry = report["cylinders"]["joint1"]["parameters"]["K"]
    assert entry["relative_std_percent"] == pytest.approx(100 * std / abs(value))
    assert entry["flagged"] == (std > 0 and std / abs(value) > 0.3) == bool(report["flagged"])


def test_what_every_report_has_is_listed_and_no_warning() -> None:
    report = content(1.0, 0.4)
    report["cylinders"]["joint1"]["parameters"] |= {f"p{i}": {"value": 1.0, "std": 1.0 + i} for i in range(8)}
    mark(report)
    assert report["warnings"] == []
    assert len(report["flagged"]) == 9 and {f["kind"] for f in report["flagged"]} == {"drive"}


def test_a_value_of_zero_with_a_deviation_is_hardly_told() -> None:
    report = content(0.0, 1.0)
    mark(report)
    assert report["flagged"] == [{"name": "joint1.K", "kind": "drive", "relative_std_percent": None}]


def test_base_parameters_and_effects_are_looked_at_too() -> None:
    report = content(1.0, 0.01)
    report["rigid_body"]["parameters"][0]["std"] = 3.0
    report["loop"]["effects"][0]["parameters"]["f"]["std"] = 1.0
    report["loop"]["effects"].append(
        {"id": "base_tilt", "joint": None, "parameters": {"t": {"value": 1.0, "std": 9.0}}}
    )
    mark(report)
    assert [(f["kind"], f["name"]) for f in report["flagged"]] == [
        ("base", "ZZ1"),
        ("effect", "joint1.stribeck.f"),
        ("effect", "machine.base_tilt.t"),
    ]


@pytest.mark.parametrize(("value", "std"), [(None, None), (1.0, None), (3.0, 0.0)])
def test_what_was_not_estimated_is_not_flagged(value: float | None, std: float | None) -> None:
    report = content(value, std)
    mark(report)
    assert report["flagged"] == [] and report["warnings"] == []
