"""Instrumental variables: free of the bias that noise in the regressor makes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic_arm import Noise, exact_design, make_session, planar_machine, truth

from daq.errors import InputError
from fitting.arm.base_parameters import reduce_parameters
from fitting.arm.geometry import geometry_of
from fitting.estimators import InstrumentalVariables, StageTwo, WeightedLeastSquares, within
from fitting.loop.session import Options
from fitting.pipeline.cylinder_stage import CylinderEstimate
from fitting.pipeline.rigid_body_stage import effort_rows, identify_rigid_body, instruments
from fitting.regression.instruments import instrument_columns, motion_bandwidth, slow_motion
from fitting.signals.filters import filter_bank


def test_least_squares_is_bent_by_the_reliability_ratio_and_instruments_are_not() -> None:
    rng = np.random.default_rng(1)
    x = rng.standard_normal(40_000)
    A, Z = (x + 0.5 * rng.standard_normal(40_000))[:, None], (x + 0.5 * rng.standard_normal(40_000))[:, None]
    b = 2.0 * x + 0.1 * rng.standard_normal(40_000)
    # Fuller, Measurement Error Models, 1.1.6: the slope shrinks by var(x) / (var(x) + var(noise)) = 1 / 1.25.
    assert WeightedLeastSquares().fit(A, b).theta[0] == pytest.approx(1.6, abs=0.02)
    assert InstrumentalVariables(Z).fit(A, b).theta[0] == pytest.approx(2.0, abs=0.04)


@pytest.mark.slow
def test_intervals_cover_also_where_instruments_are_weak() -> None:
    rng = np.random.default_rng(2)
    hits = []
    for _ in range(300):
        x = rng.standard_normal((300, 2))
        A, Z = x + 0.5 * rng.standard_normal((300, 2)), x + rng.standard_normal((300, 2))
        estimate = InstrumentalVariables(Z).fit(A, x @ [1.0, -2.0] + 0.3 * rng.standard_normal(300))
        hits.append(np.abs(estimate.theta - [1.0, -2.0]) < 1.96 * estimate.std)
        assert 0.3 < estimate.details["weakest_instrument"] < 0.9
    assert 0.92 <= np.mean(hits) <= 0.98


@given(st.integers(0, 10_000))
@settings(max_examples=30, deadline=None)
def test_the_residual_is_orthogonal_to_the_instruments(seed: int) -> None:
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((50, 3)) * [1.0, 1e4, 1e-4]
    Z = A + 0.3 * rng.standard_normal((50, 3)) * [1.0, 1e4, 1e-4]
    b = rng.standard_normal(50)
    residual = b - A @ InstrumentalVariables(Z).fit(A, b).theta
    assert Z.T @ residual / np.linalg.norm(Z, axis=0) == pytest.approx(np.zeros(3), abs=1e-9)


def test_the_regressor_as_its_own_instrument_is_weighted_least_squares() -> None:
    rng = np.random.default_rng(3)
    A, groups = rng.standard_normal((80, 3)), np.repeat([0, 1], 40)
    b = A @ [1.0, 2.0, 3.0] + np.where(groups == 0, 0.1, 3.0) * rng.standard_normal(80)
    one, other = (e.fit(A, b, groups=groups) for e in (InstrumentalVariables(A), WeightedLeastSquares()))
    assert one.theta == pytest.approx(other.theta, rel=0.02)  # weights from slightly different residuals
    assert one.details["weakest_instrument"] == pytest.approx(1.0)


def test_an_uncorrelated_instrument_determines_no_parameter() -> None:
    rng = np.random.default_rng(4)
    A = rng.standard_normal((60, 2))
    Z = A.copy()
    Z[:, 1] = 0.0
    estimate = InstrumentalVariables(Z).fit(A, A @ [1.0, 2.0])
    assert not estimate.told.any()  # column 1 stands in for part of column 0
    assert np.isinf(estimate.std).all()


def test_instruments_of_another_shape_are_refused() -> None:
    with pytest.raises(ValueError, match="of the shape of the regressor"):
        InstrumentalVariables(np.ones((3, 1))).fit(np.ones((4, 1)), np.ones(4))


def test_a_stage_without_instruments_is_refused_in_one_line() -> None:
    machine = planar_machine(1)
    with pytest.raises(InputError, match=r"^estimator 'iv'.*use 'wls'$"):
        within(InstrumentalVariables(), StageTwo(geometry_of(machine), reduce_parameters(machine)))


# --- where instruments come from ----------------------------------------------------------------------------------


def test_the_slow_motion_is_the_motion_where_that_is_slow() -> None:
    t = np.arange(2000) / 50.0
    position = np.column_stack([np.sin(0.5 * t), 0.3 * np.cos(0.8 * t) + 2.0])
    bank = filter_bank(50.0, 0.5)
    q, qd, qdd = slow_motion(position, bank)
    inner = slice(bank.margin, -bank.margin)
    assert q[inner] == pytest.approx(position[inner], abs=1e-3)
    assert qd[inner, 0] == pytest.approx(0.5 * np.cos(0.5 * t[inner]), abs=1e-3)
    assert qdd[inner, 1] == pytest.approx(-0.3 * 0.64 * np.cos(0.8 * t[inner]), abs=1e-3)
    # At the ends the odd continuation holds position and keeps the speed going.
    assert q[0] == pytest.approx(position[0], abs=1e-9) and q[-1] == pytest.approx(position[-1], abs=1e-9)


def test_the_noise_of_accelerations_is_all_but_gone() -> None:
    noise = np.random.default_rng(5).standard_normal((5000, 1)) * 1e-5
    ordinary, slow = filter_bank(50.0, 3.0), filter_bank(50.0, 0.6)
    left = slow_motion(noise, slow)[2].std()
    # White noise through a second difference: power goes with the fifth power of the bandwidth.
    assert left / ordinary.acceleration_noise(1e-5) < 2 * (0.6 / 3.0) ** 2.5


def test_a_segment_shorter_than_the_filter_keeps_its_own_columns() -> None:
    with pytest.raises(ValueError, match="too few"):
        slow_motion(np.zeros((50, 2)), filter_bank(50.0, 0.5))
    machine, arm = planar_machine(2), truth(2)
    design = exact_design(machine, arm, (("train", 2), ("unloaded", 1)), seconds=12.0)
    assert 0.0 < motion_bandwidth(design, [0]) < 3.0
    made = instrument_columns(design, [0])
    assert made[0].shape == (len(design.segments[0]), 2, len(design.parameters.base))


def test_instruments_stand_beside_the_rows_and_look_like_them() -> None:
    machine, arm = planar_machine(2), truth(2)
    design = exact_design(machine, arm)
    Z, rows = instruments(design), effort_rows(design)
    A = rows.columns[:, design.parameters.base_slice]
    assert Z.shape == A.shape
    cosines = np.sum(A * Z, axis=0) / np.linalg.norm(A, axis=0) / np.linalg.norm(Z, axis=0)
    assert cosines.min() > 0.98


@pytest.mark.slow
def test_noisy_encoders_bend_weighted_least_squares_more_than_instruments() -> None:
    machine, arm = planar_machine(2), truth(2)
    noise = Noise(joint=2e-3, piston=1e-3, white=2.0, slow=1.0)
    base = reduce_parameters(machine).from_standard(arm.pi)
    apart: dict[str, list[np.ndarray]] = {"wls": [], "iv": []}
    for seed in range(6):
        recordings, options = (("train", 2), ("train", 4)), Options(bandwidth_hz=3.0)
        design = make_session(machine, arm, recordings, noise=noise, seed=seed, options=options).plain.design
        known = [
            CylinderEstimate(f"joint{j + 1}", own, arm.drive[j], np.zeros(5), 0.0, False, 100)
            for j, own in enumerate(design.parameters.drive)
        ]
        for estimator in (WeightedLeastSquares(), InstrumentalVariables()):
            found = identify_rigid_body(design, known, estimator).theta[design.parameters.base_slice]
            apart[estimator.name].append((found - base) / np.abs(base).max())
    bias = {name: float(np.linalg.norm(np.mean(values, axis=0))) for name, values in apart.items()}
    # Accelerations of 2 mrad encoders are mostly noise at 3 Hz: inertias shrink, and instruments bring them back.
    assert bias["iv"] < 0.3 * bias["wls"]
