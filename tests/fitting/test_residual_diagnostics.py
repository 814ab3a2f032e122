"""Residual diagnostics against numpy and against signals whose correlations are known."""

from __future__ import annotations

import numpy as np
import pytest

from fitting.report.drawing import draw_diagnostics
from fitting.report.drawing_data import correlation, fit_percent
from fitting.report.html import CONTENTS, with_contents
from fitting.report.model import JointDiagnostics


def test_correlation_is_that_of_numpy_and_sees_a_delay() -> None:
    rng = np.random.default_rng(3)
    early = rng.normal(size=5000)
    late = np.concatenate([np.zeros(7), early[:-7]]) + 0.1 * rng.normal(size=5000)
    found = correlation([late], [early], 20)
    assert np.argmax(found) == 7 and found[7] == pytest.approx(1 / np.sqrt(1.01), rel=0.02)
    assert np.abs(np.delete(found, 7)).max() < 4 / np.sqrt(5000)
    a, b = late - late.mean(), early - early.mean()
    full = np.correlate(a, b, mode="full")[len(a) - 1 :][:20] / (len(a) * a.std() * b.std())
    assert np.allclose(found, full)


def test_correlation_never_reaches_across_two_segments() -> None:
    first, second = np.r_[np.zeros(50), 1.0], np.r_[1.0, np.zeros(50)]
    # Joined, the ends would be neighbours: 1 x 1 at lag 1. Apart they are not.
    apart = correlation([first, second], [first, second], 3)
    joined = correlation([np.r_[first, second]], [np.r_[first, second]], 3)
    assert apart[0] == pytest.approx(1.0) and joined[1] > 0.4 and apart[1] < 0.0


def test_fit_is_a_hundred_for_nothing_left_and_nought_for_the_mean() -> None:
    effort = np.sin(np.arange(1000)) + 5
    assert fit_percent(effort, np.zeros(1000)) == 100.0
    assert fit_percent(effort, effort - effort.mean()) == pytest.approx(0.0)
    assert np.isnan(fit_percent(np.ones(9), np.ones(9)))


def test_the_drawing_says_what_it_is_and_contents_link_to_the_headings() -> None:
    lag = np.arange(20) / 10
    cross = np.arange(-19, 20) / 10
    values = np.ones(20)
    own = JointDiagnostics(
        "boom",
        "N m",
        90.0,
        95.0,
        lag,
        values,
        values,
        values,
        lag,
        0.5**lag,
        cross,
        0 * cross,
        0.1,
        lag,
        values,
        values,
    )
    svg = draw_diagnostics(own, "d")
    assert "boom with itself" in svg and "frequency [Hz]" in svg and "nan" not in svg
    page = with_contents(f"<main>{CONTENTS}<h2>One &amp; two</h2><p>x</p><h2>Three</h2></main>")
    assert '<a href="#part-1">One &amp; two</a>' in page and '<h2 id="part-2">Three</h2>' in page
