"""Filters and derivatives against analytic signals, polynomials, and the plain full-length convolution."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from fitting.signals.filters import FilterBank, filter_bank, lag_between, white_noise_of

RATE = 50.0
BANK = filter_bank(RATE, 3.0)
TIME = np.arange(3000) / RATE
INNER = BANK.trimmed(TIME)


@pytest.mark.parametrize("frequency", [0.05, 0.3, 1.0, 2.0, 3.0])
def test_motion_and_derivatives_of_a_sine_in_the_band_are_the_sines_own(frequency: float) -> None:
    w = 2 * np.pi * frequency
    value, first, second = BANK.smooth(np.sin(w * TIME))
    # The designer promises a flat trajectory filter (1e-3) up to the bandwidth.
    assert np.max(np.abs(value - np.sin(w * INNER))) < 1e-3
    assert np.max(np.abs(first - w * np.cos(w * INNER))) < 1e-3 * w
    assert np.max(np.abs(second + w**2 * np.sin(w * INNER))) < 1e-3 * w**2


@given(st.lists(st.floats(-5, 5), min_size=4, max_size=4))
@settings(max_examples=30, deadline=None)
def test_cubics_pass_up_to_the_filters_own_curvature_term(coefficients: list[float]) -> None:
    """A symmetric kernel of unit sum keeps a line and a cubic's odd part; a parabola it lifts by a constant."""
    polynomial = np.polynomial.Polynomial(coefficients)
    taps = np.arange(-BANK.margin, BANK.margin + 1) / RATE
    lift = float(BANK.value @ taps**2) / 2  # second moment: what E[p(t + tau)] adds to p(t), times p''
    value, first, second = BANK.smooth(polynomial(TIME - 30))
    t = INNER - 30
    size = 1 + float(np.max(np.abs(polynomial(t))))
    assert np.allclose(value, polynomial(t) + lift * polynomial.deriv(2)(t), rtol=0, atol=1e-10 * size)
    assert np.allclose(first, polynomial.deriv(1)(t) + lift * polynomial.deriv(3)(t), rtol=0, atol=1e-8 * size)
    assert np.allclose(second, polynomial.deriv(2)(t), rtol=0, atol=1e-6 * size)


def test_kernels_are_symmetric_so_that_nothing_is_delayed() -> None:
    assert np.allclose(BANK.value, BANK.value[::-1], atol=1e-15)
    assert np.allclose(BANK.first, -BANK.first[::-1], atol=1e-10)
    assert np.allclose(BANK.second, BANK.second[::-1], atol=1e-10)
    assert np.allclose(BANK.identification, BANK.identification[::-1], atol=1e-15)
    assert BANK.value.sum() == pytest.approx(1.0)
    assert BANK.identification.sum() == pytest.approx(1.0)


@pytest.mark.parametrize(("rate", "bandwidth"), [(50.0, 4.5), (50.0, 10.0), (100.0, 1.7)])
def test_the_kernels_are_the_windowed_sincs_of_scipy(rate: float, bandwidth: float) -> None:
    bank = filter_bank(rate, bandwidth)
    kaiser = ("kaiser", 8.0)
    wanted = signal.firwin(len(bank.identification), bandwidth, window=kaiser, fs=rate)
    assert np.allclose(bank.identification, wanted, atol=1e-15, rtol=0)
    smooth = signal.firwin(len(bank.value) - 8, min(bandwidth * 5 / 3, 0.45 * rate), window=kaiser, fs=rate)
    assert np.allclose(bank.value[4:-4], smooth, atol=1e-15, rtol=0)


def test_the_identification_filter_passes_its_band_and_stops_what_decimation_would_fold() -> None:
    frequency, gain = signal.freqz(BANK.identification, worN=4096, fs=RATE)
    gain = np.abs(gain)
    assert gain[np.argmin(np.abs(frequency - 3.0))] == pytest.approx(0.5, abs=0.01)  # -6 dB
    assert np.all(gain[frequency > 1.4 * 3.0] < 1e-3)
    assert np.all(gain[frequency > 1.5 * 3.0] < 1e-4)
    # What lies above the reduced Nyquist rate would fold into the band.
    assert BANK.reduced_rate_hz / 2 > 3.0
    assert np.all(gain[frequency > BANK.reduced_rate_hz - 3.0] < 1e-3)


@given(
    st.integers(0, 400),
    st.integers(0, 2**31),
    st.sampled_from([(50.0, 3.0), (50.0, 6.25), (100.0, 3.0), (20.0, 2.5)]),
)
@settings(max_examples=60, deadline=None)
def test_reduce_is_full_convolution_and_then_every_so_many_th_sample(
    length: int, seed: int, rates: tuple[float, float]
) -> None:
    bank = filter_bank(*rates)
    columns = np.random.default_rng(seed).normal(size=(length, 3))
    reduced = bank.reduce(columns)
    assert len(reduced) == bank.rows(length)
    if length < len(bank.identification):
        assert len(reduced) == 0
        return
    full = np.stack([np.convolve(c, bank.identification, mode="valid") for c in columns.T], axis=1)
    assert np.allclose(reduced, full[:: bank.decimation], atol=1e-12)
    assert np.allclose(bank.reduce(columns[:, 0]), reduced[:, 0], rtol=1e-12, atol=1e-13)


@given(st.integers(0, 2**31), st.floats(-3, 3), st.floats(-3, 3))
@settings(max_examples=25, deadline=None)
def test_a_linear_relation_between_signals_stays_the_same_after_the_filter(seed: int, a: float, b: float) -> None:
    u, v = np.random.default_rng(seed).normal(size=(2, 600))
    left = BANK.reduce(a * u + b * v)
    right = BANK.reduce(np.column_stack([u, v])) @ [a, b]
    assert np.allclose(left, right, atol=1e-12)


def test_trimmed_and_smoothed_samples_stand_beside_each_other() -> None:
    step = np.where(TIME < 30.0, 0.0, 1.0)
    value, _, _ = BANK.smooth(step)
    inner = BANK.trimmed(step)
    assert len(value) == len(inner) == len(TIME) - 2 * BANK.margin
    # Symmetric: the smooth step crosses one half exactly between the samples where the raw one jumps.
    place = int(np.flatnonzero(inner)[0])
    assert value[place - 1] + value[place] == pytest.approx(1.0, abs=1e-12)


def test_rate_differentiates_smooth_signals_at_full_length() -> None:
    w = 2 * np.pi * 1.5
    out = BANK.rate(np.sin(w * TIME))
    assert len(out) == len(TIME)
    # Relative error of the eighth-order difference: (w T)^8 / 630 = 2e-9.
    assert np.allclose(out[4:-4], w * np.cos(w * TIME[4:-4]), atol=1e-7)
    assert np.allclose(out, w * np.cos(w * TIME), atol=0.1 * w)
    assert np.array_equal(BANK.rate([1.0, 3.0, 5.0]), [100.0, 100.0, 100.0])


def test_noise_of_derivatives_is_predicted_from_the_positions() -> None:
    noise = np.random.default_rng(4).normal(size=60_000) * 2e-5
    _, first, second = BANK.smooth(noise)
    # Some 60 000 / 50 independent samples: three per cent.
    assert np.std(first) == pytest.approx(BANK.speed_noise(2e-5), rel=0.05)
    assert np.std(second) == pytest.approx(BANK.acceleration_noise(2e-5), rel=0.05)


def test_white_noise_is_told_from_the_motion_under_it() -> None:
    motion = 0.1 * np.sin(2 * np.pi * 0.3 * TIME)
    noise = np.random.default_rng(5).normal(size=len(TIME)) * 3e-6
    assert white_noise_of([motion + noise]) == pytest.approx(3e-6, rel=0.06)
    assert white_noise_of([motion]) < 1e-7
    assert white_noise_of([[1.0, 2.0]]) == 0.0


@pytest.mark.parametrize("lag", [-40, -1, 0, 7, 40])
def test_lag_between_finds_by_how_much_the_second_is_late(lag: int) -> None:
    rng = np.random.default_rng(6)
    long = np.stack([np.sin(0.03 * np.arange(1200) + phase) + np.sin(0.011 * np.arange(1200)) for phase in (0, 1)], 1)
    first, second = long[100:1000], long[100 - lag : 1000 - lag]
    assert lag_between(first, second + 0.01 * rng.normal(size=second.shape), 60) == lag
    assert lag_between(second, first, 60) == -lag


def test_lag_between_stays_inside_what_was_asked_for() -> None:
    signal_ = np.sin(0.02 * np.arange(1000))[:, None]
    assert abs(lag_between(signal_[:800], signal_[100:900], 20)) <= 20


@pytest.mark.parametrize("bandwidth", [0.0, -1.0, 10.1, 25.0])
def test_a_bandwidth_that_cannot_be_filtered_is_refused(bandwidth: float) -> None:
    with pytest.raises(ValueError, match="at most a fifth"):
        filter_bank(RATE, bandwidth)


def test_a_bank_says_what_it_costs_at_the_ends() -> None:
    bank: FilterBank = filter_bank(RATE, 3.0)
    samples = 500
    inside = len(bank.smooth(np.zeros(samples))[0])
    assert inside == samples - 2 * bank.margin
    assert bank.rows(inside) == len(bank.reduce(np.zeros(inside)))
    assert bank.rows(3) == 0
