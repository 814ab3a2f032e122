"""Time of the regressor that stage 2 needs, beside a Pinocchio loop over ``computeJointTorqueRegressor``.

``python benchmarks/regressor.py [MACHINE] [--samples N] [--repeats N]``. Without a machine file: an arm of
six revolute joints with twists of 0 and 90 degrees and every offset filled (the general case: 36 base
parameters or more), and one of six parallel axes (18). Pinocchio is optional (``pip install pin``); without
it only our time is shown.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from functools import partial

import numpy as np
import numpy.typing as npt

from daq.machine_file import load_machine
from fitting.base_parameters import base_regressor, reduce_parameters
from fitting.dynamics import rigid_body_regressor
from fitting.geometry import Geometry, geometry_of

try:
    import pinocchio
except ImportError:
    pinocchio = None

FloatArray = npt.NDArray[np.float64]


def articulated_arm(twists: tuple[float, ...]) -> Geometry:
    """An arm of revolute joints with the given twist angles (rad) and unequal link lengths."""
    n = len(twists)
    flat = not np.any(twists)
    return Geometry(
        revolute=np.ones(n, dtype=bool),
        a=np.linspace(0.9, 0.3, n),
        alpha=np.array(twists),
        d=np.zeros(n) if flat else np.linspace(0.1, 0.4, n),
        theta=np.linspace(0.2, -0.4, n),
        gravity=np.array([0.0, -9.81, 0.0] if flat else [0.0, 0.0, -9.81]),
        position_limits=np.tile([-1.0, 1.0], (n, 1)),
        velocity_limits=np.ones(n),
        acceleration_limits=np.ones(n),
        names=tuple(f"joint{i + 1}" for i in range(n)),
    )


def best_time(run: Callable[[], object], repeats: int) -> float:
    """Shortest of ``repeats`` times in seconds."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return min(times)


def pinocchio_loop(geometry: Geometry, motion: FloatArray) -> Callable[[], FloatArray]:
    """The usual loop, filling an array of shape (N, n, 10 n)."""
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


def main() -> None:
    """Print one line per arm: times in milliseconds and, with Pinocchio, the ratio."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("machine", nargs="?")
    parser.add_argument("--samples", type=int, default=10_000)
    parser.add_argument("--repeats", type=int, default=15)
    arguments = parser.parse_args()
    right = np.pi / 2
    arms = {
        "six parallel axes": articulated_arm((0.0,) * 6),
        "six axes, twisted": articulated_arm((right, 0.0, right, -right, right, 0.0)),
    }
    if arguments.machine:
        machine = load_machine(arguments.machine)
        arms = {machine.name: geometry_of(machine)}
    rng = np.random.default_rng(0)
    for name, geometry in arms.items():
        base = reduce_parameters(geometry)
        motion = rng.uniform(-1, 1, (3, arguments.samples, geometry.joints))
        whole = best_time(partial(rigid_body_regressor, geometry, *motion), arguments.repeats)
        needed = best_time(partial(base_regressor, geometry, base, *motion), arguments.repeats)
        line = (
            f"{name}: {len(base)} base columns {1e3 * needed:.1f} ms, "
            f"all {10 * geometry.joints} columns {1e3 * whole:.1f} ms"
        )
        if pinocchio is not None:
            peer = best_time(pinocchio_loop(geometry, motion), max(3, arguments.repeats // 3))
            line += f", Pinocchio loop {1e3 * peer:.1f} ms; ratio {needed / peer:.2f}"
        else:
            line += "; Pinocchio is not installed (pip install pin)"
        print(line)


if __name__ == "__main__":
    main()
