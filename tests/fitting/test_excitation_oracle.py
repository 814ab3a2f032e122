"""Every limit, checked on the written file by means that designs do not use.

Rows of the motion file are joined by a quintic spline and looked at on a grid twenty times as fine: speeds and
accelerations are finite differences there, pistons are distances between pins in the complex plane, flow is the volume
that they sweep, and loads are those of point masses by d'Alembert's principle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from arm_examples import driven_arm
from scipy.interpolate import make_interp_spline

from daq.motion_files import read_motion, write_motion
from fitting.arm.base_parameters import reduce_parameters
from fitting.excitation.cylinders import CylinderOptions, design_cylinder_motion
from fitting.excitation.design import design_motion, design_sequence
from fitting.excitation.experiments import Arm, experiment
from fitting.excitation.limits import HydraulicLimits
from fitting.excitation.problem import ExcitationOptions

FINER = 20
JOINTS = 3
# Point masses (kg) per link, at places (m) in the link's frame, which stands at the link's far end.
MASSES = np.array([6.0, 4.0, 3.0])
PLACES = np.array([-0.5 + 0.1j, -0.2 - 0.1j, 0.05 + 0.15j])
GRAVITY = -9.81j
BORE, ROD, STROKE, A, B, OFFSET, RETRACTED = 0.08, 0.045, 0.3, 0.45, 0.16, 1.7, 0.37  # of driven_arm
HEAD, RING = np.pi / 4 * BORE**2, np.pi / 4 * (BORE**2 - ROD**2)
FRICTION, BACK = 250.0, 4e5


@dataclass(frozen=True)
class Reached:
    """Extremes of a motion, per joint; flow for all."""

    position: np.ndarray
    speed: np.ndarray
    acceleration: np.ndarray
    piston: np.ndarray  # (2, n): lowest, highest
    pressure: np.ndarray
    flow: float


def piston(q):
    return np.abs(A - B * np.exp(1j * (q + OFFSET))) - RETRACTED


def loads(q, dt):
    """Efforts (N, n): virtual work of ``m (p'' - g)`` of every point mass in a turn about every joint before it."""
    lengths = [0.8 - 0.1 * i for i in range(JOINTS)]
    direction = np.exp(1j * np.cumsum(q, axis=1))
    ends = np.cumsum(lengths * direction, axis=1)
    pivots = np.hstack([np.zeros((len(q), 1)), ends[:, :-1]])
    tau = np.zeros(q.shape)
    for link in range(JOINTS):
        for m, place in zip(MASSES, PLACES, strict=True):
            p = ends[:, link] + place * direction[:, link]
            force = m * (np.gradient(np.gradient(p, dt), dt) - GRAVITY)
            for j in range(link + 1):
                tau[:, j] += (force * np.conj(1j * (p - pivots[:, j]))).real
    return tau


def reached(machine, motion):
    rest = [(order, np.zeros(JOINTS)) for order in (1, 2)]
    law = make_interp_spline(motion.time, motion.joint_positions(machine), k=5, bc_type=(rest, rest))
    time = np.linspace(0, motion.seconds, FINER * (len(motion.time) - 1) + 1)
    dt = time[1]
    q = law(time)
    qd = np.gradient(q, dt, axis=0)
    x = piston(q)
    speed = np.gradient(x, dt, axis=0)
    h = 1e-6
    force = loads(q, dt) / ((piston(q + h) - piston(q - h)) / (2 * h))
    push = (force + FRICTION + BACK * RING) / HEAD
    pull = (-force + FRICTION + BACK * HEAD) / RING
    inner = slice(3, -3)  # one-sided differences at the ends
    return Reached(
        position=np.abs(q).max(axis=0),
        speed=np.abs(qd).max(axis=0),
        acceleration=np.abs(np.gradient(qd, dt, axis=0))[inner].max(axis=0),
        piston=np.stack([x.min(axis=0), x.max(axis=0)]),
        pressure=np.maximum(push, pull)[inner].max(axis=0),
        flow=float(np.where(speed > 0, HEAD * speed, -RING * speed).sum(axis=1).max()),
    )


def standard():
    """The same point masses as link parameters about the link frame's origin, [m, mx, my, mz, Ixx, ..., Izz]."""
    m, x, y = MASSES, PLACES.real, PLACES.imag
    xx, xy, yy = m @ y**2, -m @ (x * y), m @ x**2
    return np.tile([m.sum(), m @ x, m @ y, 0, xx, xy, 0, yy, 0, xx + yy], JOINTS)


def arm():
    machine = driven_arm(JOINTS)
    base = reduce_parameters(machine)
    return machine, base, base.from_standard(standard())


def written(motion, machine, tmp_path):
    write_motion(tmp_path / "motion.csv", motion)
    return read_motion(tmp_path / "motion.csv", machine)


def check(machine, found, use, limits, slack):
    for j, joint in enumerate(machine.joints):
        assert found.position[j] <= use * joint.limits.position[1] * (1 + slack)
        assert found.speed[j] <= use * joint.limits.velocity * (1 + slack)
        assert found.acceleration[j] <= use * joint.limits.acceleration * (1 + slack)
        assert found.piston[0, j] >= 0
        assert found.piston[1, j] <= STROKE
    if limits.flow is not None:
        assert found.flow <= use * limits.flow * (1 + slack)
    if limits.pressure is not None:
        assert found.pressure.max() <= use * limits.pressure * (1 + slack)


OPTIONS = ExcitationOptions(seconds=12.0, starts=2, iterations=40, samples=60, harmonics=6)


@pytest.mark.slow
def test_a_motion_with_all_limits_keeps_them_and_reports_what_it_reaches(tmp_path):
    machine, base, values = arm()
    free = reached(machine, written(design_motion(machine, base, options=OPTIONS).motion, machine, tmp_path))
    limits = HydraulicLimits(0.6 * free.flow, 0.85 * free.pressure.max(), BACK, values, np.full(JOINTS, FRICTION))
    first, second = design_sequence(machine, base, 2, options=OPTIONS, hydraulic=limits)
    for made in (first, second):
        found = reached(machine, written(made.motion, machine, tmp_path))
        check(machine, found, OPTIONS.use, limits, 1e-3)
        said = {(use.joint, use.quantity): use.reached for use in made.limits}
        assert said[(None, "flow")] == pytest.approx(found.flow, rel=2e-3)
        for j, joint in enumerate(machine.joints):
            assert abs(said[(joint.name, "position")]) == pytest.approx(found.position[j], rel=1e-3)
            assert said[(joint.name, "velocity")] == pytest.approx(found.speed[j], rel=1e-3)
            assert said[(joint.name, "acceleration")] == pytest.approx(found.acceleration[j], rel=3e-3)
            assert said[(joint.name, "pressure")] == pytest.approx(found.pressure[j], rel=2e-3)
            assert np.abs(found.piston[:, j] - said[(joint.name, "stroke")]).min() < 1e-4
    # Both bind: a motion of the same arm without them takes more.
    assert max(use.used for use in first.limits if use.quantity == "flow") > 0.9 * OPTIONS.use
    assert max(use.used for use in first.limits if use.quantity == "pressure") > 0.9 * OPTIONS.use


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["staircase", "slow_reversals", "frequencies", "two_poses", "neighbour"])
def test_an_experiment_keeps_flow_and_pressure(kind, tmp_path):
    machine, base, values = arm()
    free = reached(machine, experiment(Arm(machine, 1, seconds=30.0), kind).motion)
    limits = HydraulicLimits(0.6 * free.flow, 1.1 * free.pressure.max(), BACK, values, np.full(JOINTS, FRICTION))
    made = experiment(Arm(machine, 1, seconds=30.0, hydraulic=limits, base=base), kind)
    found = reached(machine, written(made.motion, machine, tmp_path))
    check(machine, found, 0.92, limits, 0.01)
    assert made.motion.seconds > 1.2 * 30.0


def test_free_cylinders_keep_the_flow_that_they_share(tmp_path):
    machine, _, _ = arm()
    options = CylinderOptions(seconds=30.0, starts=1)

    def flow(motion):
        x = np.stack([motion.columns[joint.name] for joint in machine.joints], axis=1)
        law = make_interp_spline(motion.time, x, k=5)
        time = np.linspace(0, motion.seconds, FINER * (len(motion.time) - 1) + 1)
        speed = np.gradient(law(time), time[1], axis=0)[5:-5]
        return float(np.where(speed > 0, HEAD * speed, -RING * speed).sum(axis=1).max()), law(time)

    most, _ = flow(design_cylinder_motion(machine, options=options).motion)
    made = design_cylinder_motion(machine, options=options, flow=0.5 * most)
    taken, x = flow(written(made.motion, machine, tmp_path))
    assert 0.7 * 0.5 * most < taken <= 0.5 * most
    low, high = piston(np.array([-0.6, 0.6]))
    assert x.min() >= min(low, high) - 1e-6
    assert x.max() <= max(low, high) + 1e-6
