"""Experiments that are motions: each does what its text says, inside every limit."""

from __future__ import annotations

import numpy as np
import pytest
from arm_examples import driven_arm
from scipy.interpolate import make_interp_spline
from synthetic_arm import planar_machine

from daq.errors import InputError
from fitting.arm.base_parameters import base_regressor, reduce_parameters
from fitting.arm.linkage import lever_arm, piston_motion
from fitting.excitation.experiments import KINDS, Arm, NotPossibleError, experiment, menu
from fitting.excitation.fourier import random_series, varied
from fitting.excitation.limits import HydraulicLimits, joint_numbers, supply_flow

USE = 0.92
PINNED = tuple(kind for kind in KINDS if kind != "free_cylinder")


def states(machine, motion, finer=5):
    """Joint states on a finer grid, by a spline through the motion file's rows, at rest at its ends."""
    rest = [(order, np.zeros(len(machine.joints))) for order in (1, 2)]
    law = make_interp_spline(motion.time, motion.joint_positions(machine), k=5, bc_type=(rest, rest))
    time = np.linspace(0, motion.seconds, finer * (len(motion.time) - 1) + 1)
    return time, law(time), law.derivative(1)(time), law.derivative(2)(time)


def moving(qd, joint):
    return np.abs(qd[:, joint]) > 1e-6


@pytest.mark.parametrize("kind", PINNED)
@pytest.mark.parametrize("number", [0, 1, 2])
def test_experiments_keep_the_limits_and_start_and_end_at_rest(kind, number):
    machine = driven_arm(3)
    made = experiment(Arm(machine, number, 30.0, USE), kind)
    assert machine.joints[number].name in made.text
    _, q, qd, qdd = states(machine, made.motion)
    assert made.motion.seconds <= 33.0
    for i, joint in enumerate(machine.joints):
        low, high = joint.limits.position
        assert np.abs(q[:, i] - (low + high) / 2).max() <= USE * (high - low) / 2 * (1 + 1e-6)
        # Steps of acceleration between rows are within what 50 Hz resolves.
        assert np.abs(qd[:, i]).max() <= USE * joint.limits.velocity * 1.02
        assert np.abs(qdd[:, i]).max() <= USE * joint.limits.acceleration * 1.1
        x, _, _ = piston_motion(joint.cylinder.linkage, q[:, i], qd[:, i], qdd[:, i])
        assert x.min() >= 0
        assert x.max() <= joint.cylinder.stroke
    steps = np.abs(np.diff(made.motion.joint_positions(machine), axis=0))
    assert steps.max() <= USE * 0.6 / machine.rate_hz * 1.02  # no jump between parts
    assert np.abs(steps[[0, -1]]).max() < 2e-4
    assert moving(qd, number).mean() > 0.5  # the joint under suspicion is not at rest


def test_a_staircase_holds_constant_piston_speeds_down_to_a_few_millimetres_per_second():
    machine = driven_arm(3)
    made = experiment(Arm(machine, 1, seconds=60.0), "staircase")
    _, q, qd, qdd = states(machine, made.motion, finer=1)
    _, v, a = piston_motion(machine.joints[1].cylinder.linkage, q[:, 1], qd[:, 1], qdd[:, 1])
    held = (np.abs(a) < 1e-4) & (np.abs(v) > 1e-5)
    levels = np.unique(np.round(np.abs(v[held]), 4))
    levels = levels[np.concatenate([[True], np.diff(levels) > 0.05 * levels[1:]])]
    assert held.mean() > 0.5
    assert len(levels) >= 5
    assert levels[0] < 0.005
    assert levels[-1] > 10 * levels[0]
    assert not moving(qd, 0).any()
    assert not moving(qd, 2).any()


def test_slow_reversals_turn_often_over_one_short_way_at_three_rates():
    machine = driven_arm(2)
    made = experiment(Arm(machine, 0, seconds=60.0), "slow_reversals")
    time, q, qd, _ = states(machine, made.motion)
    turns = time[1:][np.diff(np.sign(np.where(np.abs(qd[:, 0]) < 1e-7, 0, qd[:, 0]))) != 0]
    assert len(turns) >= 12
    assert np.ptp(q[:, 0]) < 0.15
    gaps = np.diff(turns)
    assert np.quantile(gaps, 0.9) > 6 * np.quantile(gaps, 0.1)


def test_one_amplitude_at_three_frequencies():
    machine = driven_arm(2)
    made = experiment(Arm(machine, 0, seconds=60.0), "frequencies")
    time, q, _, _ = states(machine, made.motion, finer=1)
    course = q[:, 0] - q[0, 0]
    peaks = course[1:-1][(course[1:-1] > course[:-2]) & (course[1:-1] > course[2:])]
    full = peaks[peaks > 0.9 * peaks.max()]
    assert len(full) > 8
    power = np.abs(np.fft.rfft(course)) ** 2
    frequency = np.fft.rfftfreq(len(course), time[1])
    for centre in (0.15, 0.3, 0.6):
        near = (frequency > 0.85 * centre) & (frequency < 1.15 * centre)
        assert power[near].sum() > 0.1 * power.sum()


def test_two_poses_take_the_load_to_its_extremes():
    machine = driven_arm(3)
    base = reduce_parameters(machine)
    values = base.from_standard(np.tile([20, -7, 0, 0, 0.1, 0, 0, 3.0, 0, 3.0], 3))

    def holding(q):
        tau = base_regressor(machine, base, q, np.zeros_like(q), np.zeros_like(q)) @ values
        return tau / np.column_stack([lever_arm(j.cylinder.linkage, q[:, i]) for i, j in enumerate(machine.joints)])

    made = experiment(Arm(machine, 0, seconds=60.0, holding=holding), "two_poses")
    _, q, qd, _ = states(machine, made.motion, finer=1)
    strokes = moving(qd, 0) & ~moving(qd, 1) & ~moving(qd, 2)
    poses = np.unique(np.round(q[strokes][:, 1:], 6), axis=0)
    assert len(poses) == 2
    loads = np.abs(holding(q[strokes])[:, 0])
    groups = [loads[np.all(np.abs(q[strokes][:, 1:] - pose) < 1e-5, axis=1)].mean() for pose in poses]
    # As far apart as any of many random poses of the other joints, over the same strokes.
    rng = np.random.default_rng(0)
    course = q[strokes][::40]
    sizes = []
    for pose in rng.uniform(-USE * 0.6, USE * 0.6, (100, 2)):
        course[:, 1:] = pose
        sizes.append(np.abs(holding(course)[:, 0]).mean())
    assert max(groups) > 0.97 * max(sizes)
    assert min(groups) < 1.03 * min(sizes)


def test_the_neighbour_swings_while_the_joint_creeps():
    machine = driven_arm(3)
    made = experiment(Arm(machine, 1, seconds=60.0), "neighbour")
    _, _, qd, _ = states(machine, made.motion)
    speeds = np.sqrt(np.mean(qd**2, axis=0))
    assert speeds[0] > 2 * speeds[1]
    assert speeds[2] > 2 * speeds[1]
    assert moving(qd, 1).mean() > 0.9


def test_the_menu_leaves_out_what_a_machine_cannot_do():
    assert [made.kind for made in menu(Arm(driven_arm(2), 0, seconds=30.0))] == list(KINDS)
    alone = [made.kind for made in menu(Arm(driven_arm(1), 0, seconds=30.0))]
    assert alone == ["staircase", "slow_reversals", "frequencies", "free_cylinder"]
    direct = menu(Arm(planar_machine(kinds="rr", effort="cylinder_force"), 0, seconds=30.0))
    assert [made.kind for made in direct] == list(PINNED)
    with pytest.raises(NotPossibleError, match="no cylinder"):
        experiment(Arm(planar_machine(kinds="rr"), 0), "free_cylinder")
    with pytest.raises(InputError, match="joint 'joint9': test-arm has joint1"):
        joint_numbers(driven_arm(1), ["joint9"])


def test_a_small_supply_makes_experiments_slower_and_a_low_pressure_leaves_them_out():
    machine = driven_arm(2)
    base = reduce_parameters(machine)
    free = experiment(Arm(machine, 0, seconds=30.0), "frequencies")
    _, q, qd, _ = states(machine, free.motion)
    flow = 0.5 * float(supply_flow(machine, q, qd)[0].max())
    slow = experiment(Arm(machine, 0, seconds=30.0, hydraulic=HydraulicLimits(flow=flow)), "frequencies")
    _, q, qd, _ = states(machine, slow.motion)
    assert supply_flow(machine, q, qd)[0].max() <= flow
    assert 1.8 < slow.motion.seconds / free.motion.seconds < 2.6
    assert np.ptp(q[:, 0]) == pytest.approx(np.ptp(free.motion.columns["joint1"]), rel=1e-3)
    heavy = base.from_standard(np.tile([200.0, -70, 0, 0, 1, 0, 0, 30.0, 0, 30.0], 2))
    limits = HydraulicLimits(pressure=1e5, base_parameters=heavy)
    with pytest.raises(NotPossibleError, match=r"joint\d pressure would reach"):
        experiment(Arm(machine, 0, hydraulic=limits), "staircase")
    assert [made.kind for made in menu(Arm(machine, 0, seconds=30.0, hydraulic=limits))] == ["free_cylinder"]


def test_random_series_and_their_neighbours_keep_the_limits():
    machine = driven_arm(3, twisted=True)
    rng = np.random.default_rng(1)
    series = random_series(machine, 20.0, rng, [1])
    for _ in range(8):
        q, qd, qdd = series.states(machine, USE)
        for i, joint in enumerate(machine.joints):
            assert np.abs(q[:, i]).max() <= USE * joint.limits.position[1] * (1 + 1e-9)
            assert np.abs(qd[:, i]).max() <= USE * joint.limits.velocity
            assert np.abs(qdd[:, i]).max() <= USE * joint.limits.acceleration
        np.testing.assert_allclose(qd[[0, -1]], 0.0, atol=1e-9)
        assert np.abs(qd[:, 1]).max() > 0.01
        np.testing.assert_array_equal(series.motion(machine, USE).columns["joint2"], q[:, 1])
        series = varied(series, rng, 0.7)
