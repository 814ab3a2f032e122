"""Whitening: spectra that are known, through the very filter that the rows go through."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy import signal

from fitting.signals.filters import filter_bank
from fitting.signals.spectrum import whitening

BANK = filter_bank(50.0, 3.0)


def first_order(seed: int, seconds: float, memory: float, white: float = 0.0) -> np.ndarray:
    """First-order noise of unit standard deviation and ``memory`` s, and white noise on top."""
    rng = np.random.default_rng(seed)
    phi = np.exp(-1 / (50.0 * memory))
    n = round(50 * seconds)
    drawn = signal.lfilter([np.sqrt(1 - phi**2)], [1.0, -phi], rng.standard_normal(n + 500))[500:]
    return np.asarray(drawn + white * rng.standard_normal(n))


def in_band(noise: np.ndarray, found_on: list[np.ndarray]) -> list[float]:
    """Mean whitened power in four parts of the band; 1 where the whitening is right."""
    model = whitening(found_on, BANK)
    white = model(BANK.reduce(noise))
    frequency, power = signal.periodogram(white, BANK.reduced_rate_hz, scaling="density")
    power = power * BANK.reduced_rate_hz / 2
    edges = (0.02, 0.15, 0.6, 1.5, 2.5)
    return [float(np.mean(power[(frequency >= a) & (frequency < b)])) for a, b in itertools.pairwise(edges)]


@pytest.mark.parametrize("memory", [0.05, 0.2, 0.6, 1.5])
@pytest.mark.parametrize("white", [0.0, 1.0])
def test_a_first_order_noise_is_white_inside_the_band(memory: float, white: float) -> None:
    long = first_order(1, 3000, memory, white)
    # Found on three minutes, judged on fifty: the spectrum has to be right, not just fitted to its own lines.
    levels = in_band(long, [first_order(k, 60, memory, white) for k in (2, 3, 4)])
    assert levels == pytest.approx([1.0] * 4, abs=0.3)


def test_the_standard_deviation_is_that_of_the_filtered_noise() -> None:
    found = whitening([first_order(k, 120, 0.3) for k in range(4)], BANK)
    truth = np.std(BANK.reduce(first_order(9, 3000, 0.3)))
    assert found.std == pytest.approx(truth, rel=0.1)


def test_scaling_the_noise_scales_the_innovation_only() -> None:
    noise = first_order(5, 100, 0.3)
    one, ten = whitening([noise], BANK), whitening([10.0 * noise], BANK)
    assert np.allclose(one.taps, ten.taps, atol=1e-6)
    assert ten.innovation == pytest.approx(10 * one.innovation, rel=1e-6)


def test_nothing_to_whiten_leaves_rows_as_they_are() -> None:
    assert whitening([np.zeros(2000)], BANK).taps.tolist() == [1.0]
    assert whitening([], BANK).taps.tolist() == [1.0]


def test_the_first_rows_are_whitened_too_not_thrown_away() -> None:
    model = whitening([first_order(k, 300, 0.3) for k in range(4)], BANK)
    starts = np.array([model(BANK.reduce(first_order(100 + k, 8, 0.3)))[: len(model.head)] for k in range(300)])
    # Row by row unit variance at most (the filter's roll-off is not blown up), and no correlation between rows.
    assert np.all(starts.var(axis=0) < 1.25) and starts.var() > 0.8
    assert np.max(np.abs(np.corrcoef(starts.T) - np.eye(len(model.head)))) < 0.35


def test_rows_that_lean_on_a_dropped_row_are_dropped() -> None:
    model = whitening([first_order(k, 300, 0.3) for k in range(4)], BANK)
    keep = np.ones(60, dtype=bool)
    keep[20] = False
    order = len(model.taps) - 1
    assert np.flatnonzero(~model.kept(keep)).tolist() == list(range(20, 21 + order))
