"""Supply flow and chamber pressures: what they are, and that motions keep them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from arm_examples import driven_arm

from daq.errors import InputError
from fitting.arm.base_parameters import base_regressor, reduce_parameters
from fitting.arm.linkage import lever_arm
from fitting.excitation.design import _shrink, design_motion
from fitting.excitation.limits import HydraulicLimits, chamber_pressure, supply_flow
from fitting.excitation.problem import ExcitationOptions, pose_problem

QUICK = ExcitationOptions(seconds=12.0, starts=1, iterations=15, samples=60, harmonics=5)


def test_supply_flow_is_the_swept_volume():
    """Extending fills the head side, retracting the rod side; the derivatives are those of the flow."""
    machine = driven_arm(2)
    cylinder = machine.joints[0].cylinder
    q, qd = np.array([[0.1, -0.2], [0.1, -0.2]]), np.array([[0.3, 0.0], [-0.3, 0.0]])
    flow, by_q, by_qd = supply_flow(machine, q, qd)
    speed = abs(float(lever_arm(cylinder.linkage, 0.1)) * 0.3)
    np.testing.assert_allclose(flow, [cylinder.head_area * speed, cylinder.rod_area * speed], rtol=1e-12)
    h = 1e-6
    step = np.array([[h, 0.0]])
    np.testing.assert_allclose(
        (supply_flow(machine, q + step, qd)[0] - supply_flow(machine, q - step, qd)[0]) / (2 * h), by_q[:, 0], rtol=1e-6
    )
    np.testing.assert_allclose(
        (supply_flow(machine, q, qd + step)[0] - supply_flow(machine, q, qd - step)[0]) / (2 * h),
        by_qd[:, 0],
        rtol=1e-6,
    )


def test_chamber_pressure_balances_the_load():
    cylinder = driven_arm(1).joints[0].cylinder
    q = np.array([0.1, 0.1])
    r = lever_arm(cylinder.linkage, q)
    tau = np.array([1000.0, -1000.0])
    pressure, _, _ = chamber_pressure(cylinder, q, tau, 50.0, 2e5)
    force = np.abs(tau / r)
    pushing = pressure[0] * cylinder.head_area - 2e5 * cylinder.rod_area - 50.0
    pulling = pressure[1] * cylinder.rod_area - 2e5 * cylinder.head_area - 50.0
    np.testing.assert_allclose([pushing, pulling], force, rtol=1e-12)


def test_a_pressure_limit_needs_parameters():
    with pytest.raises(ValueError, match="needs base_parameters"):
        HydraulicLimits(pressure=1e7)


@pytest.mark.slow
def test_flow_and_pressure_are_kept():
    machine = driven_arm(3)
    base = reduce_parameters(machine)
    free = design_motion(machine, base, options=QUICK)
    q, qd = free.motion.joint_positions(machine), free.speed
    wanted = supply_flow(machine, q, qd)[0].max()
    guess = base.from_standard(np.tile([20, 2, 0, 0, 0.1, 0, 0, 0.2, 0, 0.3], 3))
    tau = base_regressor(machine, base, q, qd, free.acceleration) @ guess
    pressures = [
        chamber_pressure(j.cylinder, q[:, i], tau[:, i], 0.0, 0.0)[0].max() for i, j in enumerate(machine.joints)
    ]
    limits = HydraulicLimits(flow=0.7 * wanted, pressure=1.02 * max(pressures), base_parameters=guess)
    kept = design_motion(machine, base, options=QUICK, hydraulic=limits)
    q, qd = kept.motion.joint_positions(machine), kept.speed
    assert supply_flow(machine, q, qd)[0].max() <= QUICK.use * limits.flow
    tau = base_regressor(machine, base, q, qd, kept.acceleration) @ guess
    for i, joint in enumerate(machine.joints):
        assert chamber_pressure(joint.cylinder, q[:, i], tau[:, i], 0.0, 0.0)[0].max() <= QUICK.use * limits.pressure
    assert {"flow", "pressure"} <= {use.quantity for use in kept.limits}


def test_a_motion_moves_to_mid_range_where_holding_beside_it_takes_all_of_the_pressure():
    machine = driven_arm(2)
    base = reduce_parameters(machine)
    guess = base.from_standard(np.tile([20, 2, 0, 0, 0.1, 0, 0, 0.2, 0, 0.3], 2))

    def holding(q: np.ndarray) -> float:
        tau = base_regressor(machine, base, q[None], np.zeros((1, 2)), np.zeros((1, 2)))[0] @ guess
        each = [
            chamber_pressure(j.cylinder, q[i : i + 1], tau[i : i + 1], 0.0, 0.0) for i, j in enumerate(machine.joints)
        ]
        return max(float(own[0].max()) for own in each)

    problem = pose_problem(machine, base, QUICK, None, None, HydraulicLimits(), np.random.default_rng(0))
    aside = [problem.middle + 0.6 * problem.half * np.array(way) for way in ((1, 1), (1, -1), (-1, 1), (-1, -1))]
    home = max(aside, key=holding)
    assert holding(home) > 1.06 * holding(problem.middle)
    limits = HydraulicLimits(pressure=holding(home) / 0.96, base_parameters=guess)
    problem = replace(problem, hydraulic=limits)
    moving = 1e-3 * np.ones((3, 50, 2)) * np.sin(np.linspace(0, 6, 50))[:, None]
    place, factor = _shrink(problem, home, moving)
    assert 0.5 < factor < 1
    np.testing.assert_allclose(place, problem.middle + factor * (home - problem.middle))
    assert holding(place) <= 0.95 * limits.pressure
    quiet = replace(problem, hydraulic=replace(limits, pressure=2 * limits.pressure))
    np.testing.assert_array_equal(_shrink(quiet, home, moving)[0], home)


def test_a_pressure_that_no_motion_keeps_is_refused():
    machine = driven_arm(2)
    base = reduce_parameters(machine)
    heavy = base.from_standard(np.tile([500.0, 0, 0, 0, 0, 0, 0, 0, 0, 0], 2))
    with pytest.raises(InputError, match="however small the motion"):
        design_motion(machine, base, options=QUICK, hydraulic=HydraulicLimits(pressure=1e5, base_parameters=heavy))
