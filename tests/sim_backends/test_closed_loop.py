"""The simulated arm under a position controller: it holds, it feels a force on the tip, its transducers say so."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import sim_backends
from daq.machine.machine_file import load_machine
from sim_backends.plant.closed_loop import ClosedLoop
from sim_backends.plant.motion import Motion
from sim_backends.plant.truth import SensorQuality, load_truth

ROOM = Path(sim_backends.__file__).parent / "machines"
MACHINE, TRUTH = load_machine(ROOM / "folding_arm.yaml"), load_truth(ROOM / "folding_arm.truth.yaml")


@pytest.fixture(scope="module")
def loop() -> ClosedLoop:
    return ClosedLoop(MACHINE, TRUTH)


def tip(q: np.ndarray) -> np.ndarray:
    """Forward kinematics written out: distal Denavit-Hartenberg."""
    pose = np.eye(4)
    for joint, angle in zip(MACHINE.joints, q, strict=True):
        c, s = np.cos(angle + joint.dh.theta), np.sin(angle + joint.dh.theta)
        ca, sa = np.cos(joint.dh.alpha), np.sin(joint.dh.alpha)
        turn = np.array([[c, -s * ca, s * sa, joint.dh.a * c], [s, c * ca, -c * sa, joint.dh.a * s]])
        pose = pose @ np.vstack([turn, [[0, sa, ca, joint.dh.d], [0, 0, 0, 1]]])
    return pose[:3, 3]


def test_a_force_on_the_tip_is_felt_as_virtual_work_says(loop: ClosedLoop) -> None:
    q, force = np.array([0.2, -0.3, 0.4, -0.1, 0.25, 0.15]), np.array([30.0, -70.0, 0.0])
    steps = 1e-6 * np.eye(6)
    work = [force @ (tip(q + step) - tip(q - step)) / 2e-6 for step in steps]
    np.testing.assert_allclose(loop.tip_efforts(q, force), work, rtol=1e-6, atol=1e-6)


@pytest.mark.slow
def test_it_holds_its_pose_and_its_transducers_say_with_which_force(loop: ClosedLoop) -> None:
    q = np.array([0.1, -0.1, 0.2, 0.0, 0.1, -0.2])
    time = np.linspace(0.0, 0.3, 16)
    still = Motion(MACHINE.name, "pinned", tuple(j.name for j in MACHINE.joints), time, np.tile(q, (16, 1)))
    run = loop.follow(still, loop.gains())
    np.testing.assert_allclose(run.q, np.tile(q, (len(run.q), 1)), atol=1e-6)
    said = loop.record(run, SensorQuality.perfect(), np.random.default_rng(0))
    assert len(said["time"]) == round(0.3 * MACHINE.rate_hz)
    for number, joint in enumerate(MACHINE.joints):
        cylinder = joint.cylinder
        assert cylinder is not None
        force = said[f"{joint.name}.head_pressure"] * cylinder.head_area
        force -= said[f"{joint.name}.rod_pressure"] * cylinder.rod_area
        np.testing.assert_allclose(force[-1], loop.holding(q)[number], rtol=1e-3, atol=0.5)
