"""Modified Denavit-Hartenberg tables: against matrices by hand, another engine, and the same arm in standard form."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import mujoco
import numpy as np
import pytest
import yaml
from arm_examples import inverse_dynamics
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic_arm import planar_machine

from daq.machine.machine_file import Machine, MachineFileError, parse_machine
from fitting.arm.base_parameters import base_regressor, reduce_parameters
from fitting.arm.dynamics import rigid_body_regressor, self_check
from fitting.arm.geometry import Geometry, geometry_of, link_frames
from fitting.planning.guess import default_guess
from fitting.regression.plausible_arm import rods
from sim_backends.plant.arm import ArmDesign, arm_xml
from sim_backends.plant.truth import DriveTruth, LinkTruth, Truth

FloatArray = np.ndarray


def machine_of(
    kinds: str, rows: FloatArray, convention: str = "modified", drive: dict[str, object] | None = None
) -> Machine:
    """Joints (``r``, ``p``) without cylinders; ``rows`` are ``a alpha d theta`` (n, 4)."""
    tree = yaml.safe_load(yaml.safe_dump(planar_machine(kinds=kinds).model_dump(mode="json", by_alias=True)))
    tree["convention"] = convention
    for joint, row in zip(tree["joints"], rows, strict=True):
        joint["dh"] = dict(zip(("a", "alpha", "d", "theta"), map(float, row), strict=True))
        joint["drive"] = drive
    tree["gravity"] = [1.2, -9.2, 3.1]
    return parse_machine(yaml.safe_dump(tree))


def random_rows(rng: np.random.Generator, n: int) -> FloatArray:
    return np.column_stack(
        [rng.uniform(-0.6, 0.6, n), rng.uniform(-3, 3, n), rng.uniform(-0.5, 0.5, n), rng.uniform(-3, 3, n)]
    )


def homogeneous(axis: str, angle: float = 0.0, along: float = 0.0) -> FloatArray:
    """``Rx(angle) Tx(along)`` or ``Rz(angle) Tz(along)``, written out."""
    c, s = np.cos(angle), np.sin(angle)
    if axis == "x":
        return np.array([[1, 0, 0, along], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1.0]])
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, along], [0, 0, 0, 1.0]])


@pytest.mark.slow
@given(st.integers(0, 10_000), st.sampled_from(["rrr", "prr", "rpr", "rrp"]))
@settings(max_examples=12, deadline=None)
def test_frames_are_the_product_of_craigs_four_matrices(seed: int, kinds: str) -> None:
    rng = np.random.default_rng(seed)
    rows, q = random_rows(rng, 3), rng.uniform(-2, 2, (4, 3))
    frames = link_frames(machine_of(kinds, rows), q)
    for sample in range(4):
        pose = np.eye(4)
        for i, (a, alpha, d, theta) in enumerate(rows):
            turn, slide = (q[sample, i], 0.0) if kinds[i] == "r" else (0.0, q[sample, i])
            pose = pose @ homogeneous("x", alpha, a) @ homogeneous("z", theta + turn, d + slide)
            np.testing.assert_allclose(frames[sample, i + 1], pose, atol=1e-12)


@pytest.mark.parametrize("kinds", ["rrr", "prr", "rpr", "rrp", "rrrrrr"])
def test_the_regressor_agrees_with_newton_and_euler(kinds: str) -> None:
    machine = machine_of(kinds, random_rows(np.random.default_rng(4), len(kinds)))
    assert self_check(machine) < 1e-11


def test_moments_agree_with_another_engine() -> None:
    """MuJoCo's inverse dynamics of the same arm: bodies and joints made by code that knows no regressor."""
    rng = np.random.default_rng(8)
    machine = machine_of("rpr", random_rows(rng, 3))
    links = []
    for _ in range(3):
        half = rng.normal(size=(3, 3))
        mass, centre = rng.uniform(1, 9), rng.normal(size=3) / 4
        spread = half @ half.T  # second moments of a body, so that the inertia is one that can be
        about = np.trace(spread) * np.eye(3) - spread + mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
        links.append(LinkTruth(mass=mass, moment=tuple(mass * centre), inertia=tuple(about[np.triu_indices(3)])))
    drives = {joint.name: DriveTruth(f_c=0.0, f_v=0.0, inertia=0.0) for joint in machine.joints}
    model = mujoco.MjModel.from_xml_string(arm_xml(ArmDesign(machine, Truth(tuple(links), {}, drives=drives))))
    data = mujoco.MjData(model)
    q, qd, qdd = rng.normal(size=(3, 6, 3))
    expected = []
    for k in range(6):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[k], qd[k], qdd[k]
        mujoco.mj_inverse(model, data)
        expected.append(data.qfrc_inverse.copy())
    pi = np.concatenate([[link.mass, *link.moment, *link.inertia] for link in links])
    np.testing.assert_allclose(rigid_body_regressor(machine, q, qd, qdd) @ pi, expected, atol=1e-9)


def both_forms(rng: np.random.Generator, kinds: str) -> tuple[Machine, Machine, FloatArray]:
    """The same arm in the standard and in the modified convention, and the standard rows."""
    rows = random_rows(rng, len(kinds))
    rows[0, :2] = 0.0  # modified row 1 would turn the base
    standard = np.column_stack([np.vstack([rows[1:, :2], [[0.2, 0.3]]]), rows[:, 2:]])
    return machine_of(kinds, standard, "standard"), machine_of(kinds, rows, "modified"), standard


def in_modified_frames(standard: FloatArray, pi: FloatArray) -> FloatArray:
    """Inertial parameters (10 n,) of links moved from their distal frames to their proximal ones."""
    moved = []
    for (a, alpha, _, _), own in zip(standard, pi.reshape(-1, 10), strict=True):
        T = homogeneous("x", alpha, a)  # distal frame, seen from the proximal one
        R, p, m = T[:3, :3], T[:3, 3], own[0]
        c = own[1:4] / m
        half = np.zeros((3, 3))
        half[np.triu_indices(3)] = own[4:]
        central = half + half.T - np.diag(np.diag(half)) - m * (c @ c * np.eye(3) - np.outer(c, c))
        c = R @ c + p
        about = R @ central @ R.T + m * (c @ c * np.eye(3) - np.outer(c, c))
        moved.append([m, *(m * c), *about[np.triu_indices(3)]])
    return np.concatenate(moved)


@pytest.mark.slow
@given(st.integers(0, 10_000), st.sampled_from(["rrr", "prr", "rpr"]))
@settings(max_examples=6, deadline=None)
def test_one_arm_in_both_conventions(seed: int, kinds: str) -> None:
    rng = np.random.default_rng(seed)
    first, second, standard = both_forms(rng, kinds)
    pi = []
    for _ in kinds:
        half, c, m = rng.normal(size=(3, 3)), rng.normal(size=3), rng.uniform(1, 5)
        about = half @ half.T + m * (c @ c * np.eye(3) - np.outer(c, c))
        pi.append([m, *(m * c), *about[np.triu_indices(3)]])
    pi = np.concatenate(pi)
    q, qd, qdd = rng.normal(size=(3, 40, len(kinds)))
    efforts = inverse_dynamics(first, pi, q, qd, qdd)
    np.testing.assert_allclose(
        inverse_dynamics(second, in_modified_frames(standard, pi), q, qd, qdd), efforts, atol=1e-8
    )
    sets = [reduce_parameters(machine) for machine in (first, second)]
    assert len(sets[0]) == len(sets[1])
    # Fitted to the same efforts, both sets say the same of another motion.
    other = rng.normal(size=(3, 10, len(kinds)))
    said = []
    for machine, base in zip((first, second), sets, strict=True):
        W = base_regressor(machine, base, q, qd, qdd).reshape(-1, len(base))
        theta, *_ = np.linalg.lstsq(W, efforts.ravel(), rcond=None)
        assert np.abs(W @ theta - efforts.ravel()).max() < 1e-7 * np.abs(efforts).max()
        said.append(base_regressor(machine, base, *other) @ theta)
    np.testing.assert_allclose(said[0], said[1], atol=1e-5 * np.abs(said[0]).max())


@pytest.mark.parametrize("kinds", ["rrr", "rpr", "rrp", "prr"])
def test_links_touch_and_lie_along_what_slides(kinds: str) -> None:
    slid = []
    for geometry in (geometry_of(m) for m in both_forms(np.random.default_rng(3), kinds)[:2]):
        frames = link_frames(geometry, np.where(geometry.revolute, 0.0, geometry.position_limits.mean(axis=1)))[1:]
        placed = [
            [np.array([pose[:3, :3] @ end + pose[:3, 3] for end in stretch]) for stretch in own]
            for pose, own in zip(frames, geometry.stretches, strict=True)
        ]
        for before, after, kind in zip(placed[:-1], placed[1:], kinds[1:], strict=True):
            if kind == "p":  # what slides and what guides it lie along each other
                np.testing.assert_allclose(before[-1], after[0], atol=1e-12)
                slid.append(after[0])
            else:
                np.testing.assert_allclose(before[-1][1], after[0][0], atol=1e-12)
    for standard, modified in pairwise(slid):
        np.testing.assert_allclose(standard, modified, atol=1e-12)


def test_a_guess_and_bodies_of_a_modified_arm_are_usable() -> None:
    machine = both_forms(np.random.default_rng(3), "rrr")[1]
    base = reduce_parameters(machine)
    guess = default_guess(machine, base)
    assert np.isfinite(guess.theta).all()
    bodies = rods(geometry_of(machine))
    assert np.linalg.eigvalsh(bodies).min() > 0


def test_a_sensor_behind_the_gear_sees_no_drive_inertia() -> None:
    rows = random_rows(np.random.default_rng(2), 3)
    usual = reduce_parameters(machine_of("rrr", rows), friction_by_stage_1=False)
    behind = reduce_parameters(machine_of("rrr", rows, drive={"effort": "link_side"}), friction_by_stage_1=False)
    assert {"J2", "J3"} <= {usual.standard_names[i] for i in usual.independent}
    assert {"J1", "J2", "J3"} <= set(behind.vanished)
    assert [n for n in usual.names if n[0] != "J"] == list(behind.names)


def test_a_coupled_motor_is_felt_only_before_the_gears() -> None:
    geometry = geometry_of(machine_of("rr", random_rows(np.random.default_rng(2), 2)))
    coupled = replace(geometry, coupled=(1,), coupling=np.array([[0.5, 1.0]]))
    names = reduce_parameters(coupled).names
    assert names[-3:] == ("f_cm2", "f_vm2", "Jm2")
    own_row: Geometry = replace(coupled, link_side=(1,))  # joint 1 still feels motor 2
    assert reduce_parameters(own_row).names[-3:] == ("f_cm2", "f_vm2", "Jm2")
    tree = machine_of("rr", random_rows(np.random.default_rng(2), 2)).model_dump(mode="json", by_alias=True)
    for joint in tree["joints"]:
        joint["drive"] = {"effort": "link_side"}
    tree["joints"][1]["drive"]["coupled"] = [{"joint": "joint1", "ratio": 0.5}]
    assert geometry_of(parse_machine(yaml.safe_dump(tree))).coupled == ()


def test_a_convention_that_is_none() -> None:
    text = yaml.safe_dump(planar_machine(kinds="r").model_dump(mode="json", by_alias=True))
    with pytest.raises(MachineFileError, match=r"convention.*'standard', 'modified'.*'craig'"):
        parse_machine(text.replace("convention: standard", "convention: craig"))
