"""Noise of the rows that show an effect: against what simulated noise of known variance makes of a gain."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy import signal

from fitting.regression.solving import WhiteRows
from fitting.residual.confirmation.robustness import Leftover

ROWS = 4000


def rows_with(noise: np.ndarray, candidate: np.ndarray, size: float = 1.0) -> list[WhiteRows]:
    """Two joints of two segments each; the base is a constant and a slow wave."""
    half = len(candidate) // 2
    sections = ((0, np.ones(half, dtype=bool)), (1, np.ones(len(candidate) - half, dtype=bool)))
    base = np.column_stack([np.ones(len(candidate)), np.sin(np.arange(len(candidate)) / 300)])
    shown = WhiteRows(np.column_stack([base, candidate]), size * candidate + noise, sections)
    other = np.random.default_rng(5).standard_normal(len(candidate))
    unseen = WhiteRows(np.column_stack([base, np.zeros(len(candidate))]), other, sections)
    return [shown, unseen]


def found(rows: list[WhiteRows]) -> float:
    """Inflation of the last column, with what a fit of all columns leaves."""
    A, b = np.vstack([r.A for r in rows]), np.concatenate([r.b for r in rows])
    ends = np.cumsum([len(r.b) for r in rows])[:-1]
    less, left = (np.split(b - C @ np.linalg.lstsq(C, b, rcond=None)[0], ends) for C in (A[:, :-1], A))
    edges = [np.cumsum([0, *(len(kept) for _, kept in r.sections)]).tolist() for r in rows]
    sections = {joint: [slice(*pair) for pair in pairwise(own)] for joint, own in enumerate(edges)}
    shown = {joint: first - second for joint, (first, second) in enumerate(zip(less, left, strict=True))}
    return Leftover(dict(enumerate(left)), sections).inflation(shown)


def test_noise_as_the_model_says_inflates_nothing() -> None:
    rng = np.random.default_rng(1)
    seen = [
        found(rows_with(rng.standard_normal(ROWS), rng.standard_normal(ROWS), size))
        for size in (0.0, 0.1, 10.0)
        for _ in range(10)
    ]
    # The variance of 8000 squares is known to some four per cent, and the larger of three numbers is taken.
    assert min(seen) >= 1.0 and max(seen) < 1.3


@pytest.mark.slow
def test_few_rows_tell_little_of_their_noise() -> None:
    """Ten rows see any variance by chance; of a gain that is there a twentieth at most is lost by it."""
    rng = np.random.default_rng(7)
    few = np.arange(ROWS) % 400 == 7
    kept = [1.0 / found(rows_with(rng.standard_normal(ROWS), few * rng.standard_normal(ROWS), 5.0)) for _ in range(60)]
    assert np.mean(kept) > 0.95


def test_rows_that_are_noisier_where_the_effect_acts_count_for_less() -> None:
    """Half of the rows have nine times the variance, and the effect acts on those only."""
    rng = np.random.default_rng(2)
    noisy = np.arange(ROWS) % 100 < 50
    noise = rng.standard_normal(ROWS) * np.where(noisy, 3.0, 1.0)
    assert found(rows_with(noise, np.where(noisy, rng.standard_normal(ROWS), 0.0))) == pytest.approx(9.0, rel=0.15)
    assert found(rows_with(noise, np.where(noisy, 0.0, rng.standard_normal(ROWS)))) < 1.2


def test_noise_that_hangs_together_counts_for_a_slow_effect() -> None:
    """First-order noise of unit variance, correlation 0.6 from row to row: four times the power at low frequencies."""
    rng = np.random.default_rng(3)
    noise = signal.lfilter([np.sqrt(1 - 0.6**2)], [1.0, -0.6], rng.standard_normal(ROWS))
    slow = np.sin(np.arange(ROWS) / 70)
    assert found(rows_with(noise, slow)) == pytest.approx(4.0, rel=0.35)
    assert found(rows_with(noise, np.where(np.arange(ROWS) % 2, 1.0, -1.0))) < 1.2, "power is low up there"


@pytest.mark.slow
def test_false_gains_against_their_own_noise_are_those_of_chance() -> None:
    """Of 300 useless columns on uneven noise, one in a hundred passes a threshold of one in a hundred; not ten."""
    rng = np.random.default_rng(4)
    noisy = np.arange(600) % 60 < 10
    gains, robust = [], []
    for _ in range(300):
        candidate = rng.standard_normal(600) * noisy
        rows = rows_with(rng.standard_normal(600) * np.where(noisy, 3.0, 1.0), candidate, 0.0)
        own = rows[0]
        left = candidate - own.A[:, :2] @ np.linalg.lstsq(own.A[:, :2], candidate, rcond=None)[0]
        gains.append((left @ own.b) ** 2 / (left @ left))
        robust.append(gains[-1] / found(rows))
    threshold = 6.63
    assert np.mean(np.array(gains) > threshold) > 0.2
    assert np.mean(np.array(robust) > threshold) < 0.03


def test_a_column_that_the_base_holds_shows_nothing() -> None:
    rng = np.random.default_rng(6)
    assert found(rows_with(rng.standard_normal(ROWS), np.ones(ROWS), 0.0)[:1]) == 1.0
