"""URDF and MJCF: other engines calculate the efforts of the links that the model has."""

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from arm_examples import inverse_dynamics
from model_examples import model_with, session_of, term_of, true_model
from synthetic_arm import truth

from daq.errors import InputError
from fitting.arm.base_parameters import base_regressor
from fitting.model import motion
from fitting.model.arm_model import ArmModel
from fitting.model.export import export_model
from fitting.model.export.bodies import bodies_of
from fitting.model.export.functions import states
from fitting.regression.body_prior import pseudo_inertia

mujoco = pytest.importorskip("mujoco")
pytestmark = pytest.mark.skipif(find_spec("cvxpy") is None, reason="cvxpy is not installed")


def links_alone(model: ArmModel, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
    """What the links of the model take."""
    regressor = base_regressor(model.arm, model.base, q, qd, qdd)
    return np.asarray(regressor @ model.theta[model.parameters.base_slice])


def mujoco_efforts(path: Path, gravity: Any, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
    plant = mujoco.MjModel.from_xml_path(str(path))
    plant.opt.gravity[:] = gravity
    plant.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT  # dry friction is one there
    plant.dof_damping[:] = 0.0
    plant.dof_armature[:] = 0.0
    plant.tendon_stiffness[:] = plant.tendon_damping[:] = plant.tendon_armature[:] = 0.0
    data = mujoco.MjData(plant)
    rows = []
    for data.qpos[:], data.qvel[:], data.qacc[:] in zip(q, qd, qdd, strict=True):
        mujoco.mj_inverse(plant, data)
        rows.append(data.qfrc_inverse.copy())
    return np.array(rows)


def pinocchio_efforts(path: Path, gravity: Any, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
    pinocchio = pytest.importorskip("pinocchio")
    plant = pinocchio.buildModelFromUrdf(str(path))
    plant.gravity.linear = np.array(gravity)
    data = plant.createData()
    return np.array([pinocchio.rnea(plant, data, *row) for row in zip(q, qd, qdd, strict=True)])


@pytest.fixture(scope="module", params=["RR", "RPR", "rR"])
def possible(request: pytest.FixtureRequest) -> ArmModel:
    """Arms whose links are bodies: their parameters are the true ones."""
    kinds = request.param
    session = session_of(len(kinds), kinds)
    arm = truth(len(kinds))
    model = model_with((), session)
    theta = model.theta.copy()
    theta[model.parameters.base_slice] = model.base.from_standard(arm.pi)
    return replace(model, passes=(replace(model.passes[-1], theta=theta),))


ENGINES = [("urdf", mujoco_efforts), ("mjcf", mujoco_efforts), ("urdf", pinocchio_efforts)]


@pytest.mark.slow
@pytest.mark.parametrize(("to", "efforts"), ENGINES)
def test_engines_agree_with_the_links(possible: ArmModel, to: str, efforts: Any, tmp_path: Path) -> None:
    path = tmp_path / f"arm.{to}"
    done = export_model(possible, to, path)
    q, qd, qdd, _ = states(possible, 20)
    found = efforts(path, possible.arm.gravity, q, qd, qdd)
    expected = links_alone(possible, q, qd, qdd)
    assert np.max(np.abs(found - expected)) <= 1e-6 * np.max(np.abs(expected))
    cylinders = sum(joint.cylinder is not None for joint in possible.arm.joints)
    assert sum("cylinder of" in line for line in done.left_out) == (cylinders if to == "urdf" else 0)
    assert sum("root of speed" in line for line in done.left_out) == (cylinders if to == "mjcf" else 0)
    text = path.read_text(encoding="utf-8")
    assert all(line in text for line in done.left_out)


@pytest.mark.slow
def test_links_can_exist_and_have_the_base_parameters(possible: ArmModel) -> None:
    bodies = bodies_of(possible)
    assert bodies.apart is None
    assert all(np.linalg.eigvalsh(pseudo_inertia(row)).min() > 0 for row in bodies.standard)
    q, qd, qdd, _ = states(possible, 10)
    expected = links_alone(possible, q, qd, qdd)
    np.testing.assert_allclose(
        inverse_dynamics(possible.arm, bodies.standard, q, qd, qdd), expected, rtol=1e-7, atol=1e-7
    )


def test_impossible_links_are_replaced_and_it_is_said(tmp_path: Path) -> None:
    session = session_of(2)
    model = true_model(session.machine, truth(2), session)
    theta = model.theta.copy()
    place = model.parameters.base_slice.start + model.base.names.index("ZZ2")
    # With MX2 + 0.65 m2 = 5.73 kg m, ZZ2 - 0.4225 m2 of a body is above -1.3 times that: ZZ2 > (MX2^2) / m2.
    theta[place] = -20.0
    model = replace(model, passes=(replace(model.passes[-1], theta=theta),))
    with pytest.raises(InputError, match="--possible writes the nearest") as caught:
        export_model(model, "urdf", tmp_path / "arm.urdf")
    assert "\n" not in str(caught.value) and not list(tmp_path.iterdir())
    done = export_model(model, "urdf", tmp_path / "arm.urdf", possible=True)
    bodies = bodies_of(model, possible=True)
    (line,) = (line for line in done.left_out if "representative of the base parameters" in line)
    assert bodies.apart is not None and model.seen is not None
    seen = model.seen.q, model.seen.qd, model.seen.qdd
    apart = inverse_dynamics(model.arm, bodies.standard, *seen) - links_alone(model, *seen)
    np.testing.assert_allclose(bodies.apart, np.sqrt(np.mean(apart**2, axis=0)), rtol=1e-6)
    assert all(f"{name} {value:.3g} N m" in line for name, value in zip(model.joints, bodies.apart, strict=True))
    assert all(np.linalg.eigvalsh(pseudo_inertia(row)).min() > 0 for row in bodies.standard)
    q, qd, qdd, _ = states(model, 10)
    found = mujoco_efforts(tmp_path / "arm.urdf", model.arm.gravity, q, qd, qdd)
    own = inverse_dynamics(model.arm, bodies.standard, q, qd, qdd)
    assert np.max(np.abs(found - own)) <= 1e-6 * np.max(np.abs(own))


def test_drives_that_act_directly_bring_their_friction(tmp_path: Path) -> None:
    session = session_of(2, "rR")
    model = model_with([term_of(session, "stribeck", 0)], session)
    done = export_model(model, "mjcf", tmp_path / "arm.xml")
    plant = mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml"))
    values = dict(zip(model.parameters.drive[0], model.theta, strict=False))
    assert plant.dof_damping[0] == pytest.approx(max(values["f_v"], 0.0))
    assert plant.dof_frictionloss[0] == pytest.approx(max(values["f_c"], 0.0))
    assert plant.dof_damping[1] == 0.0
    assert not any("drive of joint1" in line for line in done.left_out)
    assert any("Stribeck" in line or "joint1" in line for line in done.left_out)


def test_a_tilted_base_tilts_the_gravity_of_every_engine(tmp_path: Path) -> None:
    session = session_of(2)
    model = model_with([term_of(session, "base_tilt", 0)], session)
    theta = model.theta.copy()
    theta[model.parameters.base_slice] = model.base.from_standard(truth(2).pi)
    model = replace(model, passes=(*model.passes[:-1], replace(model.passes[-1], theta=theta)))
    export_model(model, "mjcf", tmp_path / "arm.xml")
    plant = mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml"))
    tilt = theta[len(model.parameters) :]
    assert np.linalg.norm(plant.opt.gravity - np.array(model.arm.gravity)) == pytest.approx(
        9.81 * np.linalg.norm(tilt), rel=1e-9
    )
    (line,) = (own for own in export_model(model, "urdf", tmp_path / "arm.urdf").left_out if "no place for" in own)
    assert f"{plant.opt.gravity[0]:.6g}" in line and "tilt" not in line


@pytest.mark.slow
def test_pressures_move_the_arm_in_mujoco_as_the_model_says(possible: ArmModel, tmp_path: Path) -> None:
    """Cylinders are tendons: linkage, areas, mass, stiffness, damping; dry friction and the root of speed put aside."""
    names = possible.parameter_names
    theta = np.array([
        0.0 if name.endswith((".f_c", ".f_s")) else abs(value) if number < possible.parameters.drive_count else value
        for number, (name, value) in enumerate(zip(names, possible.theta, strict=True))
    ])  # fmt: skip
    model = replace(possible, passes=(replace(possible.passes[-1], theta=theta),))
    export_model(model, "mjcf", tmp_path / "arm.xml")
    plant = mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml"))
    data = mujoco.MjData(plant)
    q, qd, _, _ = states(model, 12)
    rng, n = np.random.default_rng(4), len(model.joints)
    pressures = rng.uniform(1e5, 5e6, (len(q), n, 2))
    direct = rng.uniform(-50.0, 50.0, (len(q), n))
    effort = direct.copy()
    for joint, own in enumerate(model.arm.joints):
        if own.cylinder is not None:
            force = pressures[:, joint] @ [own.cylinder.head_area, -own.cylinder.rod_area]
            effort[:, joint] = motion.levers(model, q)[:, joint] * force
    expected = motion.forward(model, q, qd, effort=effort)
    for row in range(len(q)):
        data.qpos[:], data.qvel[:] = q[row], qd[row]
        data.qfrc_applied[:] = [direct[row, k] if j.cylinder is None else 0.0 for k, j in enumerate(model.arm.joints)]
        for joint, own in enumerate(model.arm.joints):
            if own.cylinder is not None:
                data.actuator(f"{own.name}_head").ctrl[0], data.actuator(f"{own.name}_rod").ctrl[0] = pressures[
                    row, joint
                ]
        mujoco.mj_forward(plant, data)
        np.testing.assert_allclose(data.qacc, expected[row], rtol=1e-6, atol=1e-6 * np.max(np.abs(expected)))
