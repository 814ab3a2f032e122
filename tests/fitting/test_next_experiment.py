"""The next experiment: separations as explicit refits have them, motions that can be run, and honest advice."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from synthetic_arm import clean_session, injected, make_session, planar_machine, truth

from daq.machine_file import Hydraulics, Machine
from daq.recording import Recording
from fitting.effects import effect
from fitting.excitation import HydraulicLimits
from fitting.excitation.limits import limits_used
from fitting.excitation.motion import Motion, read_motion, write_motion
from fitting.loop.session import Session
from fitting.planning.next_experiment import NextExperiment, design_next, supply_of
from fitting.planning.separation import products, projected, separation
from fitting.regression.design import build_design, solve, whitened
from fitting.regression.prior import with_prior
from fitting.residual.terms import Model, Term, extra_columns, fit_model
from fitting.residual.views import build_views
from fitting.signals.preparation import prepare

# --- arithmetic ---------------------------------------------------------------------------------------------------


def random_problem(seed, base=4, widths=(1, 2)):
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(60, base))
    rivals = [rng.normal(size=(60, width)) + A @ rng.normal(size=(base, width)) for width in widths]
    rivals[1] = rivals[1] + 0.8 * rivals[0][:, :1]
    table = np.hstack([A, *rivals])
    ends = np.cumsum([0, *widths])
    return A, rivals, table.T @ table, [slice(a, b) for a, b in pairwise(ends)]


def left_over(target, columns):
    return float(np.sum((target - columns @ np.linalg.lstsq(columns, target, rcond=None)[0]) ** 2))


@pytest.mark.parametrize("seed", range(4))
def test_separation_is_what_the_wrong_rival_leaves_in_a_refit(seed):
    A, rivals, table, parts = random_problem(seed)
    sizes = [np.array([2.0]), np.array([0.5, -1.5])]
    found = separation(projected(table, A.shape[1]), parts, sizes, 0.0, 0.0)
    wrong = [left_over(rivals[t] @ sizes[t], np.hstack([A, rivals[1 - t]])) for t in (0, 1)]
    own = [left_over(rivals[t] @ sizes[t], A) for t in (0, 1)]
    worst = int(np.argmin(wrong))
    assert found.chi_square == pytest.approx(wrong[worst], rel=1e-8)
    assert found.size == pytest.approx(own[worst], rel=1e-8)
    assert found.share == pytest.approx(wrong[worst] / own[worst], rel=1e-8)


@pytest.mark.slow
def test_the_lead_of_the_right_rival_has_the_mean_and_spread_that_are_promised():
    """Monte Carlo: both are fitted to noisy data that the first one made."""
    A, rivals, table, parts = random_problem(7)
    sizes = [np.array([0.8]), np.zeros(2)]
    d2 = left_over(rivals[0] @ sizes[0], np.hstack([A, rivals[1]]))
    sizes[1] = np.array([50.0, 0.0])  # so large that only the first direction counts
    found = separation(projected(table, A.shape[1]), parts, sizes, 6.0, 0.0)
    assert found.chi_square == pytest.approx(d2, rel=1e-8)
    rng = np.random.default_rng(3)
    leads = []
    for _ in range(4000):
        data = rivals[0] @ sizes[0] + rng.normal(size=60)
        leads.append(left_over(data, np.hstack([A, rivals[1]])) - left_over(data, np.hstack([A, rivals[0]])))
    # The wrong one has a parameter more to fit noise with: a lead of one less.
    assert np.mean(leads) == pytest.approx(d2 - 1.0, abs=0.5)
    assert np.std(leads) == pytest.approx(2 * found.standard_deviations, rel=0.1)
    assert np.mean(np.array(leads) > 6.0) == pytest.approx(found.probability, abs=0.08)


def test_rivals_with_the_same_column_are_never_apart():
    A, rivals, _, _ = random_problem(1, widths=(1, 1))
    table = np.hstack([A, rivals[0], -3.0 * rivals[0] + A[:, :1]])
    apart = separation(projected(table.T @ table, 4), [slice(0, 1), slice(1, 2)], [np.ones(1)] * 2, 7.0, 0.0)
    assert apart.share < 1e-9
    assert apart.probability < 1e-6


def test_a_share_of_the_effects_own_size_may_be_asked_for():
    A, _, table, parts = random_problem(2)
    sizes = [np.array([20.0]), np.array([20.0, 0.0])]
    found = separation(projected(table, A.shape[1]), parts, sizes, 7.0, 0.02)
    assert found.needed == pytest.approx(max(7.0, 0.02 * found.size))


# --- on recordings ------------------------------------------------------------------------------------------------

PAIR = ("quadratic_loss", "velocity_root_friction")


def rivals_of(model: Model, joint: int, ids=PAIR) -> list[Term]:
    """Each in the shape of its grid that gains most."""
    found = []
    for name in ids:
        content = effect(name)
        trials = [Term(content, joint, shape) for shape in content.shapes(model.views[model.fitted[0]][joint])]
        found.append(max(trials, key=lambda term: gain(model, term)))
    return found


def gain(model: Model, term: Term) -> float:
    extra = extra_columns(model.design, model.views, [term])
    apart = projected(products(whitened(model.design, model.noise, model.fitted, extra)), len(model.design.parameters))
    return float(apart[:-1, -1] @ np.linalg.pinv(apart[:-1, :-1], rcond=1e-8, hermitian=True) @ apart[:-1, -1])


@pytest.fixture(scope="module")
def lossy() -> tuple[Session, NextExperiment]:
    """A joint with a quadratic loss, seen by one short motion."""
    machine, arm = planar_machine(2), truth(2)
    added = injected(machine, arm, effect("quadratic_loss"), 0, {}, [4000.0], [("train", 2)])
    session = make_session(machine, arm, [("train", 2)], added=added)
    return session, design_next(session.base_model, rivals_of(session.base_model, 0), session.prior, seconds=30.0)


def test_separation_in_hand_is_that_of_explicit_refits(lossy):
    """Noise-free forces of one rival at its fitted size, fitted by the other."""
    session, found = lossy
    model = session.base_model
    worst = np.inf
    for true, false in ((0, 1), (1, 0)):
        own = extra_columns(model.design, model.views, [found.rivals[true]])
        rows = with_prior(
            whitened(model.design, model.noise, model.fitted, own), model.design.parameters, session.prior
        )
        p = len(model.design.parameters)
        values = solve(rows, own.names).theta[p:]
        made = [replace(r, A=r.A[:, :p], b=r.A[:, p:] @ values) for r in rows]
        other = extra_columns(model.design, model.views, [found.rivals[false]])
        wrong = with_prior(
            whitened(model.design, model.noise, model.fitted, other), model.design.parameters, session.prior
        )
        fit = solve([replace(w, b=m.b) for w, m in zip(wrong, made, strict=True)], other.names)
        worst = min(worst, fit.chi_square)
    assert found.now.chi_square == pytest.approx(worst, rel=1e-6)


def test_every_experiment_is_at_least_as_good_as_nothing_and_the_best_comes_first(lossy):
    _, found = lossy
    kinds = [option.kind for option in found.options]
    assert set(kinds) == {
        "staircase", "slow_reversals", "frequencies", "two_poses", "neighbour", "free_cylinder", "again", "designed",
    }  # fmt: skip
    assert all(option.expected.chi_square >= found.now.chi_square * (1 - 1e-9) for option in found.options)
    margins = [option.expected.margin for option in found.options if option.kind != "designed"]
    assert margins == sorted(margins, reverse=True)
    assert found.best is found.options[0]
    assert found.best.expected.chi_square > 2 * found.now.chi_square


def test_the_motion_of_the_best_experiment_can_be_run(lossy, tmp_path):
    session, found = lossy
    for option in found.options:
        if option.motion is None:
            assert option.kind == "again"
            continue
        write_motion(tmp_path / "m.csv", option.motion)
        assert read_motion(tmp_path / "m.csv", session.machine).seconds == pytest.approx(option.motion.seconds)


def test_the_report_holds_the_text_and_the_numbers(lossy):
    session, found = lossy
    content = found.to_json(session.machine, "next.csv")
    assert json.loads(json.dumps(content, allow_nan=False)) == content
    assert content["separates"] == list(PAIR)
    assert content["joint"] == "joint1"
    assert content["motion_file"] == "next.csv"
    assert content["kind"] == found.best.kind
    assert content["seconds"] == found.best.motion.seconds
    assert content["motion"].startswith(found.best.text)
    assert f"{found.now.standard_deviations:.1f} standard deviations" in content["why"]
    assert content["expected"]["chi_square"] == found.best.expected.chi_square
    assert [entry["kind"] for entry in content["menu"]] == [option.kind for option in found.options]
    assert len(content["otherwise"]) == 2


def test_the_same_seed_gives_the_same_experiment(lossy):
    session, found = lossy
    again = design_next(session.base_model, found.rivals, session.prior, seconds=30.0)
    assert [option.expected.chi_square for option in again.options] == [o.expected.chi_square for o in found.options]


def test_a_rival_that_was_added_already_is_taken_out_first(lossy):
    """The loop hands over the model with the best rival in it; the answer is the same."""
    session, found = lossy
    model = session.base_model
    added = fit_model(model.design, model.noise, model.fitted, [found.rivals[0]], session.prior)
    again = design_next(added, found.rivals, session.prior, seconds=30.0, generations=0)
    assert again.now.chi_square == pytest.approx(found.now.chi_square, rel=0.02)
    kept = {option.kind: option.expected.chi_square for option in found.options}
    for option in again.options:
        assert option.expected.chi_square == pytest.approx(kept[option.kind], rel=0.1)


def test_an_effect_that_is_not_in_question_belongs_to_the_base(lossy):
    session, found = lossy
    model = session.base_model
    other = Term(effect("position_dependent_friction"), 0)
    both = fit_model(model.design, model.noise, model.fitted, [other], session.prior)
    with_other = design_next(both, found.rivals, session.prior, seconds=30.0, generations=0)
    assert with_other.now.chi_square <= found.now.chi_square * 1.05


def test_rivals_that_no_motion_separates_get_the_catalogues_experiments():
    """A constant force, and a Coulomb friction that differs with direction: the same column whatever moves."""
    session = clean_session()
    rivals = [Term(effect("pressure_offset"), 0), Term(effect("asymmetric_friction"), 0)]
    found = design_next(session.base_model, rivals, session.prior, generations=1)
    content = found.to_json(session.machine)
    assert found.best is None
    assert content["recordings"] is None
    assert content["motion_file"] is None
    assert effect("pressure_offset").experiment in content["motion"]
    assert effect("asymmetric_friction").experiment in content["motion"]
    assert "no motion tells them apart" in content["why"]


@pytest.mark.slow
def test_supply_limits_are_kept():
    session = clean_session()
    machine = session.machine
    found = design_next(session.base_model, rivals_of(session.base_model, 1), session.prior, generations=1)
    base = session.base
    values = session.base_model.fit.theta[session.base_model.design.parameters.base_slice]
    flows = [
        use.reached
        for option in found.options
        if option.motion is not None and option.motion.rods == "pinned"
        for use in used_by(machine, option.motion, HydraulicLimits(flow=1.0), base)
        if use.quantity == "flow"
    ]
    limits = HydraulicLimits(flow=0.4 * max(flows), pressure=30e6, base_parameters=values)
    kept = design_next(
        session.base_model, rivals_of(session.base_model, 1), session.prior, generations=1, hydraulic=limits
    )
    for option in kept.options:
        if option.motion is not None and option.motion.rods == "pinned":
            assert all(use.used <= 1.02 for use in used_by(machine, option.motion, limits, base)), option.kind


@pytest.mark.slow
def test_without_limits_given_those_of_the_machine_file_are_kept():
    """Loads and friction are then the fitted ones."""
    machine = planar_machine(2)
    free = supply_of(make_session(machine, truth(2)).base_model)
    assert free.flow is None
    assert free.pressure is None
    supply = Hydraulics(supply_pressure=20e6, tank_pressure=2e5, pump_flow=1e-4)
    session = make_session(machine.model_copy(update={"hydraulics": supply}), truth(2))
    model = session.base_model
    limits = supply_of(model)
    assert (limits.flow, limits.pressure, limits.back_pressure) == (1e-4, 20e6, 2e5)
    np.testing.assert_array_equal(limits.base_parameters, model.fit.theta[model.design.parameters.base_slice])
    coulomb = [model.fit.theta[model.design.parameters.names.index(f"{joint.name}.f_c")] for joint in machine.joints]
    assert np.all(limits.friction > np.abs(coulomb))
    found = design_next(model, rivals_of(model, 1), session.prior, generations=1)
    flows = [
        use.used
        for option in found.options
        if option.motion is not None and option.motion.rods == "pinned"
        for use in used_by(session.machine, option.motion, limits, session.base)
        if use.quantity == "flow"
    ]
    assert flows
    assert max(flows) <= 0.94  # of which 0.92 are asked for; speeds here are differences of rows
    assert max(flows) > 0.8


def used_by(machine: Machine, motion: Motion, limits: HydraulicLimits, base):
    q = motion.joint_positions(machine)
    qd = np.gradient(q, motion.time, axis=0)
    return limits_used(machine, limits, q, qd, np.gradient(qd, motion.time, axis=0), base)


def test_one_rival_alone_is_no_question():
    session = clean_session()
    with pytest.raises(ValueError, match="two rivals or more"):
        design_next(session.base_model, [Term(effect("quadratic_loss"), 0)], session.prior)


# --- against a plant that shares no code with the fit -------------------------------------------------------------


def plant_recordings(case, motion, size, number):
    """Tables of one motion as measured with the effect, and ideal ones with it and without."""
    from sim_backends.plant import record_beside_ideal

    machine, arm, name = case
    made = []
    for effects in ([(name, "joint2", size)], []):
        made.append(
            record_beside_ideal(
                machine,
                arm,
                motion,
                undeclared=effects,
                rng=np.random.default_rng([5, number]),
                shapes=np.random.default_rng([5, 99]),
            )
        )
    return made[0][0], made[0][1], made[1][1]


def as_recording(machine, table, role, number):
    values = {name: np.asarray(column) for name, column in table.items() if name != "time"}
    return Recording(machine.name, role, f"{number}", f"{number}", machine.rate_hz, np.asarray(table["time"]), values)


def waveform(machine, with_effect, without):
    """What the effect adds to the drive efforts, (N, n)."""
    columns = []
    for joint in machine.joints:
        head, rod = (f"{joint.name}.{chamber}_pressure" for chamber in ("head", "rod"))
        columns.append(
            (with_effect[head] - without[head]) * joint.cylinder.head_area
            - (with_effect[rod] - without[rod]) * joint.cylinder.rod_area
        )
    return np.column_stack(columns)


def measured_separation(session, tables, rivals):
    """Excess of the wrong rival when both are fitted to the true waveform of the effect, all recordings together."""
    machine, model = session.machine, session.base_model
    recordings = [as_recording(machine, t[0], role, k) for k, (role, t) in enumerate(tables)]
    segments = prepare(machine, recordings, session.bank, noise=model.design.noise)
    real = build_design(machine, session.base, session.bank, model.design.noise, segments)
    every = tuple(range(len(segments)))
    views = build_views(real, model.fit.theta, every)
    blocks = []
    for joint in range(len(machine.joints)):
        row = []
        for segment, block in zip(segments, real.blocks[joint], strict=True):
            _, (_, with_effect, without) = tables[segment.recording]
            wave = waveform(machine, with_effect, without)[segment.start : segment.start + len(segment), joint]
            row.append(replace(block, target=wave, reduced_target=session.bank.reduce(wave)))
        blocks.append(tuple(row))
    design = replace(real, blocks=tuple(blocks))
    extra = extra_columns(design, views, rivals)
    prior = replace(session.prior, mass=np.where(np.isnan(session.prior.mass), np.nan, 0.0))
    rows = with_prior(whitened(design, model.noise, every, extra), design.parameters, prior)
    apart = projected(products(rows), len(design.parameters))
    left, at = [], 0
    for term in rivals:
        part = slice(at, at := at + len(term.content.parameters))
        own = np.linalg.pinv(apart[part, part], rcond=1e-8, hermitian=True)
        left.append(float(apart[-1, -1] - apart[part, -1] @ own @ apart[part, -1]))
    return left[1] - left[0]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("true", "rival", "size"),
    [("quadratic_loss", "stribeck", 100.0), ("position_dependent_friction", "load_dependent_friction", 40.0)],
)
def test_the_designed_experiment_separates_rivals_in_the_plant_best(true, rival, size):
    """One short training motion leaves two names; the motion that was chosen tells them apart better than others."""
    pytest.importorskip("mujoco")
    from sim_backends.machines import folding_arm
    from sim_backends.motion import Motion as PlantMotion
    from sim_backends.motion import random_motion

    machine, arm = folding_arm(0)
    case = (machine, arm, true)
    training = plant_recordings(case, random_motion(machine, np.random.default_rng([0, 11]), 30.0), size, 0)
    session = Session(machine, [as_recording(machine, training[0], "train", 0)])
    rivals = rivals_of(session.base_model, 1, (true, rival))
    found = design_next(session.base_model, rivals, session.prior)
    expected, measured = {}, {}
    for option in found.options:
        if option.motion is None:
            continue
        names = tuple(option.motion.columns)
        positions = np.stack([option.motion.columns[name] for name in names], axis=1)
        motion = PlantMotion(machine.name, option.motion.rods, names, option.motion.time, positions)
        role = "unloaded" if option.motion.rods == "unpinned" else "train"
        tables = [("train", training), (role, plant_recordings(case, motion, size, 50))]
        expected[option.kind] = option.expected.chi_square
        measured[option.kind] = measured_separation(session, tables, rivals)
    before = measured_separation(session, [("train", training)], rivals)
    best = found.best.kind
    assert best in measured
    assert measured[best] == max(measured.values())
    assert measured[best] > 2 * before
    # Of the size that was promised, on the scale of standard deviations.
    for kind, value in measured.items():
        assert np.sqrt(max(value, 0.0)) == pytest.approx(np.sqrt(expected[kind]), rel=0.5), kind
