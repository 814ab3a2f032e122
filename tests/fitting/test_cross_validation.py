"""Block cross-validation: against explicit refits, and on noise that a candidate can only fit by chance."""

from __future__ import annotations

import numpy as np
import pytest

from fitting.regression.solving import WhiteRows
from fitting.residual.confirmation.cross_validation import BLOCK_SECONDS, FOLDS, GUARD_SECONDS, held_out_gain

RATE = 8.0


def rows_of(seed: int, size: float, joints: int = 2, length: int = 700) -> list[WhiteRows]:
    """Two base columns and one candidate column of ``size`` standard deviations per row."""
    rng = np.random.default_rng(seed)
    rows = []
    for _ in range(joints):
        A = rng.standard_normal((length, 3))
        b = A @ np.array([3.0, -2.0, size]) + rng.standard_normal(length)
        half = length // 2
        sections = ((0, np.ones(half, dtype=bool)), (1, np.ones(length - half, dtype=bool)))
        rows.append(WhiteRows(A, b, sections))
    return rows


def test_gain_equals_explicit_refits_without_each_fold() -> None:
    rows = rows_of(1, 0.3, joints=1)
    A, b = rows[0].A, rows[0].b
    length, guard = round(BLOCK_SECONDS * RATE), round(GUARD_SECONDS * RATE)
    half = len(b) // 2
    place = np.concatenate([np.arange(half), np.arange(len(b) - half)])
    segment = np.repeat([0, 1], [half, len(b) - half])
    # Block numbers run on with one left free between segments, as the module says.
    block = place // length + segment * (half // length + 2)
    total = 0.0
    for fold in range(FOLDS):
        test = block % FOLDS == fold
        if not test.any():
            continue
        close = np.zeros(len(b), dtype=bool)
        for row in np.flatnonzero(test):
            same = segment == segment[row]
            close |= same & (np.abs(place - place[row]) <= guard)
        train = ~close
        errors = [
            np.sum((b[test] - A[test, :k] @ np.linalg.lstsq(A[train, :k], b[train], rcond=None)[0]) ** 2)
            for k in (2, 3)
        ]
        total += errors[0] - errors[1]
    assert held_out_gain(rows, 1, RATE).gain == pytest.approx(total, rel=1e-6)


def test_a_real_term_holds_and_gains_what_it_is_worth() -> None:
    found = held_out_gain(rows_of(2, 0.3), 1, RATE)
    # 1400 rows of 0.3 standard deviations: a chi-square of 126, give or take twice its root.
    assert found.gain == pytest.approx(126.0, abs=3 * 2 * np.sqrt(126.0))
    assert found.z > 4


def test_what_fits_by_chance_does_not_hold() -> None:
    gains = [held_out_gain(rows_of(seed, 0.0), 1, RATE).gain for seed in range(40)]
    # Out of sample one useless parameter costs about as much as it gains in sample: one.
    assert np.mean(gains) < 0
    assert max(gains) < 14


def rows_with_an_edge(seed: int, edge: float, strays: float) -> list[WhiteRows]:
    """A candidate of two columns: one shown everywhere, one by a few rows of one block, and hardly by any other."""
    rng = np.random.default_rng(seed)
    length, half = 1000, 500
    edges = np.zeros(length)
    edges[205:215] = 1.0
    edges[800] = strays
    A = np.column_stack([rng.standard_normal((length, 2)), edges])
    b = A @ np.array([3.0, 0.5, edge]) + rng.standard_normal(length)
    sections = ((0, np.ones(half, dtype=bool)), (1, np.ones(length - half, dtype=bool)))
    return [WhiteRows(A, b, sections)]


def test_what_one_block_shows_is_as_large_without_it_as_was_expected() -> None:
    precision = np.diag([1.0, 1.0 / 3.0**2])
    losses = []
    for seed in range(20):
        rows = rows_with_an_edge(seed, edge=3.0, strays=0.02)
        expected = held_out_gain(rows, 2, RATE, precision)
        losses.append(expected.gain - held_out_gain(rows, 2, RATE).gain)
        assert expected.gain > 100 and expected.z > 3.0
    assert np.median(losses) > 100, "a coefficient that a fold knows next to nothing of is anything"


def test_a_prior_that_says_nothing_changes_nothing() -> None:
    rows = rows_of(3, 0.2)
    assert held_out_gain(rows, 1, RATE, np.zeros((1, 1))) == held_out_gain(rows, 1, RATE)


def test_a_column_that_no_row_shows_does_nothing() -> None:
    rows = rows_of(4, 0.3)
    shown = held_out_gain(rows, 1, RATE, np.eye(1))
    wider = [WhiteRows(np.column_stack([r.A, np.zeros(len(r.b))]), r.b, r.sections) for r in rows]
    assert held_out_gain(wider, 2, RATE, np.eye(2)).gain == pytest.approx(shown.gain)
