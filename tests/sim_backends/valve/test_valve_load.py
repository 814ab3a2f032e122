"""The load's equations of motion against MuJoCo, which builds the same arm from the machine file by itself."""

from __future__ import annotations

import numpy as np
import pytest

from daq.errors import InputError
from sim_backends.machines import slewing_arm
from sim_backends.plant.arm import Arm, ArmDesign
from sim_backends.plant.truth import CylinderTruth, Truth
from sim_backends.valve.load import load_of
from sim_backends.valve.machines import VALVE_MACHINES, Kind


@pytest.mark.parametrize("kind", VALVE_MACHINES)
def test_the_load_moves_as_mujoco_says(kind: Kind) -> None:
    machine, truth = VALVE_MACHINES[kind](3)
    none = CylinderTruth(0.0, 0.0, 0.0, 0.0, 0.0)  # pistons without mass: the arm alone
    arm = Arm(ArmDesign(machine, Truth(truth.links, dict.fromkeys(truth.cylinders, none))))
    rng = np.random.default_rng(0)
    low, high = np.array([joint.limits.position for joint in machine.joints]).T
    q = rng.uniform(low, high, (20, len(low)))
    qd, qdd = rng.normal(size=(2, *q.shape))
    expected = arm.effort(q, qd, qdd)

    load = load_of([(machine, truth.links)] * len(q))
    pose = load.pose(q.T)
    effort = np.einsum("ijp,jp->ip", pose.mass, qdd.T) + pose.bias(qd.T)

    np.testing.assert_allclose(effort.T, expected, rtol=1e-9, atol=1e-7 * np.abs(expected).max())
    expected_x, expected_v, expected_a, expected_lever = arm.piston(q, qd, qdd)
    np.testing.assert_allclose(pose.x.T, expected_x, atol=1e-9)  # MuJoCo's side is a spline through exact lengths
    np.testing.assert_allclose(pose.lever.T, expected_lever, atol=1e-7)
    np.testing.assert_allclose((pose.lever * qd.T).T, expected_v, atol=1e-7)
    np.testing.assert_allclose((pose.lever * qdd.T + pose.bend * qd.T**2).T, expected_a, atol=1e-4)
    np.testing.assert_allclose(load.joint(pose.x), q.T, atol=1e-12)


def test_an_arm_that_does_not_fold_in_a_plane_is_refused() -> None:
    machine, truth = slewing_arm(0)
    with pytest.raises(InputError, match="slewing-arm: valves are simulated behind arms of parallel horizontal axes"):
        load_of([(machine, truth.links)])
