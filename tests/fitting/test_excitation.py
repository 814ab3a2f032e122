"""Designed motions keep every limit, start and end at rest, and tell more than motions that were not designed."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
import typer
from arm_examples import driven_arm, planar_arm, random_chain
from scipy.interpolate import make_interp_spline
from typer.testing import CliRunner

from daq.errors import InputError
from daq.machine_file import machine_to_yaml
from fitting.base_parameters import base_regressor, condition_number, reduce_parameters
from fitting.cli_excite import register
from fitting.dynamics import inverse_dynamics, rigid_body_regressor, stacked
from fitting.excitation import (
    CylinderOptions,
    ExcitationOptions,
    HydraulicLimits,
    condition_of_information,
    design_cylinder_motion,
    design_motion,
    design_sequence,
    information,
    information_of,
)
from fitting.excitation.cylinders import _band_value, piston_limits, stage_one_columns
from fitting.excitation.fourier import fourier_basis, spread_harmonics
from fitting.excitation.limits import chamber_pressure, supply_flow
from fitting.excitation.objective import probed_regressor, spectral_objective
from fitting.excitation.problem import pose_problem, random_start
from fitting.excitation.search import STAGES, value_and_gradient
from fitting.linkage import lever_arm, piston_motion
from fitting.motion import Motion, read_motion

QUICK = ExcitationOptions(seconds=12.0, starts=1, iterations=15, samples=60, harmonics=5)


def error_order(value, gradient, at, direction, steps=(1e-3, 1e-4)):
    """Ratio of central-difference errors for steps a factor ten apart (100 if right), and the smaller error."""
    slope = float(gradient @ direction)
    errors = [
        abs((value(at + h * direction) - value(at - h * direction)) / (2 * h) - slope) / abs(slope) for h in steps
    ]
    return errors[0] / errors[1], errors[1]


# --- Fourier series -----------------------------------------------------------------------------------------------


def test_series_start_and_end_at_rest_and_derivatives_fit():
    time = np.linspace(0, 10, 5001)
    basis = fourier_basis((1, 3, 4, 7), 10.0, time)
    assert basis.size == 6
    for values in (basis.position, basis.speed, basis.acceleration):
        np.testing.assert_allclose(values[[0, -1]], 0.0, atol=1e-10)
    np.testing.assert_allclose(np.gradient(basis.position, time, axis=0)[5:-5], basis.speed[5:-5], atol=1e-4)
    np.testing.assert_allclose(np.gradient(basis.speed, time, axis=0)[5:-5], basis.acceleration[5:-5], atol=1e-3)
    assert np.linalg.matrix_rank(basis.position) == 6


def test_harmonics_stay_in_the_band_and_differ_between_joints():
    sets = [spread_harmonics(6, joint, 4, 30.0, 0.6) for joint in range(4)]
    assert all(1 <= k <= 18 for harmonics in sets for k in harmonics)
    assert sets[:3] == [(1, 4, 7, 10, 13, 16), (1, 4, 7, 10, 13, 16), (2, 5, 8, 11, 14, 17)]
    assert len({spread_harmonics(4, joint, 4, 30.0, 0.6) for joint in range(4)}) == 4
    assert spread_harmonics(6, 0, 4, 4.0, 0.5) == (1, 2)  # where there is no choice, they share


# --- criterion ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("criterion", ["condition", "determinant"])
def test_spectral_gradient_by_order_of_convergence(criterion):
    rng = np.random.default_rng(0)
    half = rng.normal(size=(30, 6)) @ np.diag([1, 10, 0.1, 1, 1, 1])
    G, direction = half.T @ half, (lambda s: s + s.T)(rng.normal(size=(6, 6))) * 0.01
    _, M = spectral_objective(G, criterion, 6, 0.2)
    ratio, last = error_order(
        lambda g: spectral_objective(g.reshape(6, 6), criterion, 6, 0.2)[0],
        M.ravel(),
        G.ravel(),
        direction.ravel(),
        (1.0, 0.1),
    )
    assert 80 < ratio < 120
    assert last < 1e-3


def test_smooth_condition_number_bounds_the_true_one_and_approaches_it():
    rng = np.random.default_rng(1)
    half = rng.normal(size=(40, 8))
    true = np.log(condition_number(half))
    values = [spectral_objective(half.T @ half, "condition", power)[0] for power in (2, 8, 64)]
    assert values[0] > values[1] > values[2] > true
    assert values[2] == pytest.approx(true, abs=0.05)
    assert condition_of_information(half.T @ half) == pytest.approx(condition_number(half), rel=1e-9)


def test_condition_of_information_without_full_rank_is_infinite():
    assert condition_of_information(np.diag([1.0, 0.0])) == np.inf
    assert condition_of_information(np.ones((2, 2))) == np.inf


def test_gradient_of_the_regressor_matches_changed_states():
    arm = random_chain("RPRR", np.random.default_rng(2))
    rng = np.random.default_rng(3)
    columns = np.array([0, 9, 11, 25, 39])
    state = rng.uniform(-1, 1, (3, 7, 4))
    weight = rng.normal(size=(7, 4, 5))
    moved = np.array([0, 1, 3])
    probed = probed_regressor(arm, columns, *state, moved)
    np.testing.assert_allclose(probed.Y, rigid_body_regressor(arm, *state, columns=columns), atol=1e-12)
    found = probed.gradient(weight)
    for signal in range(3):
        for place, joint in enumerate(moved):
            direction = np.zeros((3, 7, 4))
            direction[signal, :, joint] = rng.normal(size=7)
            h = 1e-4
            ends = [
                (rigid_body_regressor(arm, *(state + s * h * direction), columns=columns) * weight).sum()
                for s in (1, -1)
            ]
            expected = (ends[0] - ends[1]) / (2 * h)
            assert found[signal][:, place] @ direction[signal, :, joint] == pytest.approx(expected, rel=1e-6, abs=1e-7)


@pytest.mark.parametrize("coupled", [False, True], ids=["kinematic limits", "flow and pressure"])
def test_gradient_of_the_search_by_order_of_convergence(coupled):
    machine = driven_arm(3)
    base = reduce_parameters(machine)
    hydraulic = HydraulicLimits()
    if coupled:
        # So tight that both penalties act.
        guess = np.array([20.0, 30.0, 1.0, 10.0, 20.0, 1.0, 3.0, 8.0, 1.0])
        hydraulic = HydraulicLimits(flow=2e-4, pressure=1e6, back_pressure=1e5, base_parameters=guess)
    rng = np.random.default_rng(4)
    problem = pose_problem(machine, base, QUICK, None, None, hydraulic, rng)
    at = random_start(problem, rng)
    value, gradient = value_and_gradient(problem, at, STAGES[0])
    if coupled:
        free = replace(problem, hydraulic=replace(hydraulic, flow=1.0, pressure=1e9))
        assert value > value_and_gradient(free, at, STAGES[0])[0] + 0.1
    ratio, last = error_order(
        lambda c: value_and_gradient(problem, c, STAGES[0], want_gradient=False)[0],
        gradient,
        at,
        rng.normal(size=at.size),
    )
    # Penalties have kinks in their second derivative, so the order is only roughly two there.
    assert (30 if coupled else 80) < ratio < 300
    assert last < 1e-4


def test_gradient_of_the_band_limited_signal():
    basis = fourier_basis((1, 2, 5, 9), 20.0, (np.arange(90) + 0.5) * 20 / 90)
    stack = np.vstack([basis.position, basis.speed, basis.acceleration])
    scale = np.repeat([0.1, 0.12, 0.4], 90)
    rng = np.random.default_rng(5)
    at, direction = rng.normal(size=(2, basis.size))
    gradient = _band_value(at, stack, scale, 0.15, 0.12)[1]
    ratio, last = error_order(lambda c: _band_value(c, stack, scale, 0.15, 0.12)[0], gradient, at, direction)
    assert 60 < ratio < 150
    assert last < 1e-5


# --- hydraulic limits ---------------------------------------------------------------------------------------------


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


def test_a_pressure_that_no_motion_keeps_is_refused():
    machine = driven_arm(2)
    base = reduce_parameters(machine)
    heavy = base.from_standard(np.tile([500.0, 0, 0, 0, 0, 0, 0, 0, 0, 0], 2))
    with pytest.raises(InputError, match="however small the motion"):
        design_motion(machine, base, options=QUICK, hydraulic=HydraulicLimits(pressure=1e5, base_parameters=heavy))


# --- whole motions ------------------------------------------------------------------------------------------------


def check_limits(machine, excitation, use):
    """Independently of how it was made: a spline through the motion file's rows, on a grid ten times as fine."""
    motion = excitation.motion
    rest = [(1, np.zeros(len(machine.joints))), (2, np.zeros(len(machine.joints)))]
    law = make_interp_spline(motion.time, motion.joint_positions(machine), k=5, bc_type=(rest, rest))
    fine = np.linspace(0, motion.seconds, 10 * len(motion.time))
    q, qd, qdd = law(fine), law.derivative(1)(fine), law.derivative(2)(fine)
    for i, joint in enumerate(machine.joints):
        low, high = joint.limits.position
        slack = 1 + 1e-4
        assert np.abs(q[:, i] - (low + high) / 2).max() <= use * (high - low) / 2 * slack
        assert np.abs(qd[:, i]).max() <= use * joint.limits.velocity * slack
        assert np.abs(qdd[:, i]).max() <= use * joint.limits.acceleration * slack
        x, _, _ = piston_motion(joint.cylinder.linkage, q[:, i], qd[:, i], qdd[:, i])
        assert x.min() >= 0
        assert x.max() <= joint.cylinder.stroke
    np.testing.assert_allclose(law(motion.time), motion.joint_positions(machine), atol=1e-12)
    np.testing.assert_allclose(law.derivative(1)(motion.time), excitation.speed, atol=1e-4)
    np.testing.assert_allclose(law.derivative(2)(motion.time), excitation.acceleration, atol=5e-3)


@pytest.mark.parametrize("twisted", [False, True], ids=["planar", "twisted"])
def test_a_designed_motion_keeps_its_limits_and_rests_at_its_ends(twisted):
    machine = driven_arm(4, twisted=twisted)
    found = design_motion(machine, reduce_parameters(machine), options=QUICK)
    check_limits(machine, found, QUICK.use)
    for values in (found.speed, found.acceleration):
        np.testing.assert_allclose(values[[0, -1]], 0.0, atol=1e-9)
    assert found.motion.time[0] == 0.0
    assert found.motion.seconds == pytest.approx(12.0)
    np.testing.assert_allclose(np.diff(found.motion.time), 1 / machine.rate_hz)
    # Every joint is brought to one of its limits.
    for joint in machine.joints:
        used = [use.used for use in found.limits if use.joint == joint.name and use.quantity != "stroke"]
        assert max(used) == pytest.approx(QUICK.use, rel=1e-3)


def test_the_reported_condition_number_is_that_of_the_motion():
    machine = driven_arm(3)
    base = reduce_parameters(machine)
    found = design_motion(machine, base, options=QUICK)
    W = stacked(base_regressor(machine, base, found.motion.joint_positions(machine), found.speed, found.acceleration))
    assert found.condition_number == pytest.approx(condition_number(W), rel=1e-6)
    assert found.own_condition_number == found.condition_number
    np.testing.assert_allclose(found.information, W.T @ W, rtol=1e-10, atol=1e-10 * np.abs(found.information).max())
    np.testing.assert_allclose(information_of(machine, base, found.motion), found.information, rtol=1e-2)
    assert found.not_told == ()


def test_designing_beats_the_best_of_many_random_series():
    machine = driven_arm(4)
    base = reduce_parameters(machine)
    found = design_motion(machine, base, options=replace(QUICK, iterations=40))
    rng = np.random.default_rng(6)
    problem = pose_problem(machine, base, QUICK, None, None, HydraulicLimits(), rng)
    from fitting.excitation.design import _finish

    random = [_finish(problem, random_start(problem, rng), None).condition_number for _ in range(30)]
    assert found.condition_number < 0.9 * min(random)
    assert found.condition_number < 0.65 * np.median(random)


def test_the_same_seed_gives_the_same_motion_and_another_seed_another():
    machine = driven_arm(2)
    base = reduce_parameters(machine)
    first, again, other = (design_motion(machine, base, options=QUICK, seed=seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(first.motion.columns["joint1"], again.motion.columns["joint1"])
    assert np.abs(first.motion.columns["joint1"] - other.motion.columns["joint1"]).max() > 0.05


def test_a_second_motion_complements_the_first():
    machine = driven_arm(3)
    base = reduce_parameters(machine)
    first, second = design_sequence(machine, base, 2, options=QUICK)
    together = condition_of_information(first.information + second.information)
    assert second.condition_number == pytest.approx(together, rel=1e-9)
    assert together < first.condition_number
    # A first motion of one joint only leaves parameters open; the second, of the others too, tells them.
    start = design_motion(machine, base, options=QUICK, joints=["joint3"])
    assert start.own_condition_number == np.inf
    assert {"ZZ1", "ZZ2"} <= set(start.not_told)
    rest = design_motion(machine, base, options=QUICK, gathered=start.information)
    assert rest.not_told == ()
    assert np.isfinite(rest.condition_number)


def test_one_joint_alone_holds_the_others_still():
    machine = driven_arm(3)
    found = design_motion(machine, reduce_parameters(machine), options=QUICK, joints=["joint2"])
    assert list(found.motion.columns) == ["joint2"]
    assert not found.speed[:, [0, 2]].any()
    assert {use.joint for use in found.limits} == {"joint2"}


def test_d_optimality_gives_larger_signals():
    machine = driven_arm(3)
    base = reduce_parameters(machine)
    condition, determinant = (
        design_motion(machine, base, options=replace(QUICK, iterations=40, criterion=criterion, signal_share=0.0))
        for criterion in ("condition", "determinant")
    )
    assert condition.condition_number < determinant.condition_number
    assert np.linalg.slogdet(determinant.information)[1] > np.linalg.slogdet(condition.information)[1]


def test_progress_rises_to_one_and_reports_the_best():
    machine = driven_arm(2)
    seen: list[tuple[float, float]] = []
    found = design_motion(
        machine,
        reduce_parameters(machine),
        options=replace(QUICK, starts=2, iterations=5),
        progress=lambda share, condition: seen.append((share, condition)),
    )
    shares = [share for share, _ in seen]
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert seen[-1][1] == found.condition_number
    assert len(seen) > 4


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"seconds": 1.0}, "fewer than two periods"),
        ({"use": 1.2}, "use"),
        ({"harmonics": 1}, "harmonics must be 2"),
    ],
)
def test_options_that_cannot_be_are_refused(options, says):
    with pytest.raises(InputError, match=says):
        ExcitationOptions(**options)


def test_an_unknown_joint_is_named():
    machine = driven_arm(2)
    with pytest.raises(InputError, match=r"joint 'joint7': test-arm has joint1, joint2"):
        design_motion(machine, reduce_parameters(machine), options=QUICK, joints=["joint7"])


def test_a_motion_of_free_cylinders_tells_nothing_about_links():
    motion = Motion("test-arm", "unpinned", np.arange(10.0), {"joint1": np.full(10, 0.1)})
    with pytest.raises(InputError, match="rods=unpinned"):
        information_of(driven_arm(1), reduce_parameters(driven_arm(1)), motion)


@pytest.mark.slow
def test_default_search_is_near_the_best_of_twenty_long_runs():
    """The default search for six joints against twenty that are three times as long: within 10 %."""
    machine = driven_arm(6)
    base = reduce_parameters(machine)
    options = ExcitationOptions(seconds=12.0, samples=60)
    found = design_motion(machine, base, options=options)
    long = replace(options, starts=20, iterations=3 * options.iterations)
    best = design_motion(machine, base, options=long, seed=100)
    assert found.condition_number <= 1.1 * best.condition_number


# --- free cylinders -----------------------------------------------------------------------------------------------


def test_free_cylinders_keep_stroke_speed_and_acceleration():
    machine = driven_arm(2)
    found = design_cylinder_motion(machine, options=CylinderOptions(seconds=40.0))
    assert found.motion.rods == "unpinned"
    fine = np.linspace(0, 40.0, 20001)
    for joint in machine.joints:
        (low, high), top_speed, top_acceleration = piston_limits(joint)
        x = found.motion.columns[joint.name]
        law = make_interp_spline(found.motion.time, x, k=5, bc_type=([(1, 0.0), (2, 0.0)], [(1, 0.0), (2, 0.0)]))
        assert low <= law(fine).min()
        assert law(fine).max() <= high
        assert np.abs(law.derivative(1)(fine)).max() <= top_speed
        assert np.abs(law.derivative(2)(fine)).max() <= top_acceleration
        np.testing.assert_allclose(law.derivative(1)(found.motion.time), found.speed[joint.name], atol=2e-4)
        # Most of the stroke that the joint uses later, and ends at rest.
        assert x.max() - x.min() > 0.9 * (high - low)
        assert x[0] == pytest.approx(x[-1], abs=1e-9)
        np.testing.assert_allclose([found.speed[joint.name][k] for k in (0, -1)], 0.0, atol=1e-9)
        W = stage_one_columns(x, found.speed[joint.name], found.acceleration[joint.name])
        assert found.condition_numbers[joint.name] == pytest.approx(condition_number(W), rel=1e-6)


def test_a_staircase_holds_constant_speeds_over_two_decades():
    machine = driven_arm(1)
    found = design_cylinder_motion(machine, options=CylinderOptions(seconds=60.0, staircase=0.5, starts=1))
    stairs = found.motion.time > 30.0
    speed, acceleration = found.speed["joint1"][stairs], found.acceleration["joint1"][stairs]
    constant = np.abs(acceleration) < 1e-12
    moving = constant & (np.abs(speed) > 1e-12)
    levels = np.unique(np.round(np.abs(speed[moving]), 9))
    assert len(levels) == 6
    assert levels[-1] / levels[0] > 15
    assert moving.mean() > 0.4
    for level in levels:  # both ways, for friction that differs with direction
        assert {1.0, -1.0} == set(np.sign(speed[moving & np.isclose(np.abs(speed), level, rtol=1e-6)]))


def test_slow_reversals_and_fast_strokes_are_both_there():
    machine = driven_arm(1)
    found = design_cylinder_motion(machine, options=CylinderOptions(seconds=60.0))
    _, top_speed, _ = piston_limits(machine.joints[0])
    share = np.abs(found.speed["joint1"]) / top_speed
    assert share.max() > 0.7
    assert (share < 0.1).mean() > 0.1
    assert np.count_nonzero(np.diff(np.sign(found.speed["joint1"]))) > 10


def test_all_cylinders_take_their_own_course():
    found = design_cylinder_motion(driven_arm(3), options=CylinderOptions(seconds=20.0, starts=1))
    courses = np.array([found.motion.columns[name] for name in ("joint1", "joint2", "joint3")])
    assert np.abs(np.corrcoef(courses)[np.triu_indices(3, 1)]).max() < 0.95
    one = design_cylinder_motion(driven_arm(3), options=CylinderOptions(seconds=20.0, starts=1), joints=["joint2"])
    assert list(one.motion.columns) == ["joint2"]


def test_without_a_staircase_the_band_fills_the_time():
    found = design_cylinder_motion(driven_arm(1), options=CylinderOptions(seconds=20.0, staircase=0.0, starts=1))
    assert found.motion.seconds == pytest.approx(20.0)
    assert np.abs(found.speed["joint1"][-50:]).max() > 0


def test_unpinning_what_has_no_cylinder_is_refused():
    machine = driven_arm(2)
    bare = machine.model_copy(update={"joints": tuple(j.model_copy(update={"cylinder": None}) for j in machine.joints)})
    with pytest.raises(InputError, match="no joint has a cylinder"):
        design_cylinder_motion(bare)
    with pytest.raises(InputError, match="joint 'joint1': has no cylinder"):
        design_cylinder_motion(bare, joints=["joint1"])
    with pytest.raises(InputError, match="too short for a band"):
        CylinderOptions(seconds=2.0)


# --- command ------------------------------------------------------------------------------------------------------


@pytest.fixture
def run(tmp_path):
    app = typer.Typer()

    @app.callback()
    def main() -> None:
        """A group, as the real command line is."""

    register(app)
    (tmp_path / "machine.yaml").write_text(machine_to_yaml(driven_arm(2)))

    def call(*arguments: str):
        return CliRunner().invoke(app, ["excite", str(tmp_path / "machine.yaml"), *arguments])

    return call


def test_command_writes_a_motion_and_says_what_it_uses(run, tmp_path):
    out = tmp_path / "m.csv"
    result = run("-o", str(out), "--seconds", "8", "--starts", "1", "--json")
    assert result.exit_code == 0, result.output
    report = json.loads(result.stdout)
    motion = read_motion(out, driven_arm(2))
    assert report["rods"] == motion.rods == "pinned"
    assert report["base_parameters"] == 6
    assert {use["quantity"] for use in report["limits"]} == {"position", "velocity", "acceleration", "stroke"}
    second = run("-o", str(tmp_path / "n.csv"), "--seconds", "8", "--starts", "1", "--json", "--after", str(out))
    assert json.loads(second.stdout)["condition_number"] < json.loads(second.stdout)["own_condition_number"]
    table = run("-o", str(out), "--seconds", "8", "--starts", "1", "--joint", "joint2")
    assert table.exit_code == 0
    assert "cond(W)" in table.output
    assert "cannot tell: ZZ1" in table.output


def test_command_for_free_cylinders(run, tmp_path):
    out = tmp_path / "m.csv"
    result = run("-o", str(out), "--unpinned", "--seconds", "15", "--starts", "1", "--json")
    assert result.exit_code == 0, result.output
    assert set(json.loads(result.stdout)["condition_numbers"]) == {"joint1", "joint2"}
    assert read_motion(out, driven_arm(2)).rods == "unpinned"


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--joint", "joint9"], "joint 'joint9'"),
        (["--seconds", "2"], "fewer than two periods"),
        (["--unpinned", "--max-flow", "10"], "leave them out"),
        (["--after", "none.csv"], "no such file"),
    ],
)
def test_command_ends_with_2_and_one_line_and_writes_nothing(run, tmp_path, arguments, says):
    result = run("-o", str(tmp_path / "m.csv"), *arguments)
    assert result.exit_code == 2
    assert says in result.stderr
    assert not (tmp_path / "m.csv").exists()


def test_inverse_dynamics_of_a_designed_motion_starts_and_ends_with_gravity_alone():
    machine = driven_arm(2)
    found = design_motion(machine, reduce_parameters(machine), options=QUICK)
    pi = np.tile([10.0, 1, 0, 0, 0.5, 0, 0, 0.5, 0, 0.5], 2)
    q = found.motion.joint_positions(machine)
    tau = inverse_dynamics(machine, pi, q, found.speed, found.acceleration)
    still = inverse_dynamics(machine, pi, q[:1], 0 * q[:1], 0 * q[:1])
    np.testing.assert_allclose(tau[[0, -1]], np.vstack([still, still]), rtol=1e-9)


def test_a_planar_arm_lying_flat_tells_what_it_can():
    """Weightless: seven parameters, all told by a designed motion."""
    lying = planar_arm(3, (0.0, 0.0, -9.81))
    machine = driven_arm(3).model_copy(update={"gravity": (0.0, 0.0, -9.81)})
    base = reduce_parameters(machine)
    assert len(base) == len(reduce_parameters(lying)) == 7
    found = design_motion(machine, base, options=QUICK)
    assert found.not_told == ()
    assert information(base_regressor(machine, base, *np.zeros((3, 5, 3)))).shape == (7, 7)
