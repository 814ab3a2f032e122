"""The next experiment: separations as explicit refits have them, motions that can be run, and honest advice."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from synthetic_arm import clean_session, injected, make_session, planar_machine, prepare, truth

from daq.machine.machine_file import Hydraulics, Machine
from daq.motion_files import Motion, read_motion, write_motion
from daq.recordings.recording import Recording
from fitting.effects import effect
from fitting.effects.base import Parameter
from fitting.excitation.limits import HydraulicLimits, limits_used
from fitting.loop.closing import asked_of
from fitting.loop.session import Session
from fitting.planning.next_experiment import NextExperiment, design_next, supply_of
from fitting.planning.separation import Lead, Rival, leads, products, projected, separation
from fitting.regression.design import build_design, whitened
from fitting.regression.prior import with_prior
from fitting.regression.solving import solve
from fitting.residual.terms import Model, Term, extra_columns, fit_model
from fitting.residual.views import SegmentViews
from fitting.selection import priors

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


def rival(place: slice, values, terms=(), places=()) -> Rival:
    values = np.asarray(values, dtype=float)
    return Rival((plain(len(values)), *terms), (place, *places), values)


def plain(width: int) -> Term:
    """A term whose parameters may be anything, so that only chi-square and sizes count."""
    parameters = tuple(Parameter(f"k{k}", "1") for k in range(width))
    free = type("Free", (type(effect("quadratic_loss")),), {"parameters": parameters})()
    return Term(free, 0)


@pytest.mark.parametrize("seed", range(4))
def test_what_the_wrong_rival_leaves_is_that_of_a_refit(seed):
    A, rivals, table, parts = random_problem(seed)
    sizes = [np.array([2.0]), np.array([0.5, -1.5])]
    found = leads(projected(table, A.shape[1]), [rival(p, v) for p, v in zip(parts, sizes, strict=True)])
    for true, false in ((0, 1), (1, 0)):
        made = rivals[true] @ sizes[true]
        assert found[true, false].chi_square == pytest.approx(left_over(made, np.hstack([A, rivals[false]])), rel=1e-8)
        assert found[true, false].size == pytest.approx(left_over(made, A), rel=1e-8)


def test_odds_of_rivals_with_one_parameter_each_are_half_of_what_the_wrong_one_leaves():
    """Both pay the same for their parameter; of large effects the evidence is then half of the chi-square."""
    A, rivals, table, parts = random_problem(3, widths=(1, 1))
    found = leads(projected(table, A.shape[1]), [rival(p, [200.0]) for p in parts])
    left = left_over(200.0 * rivals[0][:, 0], np.hstack([A, rivals[1]]))
    assert found[0, 1].log_odds == pytest.approx(0.5 * left, rel=0.01)


def test_a_wrong_rival_takes_the_shape_that_comes_nearest():
    A, rivals, _, _ = random_problem(1, widths=(1, 1))
    near = rivals[0] + 0.05 * rivals[1]
    table = np.hstack([A, rivals[0], rivals[1], near])
    gram = projected(table.T @ table, A.shape[1])
    one = rival(slice(0, 1), [3.0])
    stiff = leads(gram, [one, rival(slice(1, 2), [3.0])])[0, 1]
    free = leads(gram, [one, rival(slice(1, 2), [3.0], [plain(1)], [slice(2, 3)])])[0, 1]
    assert free.chi_square == pytest.approx(left_over(3.0 * rivals[0][:, 0], np.hstack([A, near])), rel=1e-8)
    assert free.chi_square < 0.2 * stiff.chi_square
    assert free.log_odds < stiff.log_odds


def test_a_rival_that_needs_an_impossible_value_is_behind():
    """A friction coefficient below zero: the same column with the other sign fits as well and is not believed."""
    column = np.random.default_rng(0).normal(size=(60, 1))
    table = np.hstack([column, -column])
    rivals = [
        rival(slice(0, 1), [2.0]),
        Rival((Term(effect("load_dependent_friction"), 0),), (slice(1, 2),), np.ones(1)),
    ]
    found = leads(table.T @ table, rivals)[0, 1]
    size = 4.0 * float(column[:, 0] @ column[:, 0])
    assert found.chi_square == pytest.approx(size), "nothing of it is left inside the bounds"
    assert found.log_odds > 0.4 * size


def lead(chi_square, size=100.0, log_odds=None) -> Lead:
    return Lead(size, chi_square, 0.5 * chi_square if log_odds is None else log_odds)


def test_what_is_asked_for_grows_with_the_effect_because_formulas_are_not_exact():
    """Of what is 3, 10 or 15 % off in its formula, 0.0009, 0.01 or 0.0225 of its chi-square is chance, beside 5.9."""
    two = [rival(slice(0, 1), [1.0]), rival(slice(1, 2), [1.0])]
    small, large = (
        separation({(0, 1): lead(9.0, s), (1, 0): lead(9.0, s)}, {(0, 1): lead(9.0, s), (1, 0): lead(9.0, s)}, two)
        for s in (10.0, 1000.0)
    )
    for found, size in ((small, 10.0), (large, 1000.0)):
        stated = 0.0
        for off, weight in ((0.03, 0.4), (0.1, 0.4), (0.15, 0.2)):  # physics' own, not series'
            odds = found.worst.asked / (1 + off**2 * size / (2 * np.log(19)))
            stated += weight / (1 + np.exp(-odds))
        assert stated == pytest.approx(0.95, abs=1e-6)
    assert small.worst.asked == pytest.approx(np.log(19), rel=0.05)
    assert small.probability > large.probability


def test_what_is_known_already_is_where_the_odds_start():
    two = [rival(slice(0, 1), [1.0]), rival(slice(1, 2), [1.0])]
    now = {(0, 1): lead(4.0, 1e-6), (1, 0): lead(4.0, 1e-6)}
    then = {(0, 1): lead(20.0, 1e-6), (1, 0): lead(20.0, 1e-6)}
    found = separation(now, then, two, [0.8, 0.2])
    assert [pair.expected for pair in found.pairs] == pytest.approx([np.log(4) + 8.0, -np.log(4) + 8.0])
    assert [pair.chance for pair in found.pairs] == [0.8, 0.2]
    assert found.pairs[0].spread == pytest.approx(np.hypot(4.0, 0.5))
    assert found.worst is found.pairs[1]


@pytest.mark.slow
def test_the_odds_of_the_right_rival_have_the_mean_and_spread_that_are_promised():
    """Monte Carlo: both are fitted to noisy data that the first one made; evidence is half of the chi-square."""
    A, rivals, table, parts = random_problem(7, widths=(1, 1))
    two = [rival(part, [8.0]) for part in parts]
    found = leads(projected(table, A.shape[1]), two)
    promised = separation(found, found, two).pairs[0]
    rng = np.random.default_rng(3)
    odds = []
    for _ in range(4000):
        data = 8.0 * rivals[0][:, 0] + rng.normal(size=60)
        odds.append(0.5 * (left_over(data, np.hstack([A, rivals[1]])) - left_over(data, np.hstack([A, rivals[0]]))))
    assert np.mean(odds) == pytest.approx(promised.expected, rel=0.05)
    assert np.std(odds) == pytest.approx(promised.spread, rel=0.1)


def test_rivals_with_the_same_column_are_never_apart():
    A, rivals, _, _ = random_problem(1, widths=(1, 1))
    table = np.hstack([A, rivals[0], -3.0 * rivals[0] + A[:, :1]])
    two = [rival(slice(0, 1), [1.0]), rival(slice(1, 2), [1.0])]
    found = leads(projected(table.T @ table, 4), two)
    apart = separation(found, found, two)
    assert apart.worst.share < 1e-9
    assert apart.probability < 1e-6


# --- on recordings ------------------------------------------------------------------------------------------------

PAIR = ("quadratic_loss", "stribeck")


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
    added = injected(machine, arm, effect("quadratic_loss"), 0, {}, [12000.0], [("train", 7)])
    session = make_session(machine, arm, [("train", 7)], added=added)
    return session, design_next(session.base_model, rivals_of(session.base_model, 0), session.prior, seconds=30.0)


def test_separation_in_hand_is_that_of_explicit_refits(lossy):
    """Noise-free forces of one rival at its fitted size, fitted by the other in the shape of its grid that is best."""
    session, found = lossy
    model = session.base_model
    p = len(model.design.parameters)

    def rows_with(term):
        extra = extra_columns(model.design, model.views, [term])
        white = whitened(model.design, model.noise, model.fitted, extra)
        return with_prior(white, model.design.parameters, session.prior), extra.names

    for true, false in ((0, 1), (1, 0)):
        rows, names = rows_with(found.rivals[true])
        values = solve(rows, names).theta[p:]
        made = [r.A[:, p:] @ values for r in rows]
        wrong = found.rivals[false]
        left = []
        for shape in (wrong.shape, *wrong.content.shapes(model.views[model.fitted[0]][0])):
            rows, names = rows_with(replace(wrong, shape=shape))
            left.append(solve([replace(r, b=m) for r, m in zip(rows, made, strict=True)], names).chi_square)
        assert found.now.pairs[true].chi_square == pytest.approx(min(left), rel=1e-6)


def test_every_experiment_is_at_least_as_good_as_nothing_and_the_best_comes_first(lossy):
    _, found = lossy
    kinds = [option.kind for option in found.options]
    assert set(kinds) == {
        "staircase", "slow_reversals", "frequencies", "two_poses", "neighbour", "free_cylinder", "again", "designed",
    }  # fmt: skip
    assert all(option.expected.worst.chi_square >= found.now.worst.chi_square * (1 - 1e-9) for option in found.options)
    assert kinds[-1] == "again"
    margins = [option.expected.margin for option in found.options[:-1] if option.kind != "designed"]
    assert margins == sorted(margins, reverse=True)
    assert found.best is found.options[0]
    assert found.best.expected.worst.chi_square > 2 * found.now.worst.chi_square


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
    assert f"{np.sqrt(found.now.worst.chi_square):.1f} standard deviations" in content["why"]
    assert content["expected"]["chi_square"] == found.best.expected.worst.chi_square
    assert [entry["kind"] for entry in content["menu"]] == [option.kind for option in found.options]
    assert content["closable"]
    assert "recordings needed: 1, chance of a single name" in content["why"]
    assert content["otherwise"] == [effect("quadratic_loss").experiment]


@pytest.mark.slow
def test_the_same_seed_gives_the_same_experiment(lossy):
    session, found = lossy
    again = design_next(session.base_model, found.rivals, session.prior, seconds=30.0)
    assert [option.expected.worst.chi_square for option in again.options] == [
        o.expected.worst.chi_square for o in found.options
    ]


def test_a_rival_that_was_added_already_is_taken_out_first(lossy):
    """The loop hands over the model with the best rival in it; the answer is the same."""
    session, found = lossy
    model = session.base_model
    added = fit_model(model.design, model.noise, model.fitted, [found.rivals[0]], session.prior)
    again = design_next(added, found.rivals, session.prior, seconds=30.0, generations=0)
    assert again.now.worst.chi_square == pytest.approx(found.now.worst.chi_square, rel=0.02)
    kept = {option.kind: option.expected.worst.chi_square for option in found.options}
    for option in again.options:
        assert option.expected.worst.chi_square == pytest.approx(kept[option.kind], rel=0.1)


def test_an_effect_that_is_not_in_question_belongs_to_the_base(lossy):
    session, found = lossy
    model = session.base_model
    other = Term(effect("position_dependent_friction"), 0)
    both = fit_model(model.design, model.noise, model.fitted, [other], session.prior)
    with_other = design_next(both, found.rivals, session.prior, seconds=30.0, generations=0)
    assert with_other.now.worst.chi_square <= found.now.worst.chi_square * 1.05


def test_of_rivals_that_no_motion_separates_is_said_what_tells_them_by_hand():
    """A constant force, and a Coulomb friction that differs with direction: the same column whatever moves."""
    session = clean_session()
    rivals = [Term(effect("pressure_offset"), 0), Term(effect("asymmetric_friction"), 0)]
    found = design_next(session.base_model, rivals, session.prior, generations=1)
    content = found.to_json(session.machine)
    assert found.best is None
    assert content["recordings"] is None
    assert content["motion_file"] is None
    assert effect("pressure_offset").experiment in content["motion"]
    assert not found.closable
    assert content["closable"] is False
    assert "these sensors cannot tell; all mean the same effort to" in content["why"]
    assert content["why"].endswith(f"what would tell: {effect('pressure_offset').experiment}")
    assert asked_of(found, session) is None


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
    from sim_backends.plant.plant import record_beside_ideal

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
    views = SegmentViews(real, model.fit.theta, every)
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
    [("position_dependent_friction", "load_dependent_friction", -40.0)],
)
def test_the_designed_experiment_separates_rivals_in_the_plant(true, rival, size):
    """One short training motion leaves two names; the motion that was chosen tells them apart, as promised."""
    pytest.importorskip("mujoco")
    from sim_backends.machines import folding_arm
    from sim_backends.plant.motion import Motion as PlantMotion
    from sim_backends.plant.motion import random_motion

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
        expected[option.kind] = option.expected.worst.chi_square
        measured[option.kind] = measured_separation(session, tables, rivals)
    before = measured_separation(session, [("train", training)], rivals)
    assert found.best is not None
    best = found.best.kind
    assert best in measured
    # Several tell them apart for certain, and the easiest of those is chosen.
    assert expected[best] > before + priors.CLOSE
    assert measured[best] > max(2 * before, before + 4 * priors.CLOSE)
    # Of the size that was promised, on the scale of standard deviations; of the others not less.
    assert np.sqrt(measured[best]) == pytest.approx(np.sqrt(expected[best]), rel=0.5)
    for kind, value in measured.items():
        assert np.sqrt(max(value, 0.0)) > 0.5 * np.sqrt(expected[kind]), kind
