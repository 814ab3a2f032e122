"""Drive regressors: expectations against Monte Carlo means, known parts against the printed equation."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic_arm import planar_machine, truth

from fitting.arm.expected import expected_power, expected_sign
from fitting.regression.drive import UNITS, drive_columns, drive_names, known_effort
from fitting.regression.prior import mass_prior, moving_mass
from fitting.signals.filters import advanced

DRAWS = np.random.default_rng(1).normal(size=200_000)


@pytest.mark.parametrize("speed", [-0.03, -0.004, 0.0, 0.001, 0.01])
@pytest.mark.parametrize("noise", [0.002, 0.01])
def test_expected_sign_is_the_mean_over_the_noise(speed: float, noise: float) -> None:
    mean = np.mean(np.sign(speed + noise * DRAWS))
    assert expected_sign([speed], noise)[0] == pytest.approx(mean, abs=4 / np.sqrt(len(DRAWS)))


@pytest.mark.parametrize("speed", [-0.03, -0.004, 0.0, 0.001, 0.01])
@pytest.mark.parametrize("exponent", [1 / 3, 0.5, 1.5])
def test_expected_power_is_the_mean_over_the_noise(speed: float, exponent: float) -> None:
    noise = 0.004
    draws = np.abs(speed + noise * DRAWS) ** exponent * np.sign(speed + noise * DRAWS)
    value = expected_power([speed], noise, exponent)[0]
    assert value == pytest.approx(np.mean(draws), abs=4 * np.std(draws) / np.sqrt(len(DRAWS)))


@pytest.mark.parametrize("exponent", [0.15, 1 / 3, 0.5, 1.5])
def test_expected_power_has_no_step_where_the_series_takes_over(exponent: float) -> None:
    below, above = expected_power([5.999999, 6.000001], 1.0, exponent)
    assert below == pytest.approx(above, rel=2e-4)
    assert expected_power([2.0, -0.3], 0.5, 1.0) == pytest.approx([2.0, -0.3])  # the mean is not moved
    assert expected_power([0.2], 0.5, 1e-12)[0] == pytest.approx(expected_sign([0.2], 0.5)[0])


@given(st.floats(-1, 1), st.one_of(st.just(0.0), st.floats(1e-12, 0.1)), st.sampled_from([1 / 3, 0.5, 1.5]))
@settings(max_examples=80, deadline=None)
def test_expectations_are_odd_and_plain_without_noise(speed: float, noise: float, exponent: float) -> None:
    assert expected_sign([-speed], noise)[0] == pytest.approx(-expected_sign([speed], noise)[0], abs=1e-12)
    forth, back = expected_power([speed, -speed], noise, exponent)
    assert forth == pytest.approx(-back, abs=1e-12)
    assert expected_power([speed], 0.0, exponent)[0] == pytest.approx(np.sign(speed) * abs(speed) ** exponent)
    assert expected_sign([speed], 0.0)[0] == np.sign(speed)


def test_far_from_zero_noise_changes_nothing() -> None:
    assert expected_sign([0.07], 0.01)[0] == pytest.approx(1.0, abs=1e-10)
    assert expected_power([0.7], 0.01, 1 / 3)[0] == pytest.approx(np.cbrt(0.7), rel=1e-4)


def test_columns_are_the_printed_law_in_the_order_of_the_names() -> None:
    rng = np.random.default_rng(2)
    x, v, a = rng.normal(size=(3, 50))
    theta = truth(1).drive[0]
    columns = drive_columns(("m", "K", "f_c", "f_v", "f_s"), x, v, a, 0.0)
    m, K, f_c, f_v, f_s = theta
    law = m * a + K * x + f_c * np.sign(v) + f_v * v + f_s * np.sign(v) * np.abs(v) ** (1 / 3)
    assert np.allclose(columns @ theta, law)


def test_what_the_machine_file_knows_is_not_identified() -> None:
    machine = planar_machine(1)
    joint = machine.joints[0]
    assert drive_names(machine) == (("m", "K", "f_c", "f_v", "f_s"),)
    v, a = np.array([0.1, -0.2]), np.array([1.0, 2.0])
    assert np.allclose(known_effort(joint, v, a), 150.0 * v)
    assert joint.cylinder is not None
    weighed = joint.model_copy(update={"cylinder": joint.cylinder.model_copy(update={"moving_mass": 7.0})})
    known = machine.model_copy(update={"joints": (weighed,)})
    assert drive_names(known) == (("K", "f_c", "f_v", "f_s"),)
    assert np.allclose(known_effort(weighed, v, a), 150.0 * v + 7.0 * a)
    assert np.isnan(mass_prior(known).mass[0])


def test_directly_driven_joints_have_friction_and_the_inertia_that_can_be_told() -> None:
    names = drive_names(planar_machine(kinds="rr"))
    # The first joint's drive inertia adds to ZZ1 for every motion; the second's shows in its own row alone.
    assert names == (("f_c", "f_v"), ("J", "f_c", "f_v"))
    assert np.all(known_effort(planar_machine(kinds="rr").joints[0], np.ones(3), np.ones(3)) == 0)
    assert {name for own in names for name in own} <= set(UNITS)


def test_a_cylinder_weighs_what_its_steel_and_oil_say() -> None:
    cylinder = planar_machine(1).joints[0].cylinder
    assert cylinder is not None
    by_hand = np.pi / 4 * (7850 * (0.045**2 * 1.2 * 0.3 + 0.08**3) + 870 * 0.08**2 * 0.3)
    assert moving_mass(cylinder) == pytest.approx(by_hand)
    prior = mass_prior(planar_machine(2))
    assert np.allclose(prior.mass, by_hand) and np.allclose(prior.std, 0.4 * by_hand)


@given(st.floats(-2.5, 2.5), st.integers(0, 1000))
@settings(deadline=None, max_examples=50)
def test_what_jumps_in_a_late_effort_is_sampled_where_it_arrived(late: float, phase: int) -> None:
    """Independent of the columns: the effort of a delayed speed, sampled, then moved back by the delay."""
    k = np.arange(600)

    def speed(at: np.ndarray) -> np.ndarray:
        return 0.05 * np.sin(0.043 * at + phase) + 0.02 * np.sin(0.11 * at + 2 * phase)

    arrived = np.sign(speed(k - late))
    moved = advanced(arrived, late)
    nothing = np.zeros(600)
    (right,) = drive_columns(("f_c",), nothing, speed(k), nothing, 0.0, late).T
    inside = slice(40, -40)
    # A reversal within a thousandth of a sample may fall on either side.
    assert np.mean(np.abs(right - moved)[inside] > 1e-6) < 0.1
    (naive,) = drive_columns(("f_c",), nothing, speed(k), nothing, 0.0).T
    assert np.std((right - moved)[inside]) <= np.std((naive - moved)[inside]) + 1e-9
