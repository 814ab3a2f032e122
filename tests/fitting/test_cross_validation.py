"""Block cross-validation: against explicit refits, and on noise that a candidate can only fit by chance."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from fitting.regression.solving import WhiteRows
from fitting.residual.confirmation.cross_validation import (
    BLOCK_SECONDS,
    CONFIRMED,
    FOLDS,
    GUARD_SECONDS,
    HeldOut,
    held_out_gain,
)

RATE = 8.0


def gain_of(rows: list[WhiteRows], candidate: int, precision: np.ndarray | None = None) -> HeldOut:
    """What left-out blocks say of the last columns, beside the same model without them."""
    before = [WhiteRows(r.A[:, :-candidate], r.b, r.sections) for r in rows]
    if precision is None:
        return held_out_gain(before, rows, RATE)
    known = np.zeros((candidate, rows[0].A.shape[1]))
    known[:, -candidate:] = np.linalg.cholesky(precision).T
    return held_out_gain(before, [*rows, WhiteRows(known, np.zeros(candidate), ())], RATE, True)


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


def test_gain_is_the_log_density_of_what_was_left_out_with_all_that_is_not_known() -> None:
    """Against the normal density of a library, with the covariance of noise and parameters written out."""
    rows = rows_of(1, 0.3, joints=1)
    A, b = rows[0].A, rows[0].b
    length, guard = round(BLOCK_SECONDS * RATE), round(GUARD_SECONDS * RATE)
    half = len(b) // 2
    place = np.concatenate([np.arange(half), np.arange(len(b) - half)])
    segment = np.repeat([0, 1], [half, len(b) - half])
    # Block numbers run on with one left free between segments, as the module says.
    block = place // length + segment * (half // length + 2)
    expected = 1.0 / 0.3**2

    def density(train: np.ndarray, test: np.ndarray, columns: int) -> float:
        gram = A[train, :columns].T @ A[train, :columns]
        gram[2:, 2:] += expected
        covariance = np.linalg.inv(gram)
        theta = covariance @ A[train, :columns].T @ b[train]
        own = A[test, :columns]
        return float(
            stats.multivariate_normal(own @ theta, np.eye(len(own)) + own @ covariance @ own.T).logpdf(b[test])
        )

    gains = []
    for fold in range(FOLDS):
        test = block % FOLDS == fold
        if not test.any():
            continue
        close = np.zeros(len(b), dtype=bool)
        for row in np.flatnonzero(test):
            same = segment == segment[row]
            close |= same & (np.abs(place - place[row]) <= guard)
        train = ~close
        gains.append(2.0 * (density(train, test, 3) - density(train, test, 2)))
    found = gain_of(rows, 1, np.array([[expected]]))
    assert found.gain == pytest.approx(sum(gains), rel=1e-6)
    assert found.alike == pytest.approx(sum(gains) - max(gains), rel=1e-6)


def test_a_real_term_holds_and_gains_what_it_is_worth() -> None:
    found = gain_of(rows_of(2, 0.3), 1)
    # 1400 rows of 0.3 standard deviations: a chi-square of 126, give or take twice its root.
    assert found.gain == pytest.approx(126.0, abs=3 * 2 * np.sqrt(126.0))
    assert found.z > 4


def test_what_fits_by_chance_does_not_hold() -> None:
    gains = [gain_of(rows_of(seed, 0.0), 1).confirmed for seed in range(40)]
    # Odds of 19 to 1 come up by chance once in 19 times at most; a useless parameter costs on average.
    assert np.mean(gains) < 0
    assert sum(gain > CONFIRMED for gain in gains) <= 2


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


def test_what_one_block_shows_only_is_not_confirmed_by_the_others() -> None:
    """A coefficient of which the other blocks know next to nothing neither ruins a gain nor makes one."""
    for seed in range(20):
        rows = rows_with_an_edge(seed, edge=8.0, strays=0.02)
        both = gain_of(rows, 2, np.diag([1.0, 1.0 / 8.0**2]))
        assert both.gain > 100 and both.alike > CONFIRMED, "its other column is shown everywhere"
        alone = [WhiteRows(np.delete(r.A, 1, axis=1), r.b - 0.5 * r.A[:, 1], r.sections) for r in rows]
        only = gain_of(alone, 1)
        assert only.gain > CONFIRMED and abs(only.alike) < 3.0 and not only.confirmed > CONFIRMED


def test_a_column_that_no_row_shows_does_nothing() -> None:
    rows = rows_of(4, 0.3)
    shown = gain_of(rows, 1, np.eye(1))
    wider = [WhiteRows(np.column_stack([r.A, np.zeros(len(r.b))]), r.b, r.sections) for r in rows]
    assert gain_of(wider, 2, np.eye(2)).gain == pytest.approx(shown.gain)


def test_what_only_takes_the_place_of_a_parameter_gains_nothing() -> None:
    """A curve that holds the sign of speed puts the base's friction to zero; beside the base it wins nothing."""
    base = rows_of(5, 0.0)
    before = [WhiteRows(r.A[:, :2], r.b, r.sections) for r in base]
    instead = [WhiteRows(np.column_stack([r.A[:, 0], 0.0 * r.A[:, 1], r.A[:, 1]]), r.b, r.sections) for r in base]
    assert gain_of(instead, 1).gain > 1000
    assert held_out_gain(before, instead, RATE).gain == pytest.approx(0.0, abs=1.0)
