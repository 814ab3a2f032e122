"""Signals for free cylinders: band-limited, and a staircase."""

from __future__ import annotations

import numpy as np
import pytest
from arm_examples import driven_arm
from scipy.interpolate import make_interp_spline

from daq.errors import InputError
from fitting.arm.base_parameters import condition_number
from fitting.excitation.cylinders import CylinderOptions, design_cylinder_motion, piston_limits, stage_one_columns


def test_free_cylinders_keep_stroke_speed_and_acceleration():
    machine = driven_arm(2)
    found = design_cylinder_motion(machine, options=CylinderOptions(seconds=40.0))
    assert found.motion.rods == "unpinned"
    fine = np.linspace(0, 40.0, 20001)
    for joint in machine.joints:
        (low, high), top_speed, top_acceleration = piston_limits(joint)
        x = found.motion.columns[joint.name]
        law = make_interp_spline(found.motion.time, x, k=5, bc_type=([(1, 0.0), (2, 0.0)], [(1, 0.0), (2, 0.0)]))
        assert low <= law(fine).min()
        assert law(fine).max() <= high
        assert np.abs(law.derivative(1)(fine)).max() <= top_speed
        assert np.abs(law.derivative(2)(fine)).max() <= top_acceleration
        np.testing.assert_allclose(law.derivative(1)(found.motion.time), found.speed[joint.name], atol=2e-4)
        # Most of the stroke that the joint uses later, and ends at rest.
        assert x.max() - x.min() > 0.9 * (high - low)
        assert x[0] == pytest.approx(x[-1], abs=1e-9)
        np.testing.assert_allclose([found.speed[joint.name][k] for k in (0, -1)], 0.0, atol=1e-9)
        W = stage_one_columns(x, found.speed[joint.name], found.acceleration[joint.name])
        assert found.condition_numbers[joint.name] == pytest.approx(condition_number(W), rel=1e-6)


def test_a_staircase_holds_constant_speeds_over_two_decades():
    machine = driven_arm(1)
    found = design_cylinder_motion(machine, options=CylinderOptions(seconds=60.0, staircase=0.5, starts=1))
    stairs = found.motion.time > 30.0
    speed, acceleration = found.speed["joint1"][stairs], found.acceleration["joint1"][stairs]
    constant = np.abs(acceleration) < 1e-12
    moving = constant & (np.abs(speed) > 1e-12)
    levels = np.unique(np.round(np.abs(speed[moving]), 9))
    assert len(levels) == 6
    assert levels[-1] / levels[0] > 15
    assert moving.mean() > 0.4
    for level in levels:  # both ways, for friction that differs with direction
        assert {1.0, -1.0} == set(np.sign(speed[moving & np.isclose(np.abs(speed), level, rtol=1e-6)]))


def test_slow_reversals_and_fast_strokes_are_both_there():
    machine = driven_arm(1)
    found = design_cylinder_motion(machine, options=CylinderOptions(seconds=60.0))
    _, top_speed, _ = piston_limits(machine.joints[0])
    share = np.abs(found.speed["joint1"]) / top_speed
    assert share.max() > 0.7
    assert (share < 0.1).mean() > 0.1
    assert np.count_nonzero(np.diff(np.sign(found.speed["joint1"]))) > 10


def test_all_cylinders_take_their_own_course():
    found = design_cylinder_motion(driven_arm(3), options=CylinderOptions(seconds=20.0, starts=1))
    courses = np.array([found.motion.columns[name] for name in ("joint1", "joint2", "joint3")])
    assert np.abs(np.corrcoef(courses)[np.triu_indices(3, 1)]).max() < 0.95
    one = design_cylinder_motion(driven_arm(3), options=CylinderOptions(seconds=20.0, starts=1), joints=["joint2"])
    assert list(one.motion.columns) == ["joint2"]


def test_without_a_staircase_the_band_fills_the_time():
    found = design_cylinder_motion(driven_arm(1), options=CylinderOptions(seconds=20.0, staircase=0.0, starts=1))
    assert found.motion.seconds == pytest.approx(20.0)
    assert np.abs(found.speed["joint1"][-50:]).max() > 0


def test_unpinning_what_has_no_cylinder_is_refused():
    machine = driven_arm(2)
    bare = machine.model_copy(update={"joints": tuple(j.model_copy(update={"cylinder": None}) for j in machine.joints)})
    with pytest.raises(InputError, match="no joint has a cylinder"):
        design_cylinder_motion(bare)
    with pytest.raises(InputError, match="joint 'joint1': has no cylinder"):
        design_cylinder_motion(bare, joints=["joint1"])
    with pytest.raises(InputError, match="too short for a band"):
        CylinderOptions(seconds=2.0)


def test_free_cylinders_share_the_supply():
    """All together stay below the flow, and use most of it; a smaller supply makes them slower, not shorter."""
    machine = driven_arm(3)
    options = CylinderOptions(seconds=30.0, starts=1)

    def flow(found):
        return sum(
            np.where(v > 0, joint.cylinder.head_area, -joint.cylinder.rod_area) * v
            for joint, v in zip(machine.joints, found.speed.values(), strict=True)
        )

    free = flow(design_cylinder_motion(machine, options=options)).max()
    kept = design_cylinder_motion(machine, options=options, flow=0.5 * free)
    assert 0.6 * 0.5 * free < flow(kept).max() <= options.use * 0.5 * free
    used = [use for use in kept.limits if use.quantity == "flow"]
    assert [use.joint for use in used] == [None]
    assert used[0].reached == pytest.approx(flow(kept).max())
