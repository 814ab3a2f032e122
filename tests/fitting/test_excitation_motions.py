"""Designed motions keep every limit, start and end at rest, and tell more than motions that were not designed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from arm_examples import driven_arm, inverse_dynamics, planar_arm
from scipy.interpolate import make_interp_spline
from synthetic_arm import force, make_motion, planar_machine, sample, truth

from daq.errors import InputError
from daq.motion_files import Motion
from fitting.arm.base_parameters import base_regressor, condition_number, reduce_parameters
from fitting.arm.dynamics import stacked
from fitting.arm.linkage import piston_motion
from fitting.excitation.design import design_motion, design_sequence, information_of, information_of_recording
from fitting.excitation.limits import HydraulicLimits, chamber_pressure
from fitting.excitation.objective import condition_of_information, information
from fitting.excitation.problem import ExcitationOptions, pose_problem, random_start

QUICK = ExcitationOptions(seconds=12.0, starts=1, iterations=15, samples=60, harmonics=5)


def check_limits(machine, excitation, use):
    """Independently of how it was made: a spline through the motion file's rows, on a grid ten times as fine."""
    motion = excitation.motion
    rest = [(1, np.zeros(len(machine.joints))), (2, np.zeros(len(machine.joints)))]
    law = make_interp_spline(motion.time, motion.joint_positions(machine), k=5, bc_type=(rest, rest))
    fine = np.linspace(0, motion.seconds, 10 * len(motion.time))
    q, qd, qdd = law(fine), law.derivative(1)(fine), law.derivative(2)(fine)
    for i, joint in enumerate(machine.joints):
        low, high = joint.limits.position
        slack = 1 + 1e-4
        assert np.abs(q[:, i] - (low + high) / 2).max() <= use * (high - low) / 2 * slack
        assert np.abs(qd[:, i]).max() <= use * joint.limits.velocity * slack
        assert np.abs(qdd[:, i]).max() <= use * joint.limits.acceleration * slack
        x, _, _ = piston_motion(joint.cylinder.linkage, q[:, i], qd[:, i], qdd[:, i])
        assert x.min() >= 0
        assert x.max() <= joint.cylinder.stroke
    np.testing.assert_allclose(law(motion.time), motion.joint_positions(machine), atol=1e-12)
    np.testing.assert_allclose(law.derivative(1)(motion.time), excitation.speed, atol=1e-4)
    np.testing.assert_allclose(law.derivative(2)(motion.time), excitation.acceleration, atol=5e-3)


@pytest.mark.slow
@pytest.mark.parametrize("twisted", [False, True], ids=["planar", "twisted"])
def test_a_designed_motion_keeps_its_limits_and_rests_at_its_ends(twisted):
    machine = driven_arm(4, twisted=twisted)
    found = design_motion(machine, reduce_parameters(machine), options=QUICK)
    check_limits(machine, found, QUICK.use)
    for values in (found.speed, found.acceleration):
        np.testing.assert_allclose(values[[0, -1]], 0.0, atol=1e-9)
    assert found.motion.time[0] == 0.0
    assert found.motion.seconds == pytest.approx(12.0)
    np.testing.assert_allclose(np.diff(found.motion.time), 1 / machine.rate_hz)
    # Every joint is brought to one of its limits.
    for joint in machine.joints:
        used = [use.used for use in found.limits if use.joint == joint.name and use.quantity != "stroke"]
        assert max(used) == pytest.approx(QUICK.use, rel=1e-3)


def test_the_reported_condition_number_is_that_of_the_motion():
    machine = driven_arm(3)
    base = reduce_parameters(machine)
    found = design_motion(machine, base, options=QUICK)
    W = stacked(base_regressor(machine, base, found.motion.joint_positions(machine), found.speed, found.acceleration))
    assert found.condition_number == pytest.approx(condition_number(W), rel=1e-6)
    assert found.own_condition_number == found.condition_number
    np.testing.assert_allclose(found.information, W.T @ W, rtol=1e-10, atol=1e-10 * np.abs(found.information).max())
    np.testing.assert_allclose(information_of(machine, base, found.motion), found.information, rtol=1e-2)
    assert found.undetermined == ()


@pytest.mark.slow
def test_designing_beats_the_best_of_many_random_series():
    machine = driven_arm(4)
    base = reduce_parameters(machine)
    found = design_motion(machine, base, options=replace(QUICK, iterations=40))
    rng = np.random.default_rng(6)
    problem = pose_problem(machine, base, QUICK, None, None, HydraulicLimits(), rng)
    from fitting.excitation.design import _finish

    random = [_finish(problem, random_start(problem, rng), None).condition_number for _ in range(30)]
    assert found.condition_number < 0.9 * min(random)
    assert found.condition_number < 0.65 * np.median(random)


def test_the_same_seed_gives_the_same_motion_and_another_seed_another():
    machine = driven_arm(2)
    base = reduce_parameters(machine)
    first, again, other = (design_motion(machine, base, options=QUICK, seed=seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(first.motion.columns["joint1"], again.motion.columns["joint1"])
    assert np.abs(first.motion.columns["joint1"] - other.motion.columns["joint1"]).max() > 0.05


@pytest.mark.slow
def test_a_second_motion_complements_the_first():
    machine = driven_arm(3)
    base = reduce_parameters(machine)
    first, second = design_sequence(machine, base, 2, options=QUICK)
    together = condition_of_information(first.information + second.information)
    assert second.condition_number == pytest.approx(together, rel=1e-9)
    assert together < first.condition_number
    # A first motion of one joint only leaves parameters open; the second, of the others too, tells them.
    start = design_motion(machine, base, options=QUICK, joints=["joint3"])
    assert start.own_condition_number == np.inf
    assert {"ZZ1", "ZZ2"} <= set(start.undetermined)
    rest = design_motion(machine, base, options=QUICK, gathered=start.information)
    assert rest.undetermined == ()
    assert np.isfinite(rest.condition_number)


def test_one_joint_alone_holds_the_others_still():
    machine = driven_arm(3)
    found = design_motion(machine, reduce_parameters(machine), options=QUICK, joints=["joint2"])
    assert list(found.motion.columns) == ["joint2"]
    assert not found.speed[:, [0, 2]].any()
    assert {use.joint for use in found.limits} == {"joint2"}


def test_d_optimality_gives_larger_signals():
    machine = driven_arm(3)
    base = reduce_parameters(machine)
    condition, determinant = (
        design_motion(machine, base, options=replace(QUICK, iterations=40, criterion=criterion, signal_share=0.0))
        for criterion in ("condition", "determinant")
    )
    assert condition.condition_number < determinant.condition_number
    assert np.linalg.slogdet(determinant.information)[1] > np.linalg.slogdet(condition.information)[1]


def test_progress_rises_to_one_and_reports_the_best():
    machine = driven_arm(2)
    seen: list[tuple[float, float]] = []
    found = design_motion(
        machine,
        reduce_parameters(machine),
        options=replace(QUICK, starts=2, iterations=5),
        progress=lambda share, condition: seen.append((share, condition)),
    )
    shares = [share for share, _ in seen]
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert seen[-1][1] == found.condition_number
    assert len(seen) > 4


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"seconds": 1.0}, "fewer than two periods"),
        ({"use": 1.2}, "use"),
        ({"harmonics": 1}, "harmonics must be 2"),
    ],
)
def test_options_that_cannot_be_are_refused(options, says):
    with pytest.raises(InputError, match=says):
        ExcitationOptions(**options)


def test_an_unknown_joint_is_named():
    machine = driven_arm(2)
    with pytest.raises(InputError, match=r"joint 'joint7': test-arm has joint1, joint2"):
        design_motion(machine, reduce_parameters(machine), options=QUICK, joints=["joint7"])


def test_a_motion_of_free_cylinders_tells_nothing_about_links():
    motion = Motion("test-arm", "unpinned", np.arange(10.0), {"joint1": np.full(10, 0.1)})
    with pytest.raises(InputError, match="rods=unpinned"):
        information_of(driven_arm(1), reduce_parameters(driven_arm(1)), motion)


@pytest.mark.slow
def test_the_default_search_is_near_the_best_of_several_long_runs():
    """Starts that compete against single ones that are twice as long (`hilfit bench excitation` has twenty)."""
    machine = driven_arm(4)
    base = reduce_parameters(machine)
    options = ExcitationOptions(seconds=12.0, samples=60)
    found = design_motion(machine, base, options=options)
    long = replace(options, starts=1, iterations=2 * options.iterations)
    best = min(design_motion(machine, base, options=long, seed=100 + k).condition_number for k in range(6))
    assert found.condition_number <= 1.1 * best


@pytest.mark.slow
def test_under_a_pressure_limit_the_home_is_searched_too():
    """Holding mid-range alone already takes more than the limit; another pose does not."""
    machine = driven_arm(3)
    base = reduce_parameters(machine)
    guess = base.from_standard(np.tile([20, -7, 0, 0, 0.1, 0, 0, 3.0, 0, 3.0], 3))
    zero = np.zeros((1, 3))
    tau = base_regressor(machine, base, zero, zero, zero) @ guess
    holding = chamber_pressure(machine.joints[0].cylinder, zero[:, 0], tau[:, 0], 0.0, 0.0)[0][0]
    limits = HydraulicLimits(pressure=holding, base_parameters=guess)
    found = design_motion(machine, base, options=replace(QUICK, starts=3, iterations=40), hydraulic=limits)
    q = found.motion.joint_positions(machine)
    tau = base_regressor(machine, base, q, found.speed, found.acceleration) @ guess
    for i, joint in enumerate(machine.joints):
        pressures = chamber_pressure(joint.cylinder, q[:, i], tau[:, i], 0.0, 0.0)[0]
        assert pressures.max() <= QUICK.use * holding * (1 + 1e-9)
    assert np.abs(q[0]).max() > 0.02  # not at home mid-range
    assert set(found.motion.columns) == {"joint1", "joint2", "joint3"}
    check_limits(machine, found, QUICK.use)


def test_a_recording_counts_as_gathered_like_its_motion():
    """The same motion as a file and as a noisy recording of it: alike information, scaled by the filters' margins."""
    machine, arm = planar_machine(2), truth(2)
    base = reduce_parameters(machine)
    moved = make_motion(machine, "train", 3)
    recording = sample(machine, moved, force(machine, arm, moved), "train", 1)
    found = information_of_recording(machine, base, recording)
    Y = base_regressor(machine, base, moved.q, moved.qd, moved.qdd)
    cut = slice(34, -34)  # what the trajectory filter takes at 3 Hz
    expected = information(Y[cut]) * len(Y[cut])
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(found / scale, expected / scale, atol=2e-3)
    with pytest.raises(InputError, match="rods unpinned"):
        information_of_recording(machine, base, replace(recording, role="unloaded"))
    second = design_motion(machine, base, options=QUICK, gathered=found)
    assert second.condition_number < second.own_condition_number


def test_inverse_dynamics_of_a_designed_motion_starts_and_ends_with_gravity_alone():
    machine = driven_arm(2)
    found = design_motion(machine, reduce_parameters(machine), options=QUICK)
    pi = np.tile([10.0, 1, 0, 0, 0.5, 0, 0, 0.5, 0, 0.5], 2)
    q = found.motion.joint_positions(machine)
    tau = inverse_dynamics(machine, pi, q, found.speed, found.acceleration)
    still = inverse_dynamics(machine, pi, q[:1], 0 * q[:1], 0 * q[:1])
    np.testing.assert_allclose(tau[[0, -1]], np.vstack([still, still]), rtol=1e-9)


def test_a_planar_arm_lying_flat_tells_what_it_can():
    """Weightless: seven parameters, all told by a designed motion."""
    lying = planar_arm(3, (0.0, 0.0, -9.81))
    machine = driven_arm(3).model_copy(update={"gravity": (0.0, 0.0, -9.81)})
    base = reduce_parameters(machine)
    assert len(base) == len(reduce_parameters(lying)) == 7
    found = design_motion(machine, base, options=QUICK)
    assert found.undetermined == ()
    assert information(base_regressor(machine, base, *np.zeros((3, 5, 3)))).shape == (7, 7)
