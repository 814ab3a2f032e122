"""Efforts, gravity, friction, inertia, pressures and accelerations of any motion, against formulas written out."""

from __future__ import annotations

import numpy as np
import pytest
from arm_examples import inverse_dynamics
from hypothesis import given, settings
from hypothesis import strategies as st
from model_examples import model_with, session_of, term_of, true_model
from synthetic_arm import force, make_motion, truth

from daq.errors import InputError
from fitting.arm.linkage import lever_arm
from fitting.model import motion
from fitting.model.arm_model import ArmModel


@pytest.fixture(scope="module")
def exact() -> ArmModel:
    """Two joints with the true parameters."""
    session = session_of(2)
    return true_model(session.machine, truth(2), session)


def test_effort_is_that_of_the_arm_it_was_made_of(exact: ArmModel) -> None:
    moved = make_motion(exact.machine, "validate", 11, 5.0)
    expected = moved.r * force(exact.machine, truth(2), moved)
    found = motion.on_motion(exact, moved.q, moved.qd, moved.qdd)
    np.testing.assert_allclose(found.joint_effort(0), expected, rtol=1e-9, atol=1e-8)
    assert np.all(found.std(0) > found.parameter_std(0)) and np.all(found.parameter_std(0) > 0)


def test_gravity_and_inertia_are_those_of_links_springs_and_pistons(exact: ArmModel) -> None:
    machine, arm = exact.machine, truth(2)
    q = np.array([[0.2, -0.3], [-0.5, 0.1]])
    still = np.zeros_like(q)
    held = inverse_dynamics(machine, arm.pi, q, still, still)
    for joint, cylinder in enumerate(j.cylinder for j in machine.joints):
        assert cylinder is not None
        held[:, joint] += (
            lever_arm(cylinder.linkage, q[:, joint])
            * arm.drive[joint, 1]
            * cylinder.linkage.piston_position(q[:, joint])
        )
    np.testing.assert_allclose(motion.gravity(exact, q), held, rtol=1e-9)
    inertia = motion.inertia_matrix(exact, q)
    r = np.stack([lever_arm(j.cylinder.linkage, q[:, k]) for k, j in enumerate(machine.joints) if j.cylinder], axis=1)
    for joint in range(2):
        unit = np.tile(np.eye(2)[joint], (2, 1))
        links = inverse_dynamics(machine, arm.pi, q, still, unit) - inverse_dynamics(machine, arm.pi, q, still, still)
        links[:, joint] += arm.drive[joint, 0] * r[:, joint] ** 2
        np.testing.assert_allclose(inertia[:, :, joint], links, rtol=1e-8, atol=1e-8)


def test_friction_is_what_turns_with_the_speed(exact: ArmModel) -> None:
    moved = make_motion(exact.machine, "validate", 5, 4.0)
    _, _, f_c, f_v, f_s = truth(2).drive.T
    damping = np.array([j.cylinder.damping for j in exact.machine.joints if j.cylinder])
    expected = moved.r * (f_c * np.sign(moved.v) + (f_v + damping) * moved.v + f_s * np.cbrt(moved.v))
    np.testing.assert_allclose(motion.friction(exact, moved.q, moved.qd), expected, rtol=1e-9, atol=1e-9)


@pytest.mark.slow
@given(st.lists(st.floats(-0.5, 0.5), min_size=6, max_size=6))
@settings(max_examples=15)
def test_forward_undoes_effort(values: list[float]) -> None:
    model = MODELS["force"]
    q, qd, qdd = (np.array([values[k : k + 2]]) for k in (0, 2, 4))
    effort = motion.on_motion(model, q, qd, qdd).joint_effort(0)
    np.testing.assert_allclose(motion.forward(model, q, qd, effort=effort), qdd, rtol=1e-7, atol=1e-7)


@pytest.mark.slow
@given(st.lists(st.floats(-0.5, 0.5), min_size=6, max_size=6), st.floats(1e5, 5e6))
@settings(max_examples=10)
def test_pressures_make_the_force_and_forward_takes_them_back(values: list[float], rod: float) -> None:
    model = MODELS["force"]
    q, qd, qdd = (np.array([values[k : k + 2]]) for k in (0, 2, 4))
    head, second = motion.pressures_of(motion.on_motion(model, q, qd, qdd), rod)
    assert np.all(second == rod)
    np.testing.assert_allclose(motion.forward(model, q, qd, head=head, rod=second), qdd, rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize("rod", np.linspace(1e5, 3e5, 11))
def test_an_arm_that_is_held_stays(rod: float) -> None:
    model = MODELS["force"]
    held = np.array([[0.0, 0.0], [0.125, 0.0], [-0.3, 0.2]])
    head, second = motion.pressures_of(motion.on_motion(model, held, 0.0 * held, 0.0 * held), rod)
    for at in range(len(held)):
        found = motion.forward(model, held[[at]], 0.0 * held[[at]], head=head[[at]], rod=second[[at]])
        np.testing.assert_allclose(found, 0.0, atol=1e-9)


def test_expected_rod_pressure_is_that_of_the_recordings(exact: ArmModel) -> None:
    session = session_of(2)
    segment = session.plain.design.segments[session.plain.design.indices("train")[0]]
    model = model_with((), session)
    found = motion.on_motion(model, segment.q, segment.qd, segment.qdd, segment.t - segment.t[0])
    _, rod = motion.pressures_of(found)
    # The return line is 2 MPa s/m of speed, and half of that swings with time: a product, which no sum of laws holds.
    assert np.std(rod - segment.p2) < 0.4 * np.std(segment.p2)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda m: motion.on_motion(m, [[0.0]], [[0.0]], [[0.0]]), "must be (samples, 2)"),
        (lambda m: motion.on_motion(m, [[0.0, 0.0]], [[0.0, 0.0]] * 2, [[0.0, 0.0]]), "must be as many"),
        (lambda m: motion.on_motion(m, [[np.nan, 0.0]], [[0.0, 0.0]], [[0.0, 0.0]]), "not finite"),
        (lambda m: motion.forward(m, [[0.0, 0.0]], [[0.0, 0.0]]), "give joint efforts"),
    ],
)
def test_bad_motions_are_refused_in_one_line(call: object, words: str, exact: ArmModel) -> None:
    with pytest.raises(InputError) as caught:
        call(exact)  # type: ignore[operator]
    assert words in str(caught.value) and "\n" not in str(caught.value)


class _Models(dict[str, ArmModel]):
    """Made when first asked for."""

    def __missing__(self, key: str) -> ArmModel:
        session = session_of(2)
        names = {"force": ("load_dependent_friction", "stribeck", "pressure_dependent_friction")}[key]
        self[key] = model_with([term_of(session, name, n % 2) for n, name in enumerate(names)], session, 3.0)
        return self[key]


MODELS = _Models()
