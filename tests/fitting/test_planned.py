"""A planned motion has the columns that its recording will have; a guess is honest about being one."""

from __future__ import annotations

import json

import numpy as np
import pytest
from arm_examples import driven_arm
from synthetic_arm import (
    EXACT,
    Noise,
    clean_session,
    force,
    make_motion,
    planar_machine,
    prepare,
    sample,
    truth,
)

from daq.errors import InputError
from daq.motion_files import Motion
from fitting.arm.base_parameters import base_regressor, reduce_parameters
from fitting.arm.linkage import lever_arm
from fitting.planning.guess import default_guess, guess_from_file, worst_friction
from fitting.planning.planned import chamber_models, planned_segment, planned_views, segment_of_states, usual_chambers
from fitting.regression.design import build_design
from fitting.signals.filters import filter_bank

SIGNALS = ("t", "q", "qd", "qdd", "x", "v", "a", "r")


def motion_file(machine, moved, rods):
    values = moved.q if rods == "pinned" else moved.x
    return Motion(machine.name, rods, moved.t, {joint.name: values[:, j] for j, joint in enumerate(machine.joints)})


@pytest.mark.parametrize("role", ["train", "unloaded"])
def test_a_planned_segment_is_the_recorded_one_without_noise(role):
    machine, arm = planar_machine(2), truth(2)
    moved = make_motion(machine, role, 4)
    recording = sample(machine, moved, force(machine, arm, moved), role, 1, Noise(0.0, 0.0, 0.0, 0.0))
    bank = filter_bank(machine.rate_hz, 3.0)
    noise = [EXACT] * 2
    (recorded,) = prepare(machine, (recording,), bank, noise=noise)
    planned = planned_segment(machine, bank, noise, motion_file(machine, moved, recording_rods(role)), 7)
    assert planned.recording == 7
    assert planned.loaded == recorded.loaded
    for name in SIGNALS:
        np.testing.assert_allclose(getattr(planned, name), getattr(recorded, name), atol=2e-5, err_msg=name)


def recording_rods(role):
    return "unpinned" if role == "unloaded" else "pinned"


def test_exact_states_make_the_same_segment_but_for_the_smoothing():
    machine = planar_machine(2)
    moved = make_motion(machine, "train", 4)
    bank = filter_bank(machine.rate_hz, 3.0)
    from_file = planned_segment(machine, bank, [EXACT] * 2, motion_file(machine, moved, "pinned"))
    cut = slice(bank.margin, -bank.margin)
    exact = segment_of_states(machine, bank, [EXACT] * 2, (moved.q[cut], moved.qd[cut], moved.qdd[cut]))
    np.testing.assert_allclose(exact.v, from_file.v, atol=1e-4)
    np.testing.assert_allclose(exact.x, from_file.x, atol=1e-5)


def test_joints_without_a_column_rest_mid_range_and_say_nothing():
    machine = driven_arm(2)
    bank = filter_bank(machine.rate_hz, 3.0)
    time = np.arange(1000) / machine.rate_hz
    swing = Motion("test-arm", "pinned", time, {"joint2": 0.3 * np.sin(0.9 * time)})
    segment = planned_segment(machine, bank, [EXACT] * 2, swing)
    np.testing.assert_allclose(segment.q[:, 0], 0.0, atol=1e-12)
    assert segment.rest[:, 0].all()
    assert not segment.rest[:, 1].any()
    design = build_design(machine, reduce_parameters(machine), bank, [EXACT] * 2, [segment])
    assert not design.blocks[0][0].keep.any()
    with pytest.raises(InputError, match="shorter than the filters"):
        planned_segment(machine, bank, [EXACT] * 2, Motion("test-arm", "pinned", time[:80], {"joint2": time[:80]}))


def test_a_motion_file_at_another_rate_is_resampled():
    machine = driven_arm(1)
    bank = filter_bank(machine.rate_hz, 3.0)
    slow, fast = np.arange(0, 20.01, 0.1), np.arange(0, 20.01, 0.02)
    segments = [
        planned_segment(machine, bank, [EXACT], Motion("test-arm", "pinned", t, {"joint1": 0.4 * np.sin(1.1 * t)}))
        for t in (slow, fast)
    ]
    np.testing.assert_allclose(segments[0].v, segments[1].v, atol=1e-5)


def test_planned_pressures_carry_the_models_force_and_no_chamber_falls_below_its_floor():
    """Where a recording's load always pushed and the plan's pulls, the rod side has to carry it."""
    session = clean_session()
    model = session.base_model
    chambers = chamber_models(model)
    view = model.views[1][0]
    chamber = chambers[0]
    np.testing.assert_allclose(chamber.rod_pressure(view.v, view.force), view.p2, atol=0.1 * np.ptp(view.p2) + 2e4)
    pulled = -np.linspace(1e3, 2e4, 50)
    p2 = chamber.rod_pressure(np.zeros(50), pulled)
    p1 = (pulled + p2 * chamber.rod_area) / chamber.head_area
    assert p1.min() >= chamber.floor - 1.0
    assert p2[-1] > 3 * p2[0]


def test_usual_chambers_keep_the_back_pressure():
    machine = driven_arm(1)
    (chamber,) = usual_chambers(machine, 4e5)
    force = np.array([-5e3, 0.0, 5e3])
    p2 = chamber.rod_pressure(np.zeros(3), force)
    p1 = (force + p2 * chamber.rod_area) / chamber.head_area
    assert min(p1.min(), p2.min()) == pytest.approx(4e5)
    np.testing.assert_allclose(p1 * chamber.head_area - p2 * chamber.rod_area, force, atol=1e-6)


def test_views_of_a_plan_have_the_forces_of_the_parameters():
    machine, arm = planar_machine(2), truth(2)
    base, bank = reduce_parameters(machine), filter_bank(50.0, 3.0)
    moved = make_motion(machine, "train", 4)
    segment = planned_segment(machine, bank, [EXACT] * 2, motion_file(machine, moved, "pinned"))
    design = build_design(machine, base, bank, [EXACT] * 2, [segment])
    views = planned_views(design, arm.theta(machine), usual_chambers(machine, 5e5))
    expected = force(machine, arm, moved)[bank.margin : -bank.margin]
    steady = np.abs(moved.v[bank.margin : -bank.margin]) > 0.005  # the smoothed sign of a reversal differs
    for joint in range(2):
        keep = steady[:, joint]
        np.testing.assert_allclose(views[0][joint].force[keep], expected[keep, joint], rtol=2e-3, atol=2.0)


# --- guesses ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("twisted", [False, True], ids=["planar", "twisted"])
def test_a_guess_loads_the_cylinders_by_about_a_third(twisted):
    machine = driven_arm(4, twisted=twisted)
    base = reduce_parameters(machine)
    guess = default_guess(machine, base, supply=20e6)
    assert not guess.measured
    assert "a guess" in guess.statement
    q = np.random.default_rng(1).uniform(-0.6, 0.6, (500, 4))
    tau = base_regressor(machine, base, q, np.zeros_like(q), np.zeros_like(q)) @ guess.base
    pressures = [
        np.abs(tau[:, j] / lever_arm(joint.cylinder.linkage, q[:, j])).max() / joint.cylinder.rod_area
        for j, joint in enumerate(machine.joints)
    ]
    assert 0.3 * 20e6 < max(pressures) < 0.37 * 20e6
    assert np.all(guess.noise > 0)
    assert len(guess.theta) == 4 * 5 + len(base)


def test_a_guess_without_cylinders_or_gravity_still_has_sizes():
    machine = planar_machine(kinds="rp")
    base = reduce_parameters(machine)
    guess = default_guess(machine, base)
    assert np.all(guess.noise > 0)
    assert all(np.all(np.isfinite(values)) for values in guess.drive)
    weightless = driven_arm(2).model_copy(update={"gravity": (0.0, 0.0, -9.81)})
    assert np.all(np.isfinite(default_guess(weightless, reduce_parameters(weightless)).base))


def test_worst_friction_bounds_what_a_cylinder_needs_beside_its_load():
    machine, arm = planar_machine(2), truth(2)
    base = reduce_parameters(machine)
    guess = default_guess(machine, base)
    known = type(guess)(base.from_standard(arm.pi), tuple(arm.drive), guess.noise, "known", True)
    moved = make_motion(machine, "unloaded", 2)
    alone = np.abs(force(machine, arm, moved)).max(axis=0)  # no load: friction, stiffness, mass and damping
    worst = worst_friction(machine, known)
    assert np.all(worst > 0.7 * alone)
    assert np.all(worst < 6 * alone)


def test_parameters_come_from_a_report_where_it_has_them(tmp_path):
    machine = driven_arm(2)
    base = reduce_parameters(machine)
    rough = default_guess(machine, base)
    values = 1.5 * rough.base
    report = {
        "schema": "hilfit/report/1",
        "rigid_body": {
            "parameters": [
                {"expression": e, "value": v, "std": 0.1, "unit": u}
                for e, v, u in zip(base.expressions, values.tolist(), base.units, strict=True)
            ]
        },
        "cylinders": {"joint1": {"parameters": {"f_c": {"value": 77.0}}, "residual_std": 4.0}},
    }
    path = tmp_path / "report.json"
    path.write_text(json.dumps(report))
    guess = guess_from_file(path, machine, base)
    np.testing.assert_allclose(guess.base, values)
    assert guess.measured
    assert guess.drive[0][2] == 77.0
    np.testing.assert_array_equal(guess.drive[1], rough.drive[1])
    assert guess.noise[0] == 4.0
    assert guess.noise[1] == rough.noise[1]
    path.write_text(json.dumps({"schema": "hilfit/body-prior/1", "links": [LINK, LINK]}))
    drawn = guess_from_file(path, machine, base)
    assert not drawn.measured
    assert "guessed" in drawn.statement
    path.write_text("{}")
    with pytest.raises(InputError, match=r"report\.json: schema is null"):
        guess_from_file(path, machine, base)


LINK = {"mass": 20.0, "centre": [-0.3, 0.0, 0.0], "inertia": [0.1, 0.0, 0.0, 1.0, 0.0, 1.0]}
