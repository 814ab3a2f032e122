"""Numbers of the report and of the page: one table of what is written, to which both are held."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fitting.report import text

TABLE = Path(__file__).parents[2] / "server" / "web" / "src" / "ui" / "numbers.json"
WRITES = {
    "number": text.number,
    "fixed": text.fixed,
    "withStd": text.with_std,
    "share": text.share,
    "change": text.percent,
}


@pytest.mark.parametrize("name", WRITES)
def test_the_report_writes_what_the_table_says(name: str) -> None:
    """The page's own test is ``server/web/src/ui/format.test.ts``."""
    rows: list[tuple[str, list[Any], str]] = json.loads(TABLE.read_text("utf-8"))
    own = [(values, said) for function, values, said in rows if function == name]
    assert len(own) > 40
    assert [WRITES[name](*values) for values, _ in own] == [said for _, said in own]


@given(st.floats(1e-4, 9e5) | st.floats(-9e5, -1e-4), st.integers(1, 8))
def test_a_number_has_the_digits_that_were_asked_for_and_is_the_nearest(value: float, digits: int) -> None:
    said = text.number(value, digits).replace("\u2212", "-").replace("\u202f", "")
    step = 10.0 ** (math.floor(math.log10(abs(value))) - digits + 1)
    assert abs(float(said) - value) <= 0.5000001 * step
    assert said.startswith("-") == (value < 0)


def test_halves_are_rounded_away_from_zero_as_browsers_do() -> None:
    assert [text.fixed(value, 0) for value in (0.5, 1.5, 2.5, -2.5)] == ["1", "2", "3", "\u22123"]
    assert (text.number(0.125, 2), text.with_std(2.5, 10.0), text.fixed(250.0, -2)) == ("0.13", "3 \u00b1 10", "300")
