"""Intervals where the noise had to be estimated: they cover what they say, also on a slow motion."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import signal, stats

from fitting.regression.design import NoiseModel
from fitting.regression.freedom import SIGMAS, coverage_factors, degrees_of_freedom
from fitting.regression.solving import WhiteRows, solve
from fitting.signals.filters import filter_bank
from fitting.signals.spectrum import unit_whitening, whitening

BANK = filter_bank(50.0, 3.0)
SECONDS = 60
#: One loaded segment, as far as degrees of freedom ask for it.
DESIGN: Any = SimpleNamespace(bank=BANK, segments=(SimpleNamespace(loaded=True),))


def noise(rng: np.random.Generator) -> np.ndarray:
    """First-order noise with a memory of 0.3 s, and white noise on top, at full rate."""
    phi = np.exp(-1 / (50.0 * 0.3))
    n = 50 * SECONDS
    drawn = signal.lfilter([np.sqrt(1 - phi**2)], [1.0, -phi], rng.standard_normal(n + 500))[500:]
    return np.asarray(drawn + 0.5 * rng.standard_normal(n))


def columns() -> np.ndarray:
    """A slow motion (a stiffness), a fast one (a viscous friction)."""
    t = np.arange(50 * SECONDS) / 50.0
    return np.column_stack([np.sin(2 * np.pi * t / 40.0), np.sin(2 * np.pi * 0.9 * t)])


@pytest.mark.slow
def test_intervals_cover_95_percent_of_slow_and_fast_parameters() -> None:
    rng = np.random.default_rng(8)
    A = BANK.reduce(columns())
    draws, plain, widened = 500, np.zeros(2), np.zeros(2)
    for _ in range(draws):
        model = whitening([noise(rng)], BANK)
        rows = WhiteRows(model(A), model(BANK.reduce(noise(rng))), ((0, np.ones(len(A), dtype=bool)),))
        fit = solve([rows])
        freedom = degrees_of_freedom([rows], fit.covariance, NoiseModel((model,), True), DESIGN)
        plain += np.abs(fit.theta) < SIGMAS * fit.std
        widened += np.abs(fit.theta) < SIGMAS * fit.std * coverage_factors(freedom)
    # Two standard errors of a share of 500 draws are 2 %.
    assert widened / draws == pytest.approx([0.95, 0.95], abs=0.02)
    assert (widened >= plain).all()


def test_a_slow_parameter_lives_on_few_lines_and_more_data_on_more() -> None:
    rng = np.random.default_rng(3)
    A = BANK.reduce(columns())
    found = []
    for count in (1, 4):
        model = whitening([noise(rng) for _ in range(count)], BANK)
        rows = WhiteRows(model(A), np.zeros(len(A)), ((0, np.ones(len(A), dtype=bool)),))
        found.append(degrees_of_freedom([rows], solve([rows]).covariance, NoiseModel((model,), True), DESIGN))
    (slow, fast), (slow_4, fast_4) = found
    assert 3 < slow < fast
    assert slow_4 > 1.2 * slow
    assert fast_4 > 1.5 * fast


def test_factors_are_those_of_students_t() -> None:
    factors = coverage_factors(np.array([5.0, 1e6]))
    assert factors[0] * SIGMAS == pytest.approx(2.5706, abs=1e-4)  # any table of the t distribution
    assert factors[1] == pytest.approx(1.0, abs=1e-4)
    assert stats.norm.cdf(SIGMAS) == pytest.approx(0.975, abs=1e-6)


def test_a_noise_that_is_given_costs_nothing() -> None:
    A = BANK.reduce(columns())
    rows = WhiteRows(A, np.zeros(len(A)), ((0, np.ones(len(A), dtype=bool)),))
    known = NoiseModel((unit_whitening(),), False)
    assert degrees_of_freedom([rows], solve([rows]).covariance, known, DESIGN).tolist() == [1e6, 1e6]
