"""Axes at round numbers, places inside the panel, and lines that look the same with fewer points."""

from __future__ import annotations

import re

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fitting.report.plot import Axis, Entry, Panel, axis, drawing, legend, text

SIZES = st.floats(min_value=1e-9, max_value=1e9)


@given(st.floats(-1e6, 1e6), SIZES, st.integers(2, 12))
def test_an_axis_holds_its_values_and_is_marked_at_round_numbers(low: float, span: float, marks: int) -> None:
    values = np.array([low, low + span])
    made = axis(values, marks=marks)
    assert made.low <= values[0] and values[1] <= made.high and made.low < made.high
    assert len(made.ticks) <= marks + 1 and len(made.labels) == len(made.ticks)
    if len(made.ticks) > 1:
        step = made.ticks[1] - made.ticks[0]
        shown = step / 10.0 ** np.floor(np.log10(step * 1.001))
        assert np.min(np.abs(shown - np.array([1.0, 2.0, 2.5, 5.0, 10.0]))) < 1e-3 + 1e-9 * abs(low) / step


@pytest.mark.parametrize(
    ("ends", "labels", "factor"),
    [
        ((0.0, 4.3), ("0", "1", "2", "3", "4"), ""),
        ((-0.22, 0.22), ("\u22120.2", "\u22120.1", "0.0", "0.1", "0.2"), ""),
        ((0.0, 1.2), ("0.00", "0.25", "0.50", "0.75", "1.00"), ""),
        ((-10000.0, 10000.0), ("\u221210\u202f000", "\u22125000", "0", "5000", "10\u202f000"), ""),
        ((0.0, 4.3e6), ("0", "1", "2", "3", "4"), "\u00d7\u202f10\u2076"),
        ((0.0, 4.3e-5), ("0", "1", "2", "3", "4"), "\u00d7\u202f10\u207b\u2075"),
    ],
)
def test_labels_have_the_digits_they_need(ends: tuple[float, float], labels: tuple[str, ...], factor: str) -> None:
    made = axis(marks=5, ends=ends)
    assert (made.labels, made.factor) == (labels, factor)


@pytest.mark.parametrize("value", [0.0, 7.0, -3e-7])
def test_one_value_alone_still_gives_an_axis(value: float) -> None:
    made = axis(np.full(4, value), marks=5)
    assert made.low < value < made.high


def panel() -> Panel:
    return Panel(100.0, 50.0, 400.0, 200.0, Axis(0.0, 10.0, (), ()), Axis(-1.0, 1.0, (), ()), "p-1")


def points(svg: str) -> npt.NDArray[np.float64]:
    found = re.search(r'points="([^"]*)"', svg)
    assert found
    return np.array([[float(number) for number in pair.split(",")] for pair in found[1].split()])


def test_values_stand_where_the_axes_say_and_up_is_more() -> None:
    corners = points(panel().line(np.array([0.0, 10.0]), np.array([-1.0, 1.0]), "red"))
    assert corners.tolist() == [[100.0, 250.0], [500.0, 50.0]]


def test_the_outline_of_a_band_is_its_lower_edge_then_its_upper_edge_backwards() -> None:
    x = np.array([0.0, 5.0, 10.0])
    edge = points(panel().band(x, np.full(3, -0.5), np.full(3, 0.5), "red", 0.3))
    assert edge[:, 0].tolist() == [100.0, 300.0, 500.0, 500.0, 300.0, 100.0]
    assert edge[:, 1].tolist() == [100.0] * 3 + [200.0] * 3


def test_a_long_line_keeps_its_ends_and_every_peak() -> None:
    rng = np.random.default_rng(3)
    x = np.linspace(0.0, 10.0, 50_000)
    y = 0.3 * np.sin(3 * x) + 0.01 * rng.standard_normal(len(x))
    y[17_321], y[40_007] = 0.97, -0.93
    drawn = points(panel().line(x, y, "red"))
    assert len(drawn) < 2100
    assert np.all(np.diff(drawn[:, 0]) >= 0)
    assert drawn[0, 0] == 100.0 and drawn[-1, 0] == 500.0
    assert drawn[:, 1].min() == pytest.approx(150.0 - 97.0, abs=0.01)
    assert drawn[:, 1].max() == pytest.approx(150.0 + 93.0, abs=0.01)


def test_the_frame_clips_what_is_inside_to_the_panel() -> None:
    svg = panel().frame(["<inside/>"], title="a < b", x_label="x", y_label="y")
    assert '<clipPath id="p-1"><rect x="100.00" y="50.00" width="400.00" height="200.00"/></clipPath>' in svg
    assert svg.index("url(#p-1)") < svg.index("<inside/>")
    assert "a &lt; b" in svg


def test_texts_are_escaped() -> None:
    evil = "<script>&\"'"
    for svg in (text(0, 0, evil), legend([Entry(evil, "red")], 0, 0), drawing(1, 1, evil, [])):
        assert "<script" not in svg


def test_a_legend_about_a_middle_is_as_far_from_both_sides() -> None:
    entries = [Entry("ten chars.", "red"), Entry("ten chars.", "red", kind="dot"), Entry("ten chars.", "red")]
    starts = [float(found) for found in re.findall(r"M([\d.]+) [\d.]+h24", legend(entries, 0.0, 10.0, centred=345.0))]
    width = 30 + 60 + 16
    assert starts == pytest.approx([345 - 1.5 * width, 345 + 0.5 * width], abs=0.01)
