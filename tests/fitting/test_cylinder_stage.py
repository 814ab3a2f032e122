"""Stage 1: recursion against one batch solution, and against the parameters that the forces were made with."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from synthetic_arm import Noise, clean_session, exact_design, make_session, planar_machine, truth

from fitting.pipeline.cylinder_stage import LEAST_ROWS, identify_cylinders
from fitting.regression.design import white_noise_model
from fitting.regression.prior import Prior, mass_prior

NOTHING_KNOWN = Prior(np.full(2, np.nan), np.full(2, np.nan))


def test_recursive_is_batch() -> None:
    """The rows of joint 2 once more, all at once, by numpy: whitened unloaded rows and the prior's row."""
    session = clean_session(2)
    design, noise, prior = session.plain.design, session.plain.noise, session.prior
    estimates = identify_cylinders(design, noise, prior)
    for joint, estimate in enumerate(estimates):
        block = design.blocks[joint][0]
        own = design.parameters.drive_slice(joint)
        A = design.white(noise, joint, 0, block.reduced)[:, own]
        b = design.white(noise, joint, 0, block.reduced_target)
        A = np.vstack([A, [1 / prior.std[joint], 0, 0, 0, 0]])
        b = np.append(b, prior.mass[joint] / prior.std[joint])
        scale = np.linalg.norm(A, axis=0)
        batch = np.linalg.lstsq(A / scale, b, rcond=None)[0] / scale
        assert np.allclose(estimate.theta, batch, rtol=1e-9, atol=0)
        assert np.allclose(estimate.std, np.sqrt(np.diag(np.linalg.inv(A.T @ A))), rtol=1e-6)
        assert estimate.rows == len(b) - 1 and not estimate.in_situ


def test_exact_forces_give_exact_parameters() -> None:
    machine, arm = planar_machine(2), truth(2)
    estimates = identify_cylinders(exact_design(machine, arm), white_noise_model(2), NOTHING_KNOWN)
    for estimate, true in zip(estimates, arm.drive, strict=True):
        assert estimate.names == ("m", "K", "f_c", "f_v", "f_s")
        assert np.allclose(estimate.theta, true, rtol=1e-7)
        assert estimate.residual_std < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_noisy_forces_give_parameters_within_their_deviations(seed: int) -> None:
    machine, arm = planar_machine(2), truth(2)
    session = make_session(machine, arm, seed=seed)
    estimates = identify_cylinders(session.plain.design, session.plain.noise, session.prior)
    for estimate, true in zip(estimates, arm.drive, strict=True):
        assert np.all(np.abs(estimate.theta - true) < 4.5 * estimate.std), estimate
        assert estimate.theta[1] == pytest.approx(true[1], rel=0.05)  # K


def test_without_an_unloaded_recording_the_load_is_a_nuisance() -> None:
    machine, arm = planar_machine(2), truth(2)
    design = exact_design(machine, arm, (("train", 2), ("train", 4)))
    estimates = identify_cylinders(design, white_noise_model(2), NOTHING_KNOWN)
    assert all(e.in_situ for e in estimates)
    # Mass is lumped with the link's inertia where the lever arm hardly changes; friction is not.
    for estimate, true in zip(estimates, arm.drive, strict=True):
        assert np.allclose(estimate.theta[2:], true[2:], rtol=1e-4)


def test_a_cylinder_that_stood_still_is_identified_in_situ_and_the_others_are_not() -> None:
    machine, arm = planar_machine(2), truth(2)
    design = exact_design(machine, arm, (("unloaded", 1), ("train", 2)))
    resting = replace(design.blocks[1][0], keep=np.zeros_like(design.blocks[1][0].keep))
    held = replace(design, blocks=(design.blocks[0], (resting, *design.blocks[1][1:])))
    first, second = identify_cylinders(held, white_noise_model(2), NOTHING_KNOWN)
    assert not first.in_situ and second.in_situ
    assert first.rows > LEAST_ROWS
    assert np.allclose(first.theta, arm.drive[0], rtol=1e-7)


def test_a_prior_that_data_outweigh_changes_nothing_and_one_that_they_do_not_helps() -> None:
    machine, arm = planar_machine(1), truth(1)
    noise = Noise(white=2.0, slow=1.0)
    session = make_session(machine, arm, noise=noise)
    design, model = session.plain.design, session.plain.noise
    with_prior = identify_cylinders(design, model, mass_prior(machine))[0]
    alone = identify_cylinders(design, model, Prior(np.array([np.nan]), np.array([np.nan])))[0]
    assert with_prior.std[0] <= alone.std[0]
    assert np.all(np.abs(with_prior.theta[1:4] - alone.theta[1:4]) < alone.std[1:4])


def test_a_known_moving_mass_is_no_unknown() -> None:
    machine, arm = planar_machine(1), truth(1)
    joint = machine.joints[0]
    cylinder = joint.cylinder
    assert cylinder is not None
    weighed = joint.model_copy(update={"cylinder": cylinder.model_copy(update={"moving_mass": float(arm.drive[0, 0])})})
    known = machine.model_copy(update={"joints": (weighed,)})
    session = make_session(known, arm)
    # The synthetic forces hold the mass themselves; the file only says it.
    estimate = identify_cylinders(session.plain.design, session.plain.noise, session.prior)[0]
    assert estimate.names == ("K", "f_c", "f_v", "f_s")
    assert np.all(np.abs(estimate.theta - arm.drive[0, 1:]) < 4.5 * estimate.std)


def test_forgetting_follows_friction_that_changed() -> None:
    machine, arm = planar_machine(1), truth(1)
    design = exact_design(machine, arm, (("unloaded", 1), ("unloaded", 5), ("train", 2)))
    block = design.blocks[0][1]
    more = 40.0 * block.columns[:, 2]  # f_c is 40 N higher in the second recording
    later = replace(block, target=block.target + more, reduced_target=block.reduced_target + design.bank.reduce(more))
    changed = replace(design, blocks=((design.blocks[0][0], later, design.blocks[0][2]),))
    nothing = Prior(np.array([np.nan]), np.array([np.nan]))
    steady = identify_cylinders(changed, white_noise_model(1), nothing)[0]
    forgetful = identify_cylinders(changed, white_noise_model(1), nothing, forgetting=0.97)[0]
    assert 5.0 < steady.theta[2] - arm.drive[0, 2] < 35.0  # a mean of both, by the weight of their rows
    assert forgetful.theta[2] - arm.drive[0, 2] == pytest.approx(40.0, abs=1.0)


def test_directly_driven_joints_have_friction_of_their_own() -> None:
    machine, arm = planar_machine(kinds="rr"), truth(2)
    session = make_session(machine, arm, (("train", 2), ("repeat", 2), ("train", 4), ("validate", 3)))
    estimates = identify_cylinders(session.plain.design, session.plain.noise, session.prior)
    assert [e.names for e in estimates] == [("f_c", "f_v"), ("J", "f_c", "f_v")]
    for estimate, true in zip(estimates, arm.drive, strict=True):
        assert estimate.in_situ
        assert np.all(np.abs(estimate.theta[-2:] - true[2:4]) < 4.5 * estimate.std[-2:])


def test_a_joint_that_was_parked_all_day_has_no_estimate_but_no_nan_either() -> None:
    machine, arm = planar_machine(2), truth(2)
    session = make_session(machine, arm, (("operation", 2), ("operation", 4)), moving=[1])
    parked, moved = identify_cylinders(session.plain.design, session.plain.noise, session.prior)
    assert parked.rows == 0 and moved.rows > LEAST_ROWS
    assert np.isfinite(parked.theta).all() and np.isfinite(parked.residual_std)
