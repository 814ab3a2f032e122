"""Stage 2 against the parameters that the efforts were computed from, and against motions that do not excite."""

from __future__ import annotations

import numpy as np
import pytest
from synthetic_arm import clean_session, exact_design, make_session, planar_machine, truth

from daq.errors import InputError, RecordingError
from fitting.arm.base_parameters import reduce_parameters
from fitting.loop.session import Options, Session
from fitting.pipeline.cylinder_stage import CylinderEstimate, identify_cylinders
from fitting.pipeline.stage_two import identify_one_shot, identify_rigid_body
from fitting.regression.design import white_noise_model


def known_cylinders(names: tuple[tuple[str, ...], ...], drive: np.ndarray) -> list[CylinderEstimate]:
    return [
        CylinderEstimate(f"joint{j + 1}", own, drive[j], np.ones(5), 0.0, False, 100) for j, own in enumerate(names)
    ]


@pytest.mark.parametrize(("n", "seed"), [(2, 3), (3, 4)])
def test_base_parameters_of_exact_efforts_are_exact(n: int, seed: int) -> None:
    machine, arm = planar_machine(n), truth(n, seed)
    design = exact_design(machine, arm)
    cylinders = known_cylinders(design.parameters.drive, arm.drive)
    estimate = identify_rigid_body(design, cylinders)
    base = reduce_parameters(machine).from_standard(arm.pi)
    found = estimate.theta[design.parameters.base_slice]
    assert np.all(np.abs(found - base) < 1e-6 * np.abs(base).max())
    assert np.allclose(estimate.theta[: design.parameters.drive_count], arm.drive.ravel())
    assert estimate.determined.all()


def test_both_stages_in_a_row_on_exact_efforts() -> None:
    machine, arm = planar_machine(2), truth(2)
    design = exact_design(machine, arm)
    session = clean_session(2)
    cylinders = identify_cylinders(design, white_noise_model(2), session.prior)
    # The mass prior is a row of the weight of half a cylinder: it moves the exact answer by as much as it weighs.
    estimate = identify_rigid_body(design, cylinders)
    base = reduce_parameters(machine).from_standard(arm.pi)
    assert np.allclose(estimate.theta[design.parameters.base_slice], base, rtol=1e-3, atol=1e-3 * np.abs(base).max())


def test_one_shot_of_exact_efforts_is_exact_and_worse_conditioned() -> None:
    machine, arm = planar_machine(2), truth(2)
    design = exact_design(machine, arm, (("train", 2), ("train", 4), ("train", 5)))
    one_shot = identify_one_shot(design)
    truth_ = arm.theta(machine)
    assert np.allclose(one_shot.theta, truth_, rtol=1e-5, atol=1e-5 * np.abs(truth_).max())
    two_stage = identify_rigid_body(design, known_cylinders(design.parameters.drive, arm.drive))
    assert one_shot.condition_number > two_stage.condition_number > 1


def test_a_slewing_arm_with_a_sliding_joint_is_recovered_too() -> None:
    machine, arm = planar_machine(kinds="RP"), truth(2)
    design = exact_design(machine, arm)
    estimate = identify_rigid_body(design, known_cylinders(design.parameters.drive, arm.drive))
    base = reduce_parameters(machine).from_standard(arm.pi)
    assert np.allclose(estimate.theta[design.parameters.base_slice], base, atol=1e-6 * np.abs(base).max())


def test_noise_stays_within_the_deviations_of_the_joint_refit() -> None:
    session = clean_session(2)
    fit = session.base_model.fit
    true = truth(2).theta(session.machine)
    error = fit.theta - true
    distance = float(error @ np.linalg.solve(fit.covariance, error))
    # Chi-square with 16 degrees of freedom, 99.9 % below 39; noise in the speeds themselves adds some.
    assert distance < 60


def test_a_motion_of_one_joint_alone_is_refused_by_the_names_it_cannot_tell() -> None:
    machine, arm = planar_machine(2), truth(2)
    session = make_session(machine, arm, moving=[1])
    with pytest.raises(RecordingError) as caught:
        session.require_excitation()
    text = str(caught.value)
    assert "\n" not in text and "train-1.parquet" in text and "does not excite" in text and "hilfit excite" in text
    # ZZ1 needs an acceleration of joint 1; ZZ2 is told by joint 2 alone.
    assert "ZZ1" in text and "ZZ2" not in text


def test_exciting_motions_and_operation_are_not_refused() -> None:
    clean_session(2).require_excitation()
    machine, arm = planar_machine(2), truth(2)
    make_session(machine, arm, (("operation", 2),), moving=[1]).require_excitation()


def test_a_session_without_training_is_refused() -> None:
    machine = planar_machine(1)
    with pytest.raises(InputError, match="no training recording"):
        Session(machine, [], Options())


@pytest.mark.parametrize("bandwidth", [0.0, -1.0, 11.0])
def test_a_bandwidth_beyond_the_rate_is_refused(bandwidth: float) -> None:
    machine, arm = planar_machine(1), truth(1)
    session = make_session(machine, arm, options=Options(bandwidth_hz=bandwidth))
    with pytest.raises(InputError, match="a fifth of the rate"):
        _ = session.bank


def test_the_bandwidth_follows_the_motion_and_can_be_chosen() -> None:
    machine, arm = planar_machine(1), truth(1)
    assert 3.0 <= make_session(machine, arm).bank.bandwidth_hz <= 50.0 / 8
    assert make_session(machine, arm, options=Options(bandwidth_hz=4.5)).bank.bandwidth_hz == 4.5
