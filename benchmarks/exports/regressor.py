"""Time of the regressor that stage 2 needs, beside a Pinocchio loop over ``computeJointTorqueRegressor``.

Two arms of six revolute joints: twists of 0 and 90 degrees with every offset filled (the general case, 36 base
parameters or more), and six parallel axes (18). Target: at most a third of the loop's time, both taken in one run.
Pinocchio comes with the extra ``bench``; without it only our time is shown.
"""

from __future__ import annotations

import timeit
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from benchmarks.exports.model import TWISTED, installed
from benchmarks.targets import Check, Outcome
from daq.machine.machine_file import Machine
from fitting.arm.base_parameters import base_regressor, reduce_parameters
from fitting.arm.dynamics import rigid_body_regressor
from fitting.arm.geometry import Geometry, geometry_of
from fitting.arrays import FloatArray

TWISTS = {"six parallel axes": (0.0,) * 6, "six axes, twisted": TWISTED}


def regressor(samples: int, repeats: int, machine: Machine | None) -> Outcome:
    """Time both arms, or a machine of one's own."""
    peer = installed("pinocchio")
    arms = {name: _articulated_arm(twists) for name, twists in TWISTS.items()}
    if machine is not None:
        arms = {machine.name: geometry_of(machine)}
    rng = np.random.default_rng(0)
    found = []
    for name, geometry in arms.items():
        base = reduce_parameters(geometry)
        motion = rng.uniform(-1, 1, (3, samples, geometry.joints))
        needed = min(timeit.repeat(partial(base_regressor, geometry, base, *motion), number=1, repeat=repeats))
        whole = min(timeit.repeat(partial(rigid_body_regressor, geometry, *motion), number=1, repeat=repeats))
        shown = f"{1e3 * needed:.1f} ms for {len(base)} columns ({1e3 * whole:.1f} ms for all {10 * geometry.joints})"
        found.append(Check(f"{name}: {samples} samples", needed, shown))
        ratio, text = None, "Pinocchio is not installed (pip install 'hilfit[bench]')"
        if peer is not None:
            theirs = min(timeit.repeat(_pinocchio_loop(peer, geometry, motion), number=1, repeat=max(3, repeats // 3)))
            ratio, text = needed / theirs, f"{needed / theirs:.2f} of {1e3 * theirs:.1f} ms"
        found.append(Check(f"{name}: of the Pinocchio loop's time", ratio, text, "at most", 1 / 3, "a third"))
    return Outcome(tuple(found))


def _articulated_arm(twists: tuple[float, ...]) -> Geometry:
    """Make an arm of revolute joints with the given twist angles (rad) and unequal link lengths."""
    n, flat = len(twists), not np.any(twists)
    return Geometry(
        revolute=np.ones(n, dtype=np.bool_),
        a=np.linspace(0.9, 0.3, n),
        alpha=np.array(twists),
        d=np.zeros(n) if flat else np.linspace(0.1, 0.4, n),
        theta=np.linspace(0.2, -0.4, n),
        gravity=np.array([0.0, -9.81, 0.0] if flat else [0.0, 0.0, -9.81]),
        position_limits=np.tile([-1.0, 1.0], (n, 1)),
        velocity_limits=np.ones(n),
        acceleration_limits=np.ones(n),
        names=tuple(f"joint{number + 1}" for number in range(n)),
    )


def _pinocchio_loop(pinocchio: Any, geometry: Geometry, motion: FloatArray) -> Callable[[], FloatArray]:
    """Build the usual loop, filling an array of shape (N, n, 10 n)."""
    model = pinocchio.Model()
    parent = 0
    placement = pinocchio.SE3.Identity()
    for i in range(geometry.joints):
        turn = pinocchio.SE3(pinocchio.utils.rotate("z", float(geometry.theta[i])), np.zeros(3))
        joint = pinocchio.JointModelRZ() if geometry.revolute[i] else pinocchio.JointModelPZ()
        parent = model.addJoint(parent, joint, placement * turn, geometry.names[i])
        model.appendBodyToJoint(parent, pinocchio.Inertia.Random(), pinocchio.SE3.Identity())
        twist = pinocchio.utils.rotate("x", float(geometry.alpha[i]))
        placement = pinocchio.SE3(twist, np.array([geometry.a[i], 0.0, geometry.d[i]]))
    data = model.createData()
    q, qd, qdd = (np.ascontiguousarray(values) for values in motion)
    out = np.empty((q.shape[0], geometry.joints, 10 * geometry.joints))

    def run() -> FloatArray:
        for k in range(q.shape[0]):
            out[k] = pinocchio.computeJointTorqueRegressor(model, data, q[k], qd[k], qdd[k])
        return out

    return run
