"""Detection limits: power as promised, sizes from projected columns, and forecasts that agree with recordings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2
from synthetic_arm import (
    USUAL,
    clean_session,
    exact_design,
    injected,
    make_motion,
    make_session,
    planar_machine,
    truth,
)

from daq.motion_files import Motion
from fitting.arm.base_parameters import reduce_parameters
from fitting.effects import effect, effects
from fitting.planning.detection import Visibility, typical_terms, visibilities, visible_size
from fitting.planning.forecast import forecast, forecast_to_json, white_noise
from fitting.planning.guess import default_guess
from fitting.regression.design import whitened
from fitting.regression.identifiability import ParameterVerdict, parameter_sizes, parameter_verdicts, statement
from fitting.regression.prior import mass_prior, with_prior
from fitting.regression.solving import solve
from fitting.residual.terms import Term, extra_columns
from fitting.signals.filters import filter_bank


@pytest.mark.parametrize("parameters", [1, 2, 3])
@pytest.mark.parametrize("power", [0.5, 0.95])
def test_a_size_is_found_as_often_as_its_power_says(parameters, power):
    """Monte Carlo: the gain of ``k`` columns is the squared length of a shifted standard normal in ``k`` dimensions."""
    needed = 14.0 + 6.0 * parameters
    size = visible_size(needed, parameters, power)
    draws = np.random.default_rng(parameters).normal(size=(40_000, parameters))
    draws[:, 0] += size
    found = np.mean(np.sum(draws**2, axis=1) > needed)
    assert found == pytest.approx(power, abs=4 * np.sqrt(power * (1 - power) / 40_000))


def test_half_the_power_is_near_the_threshold_itself():
    assert visible_size(20.0, 1, 0.5) == pytest.approx(np.sqrt(20.0), rel=1e-3)
    assert visible_size(20.0, 1, 0.95) == pytest.approx(np.sqrt(20.0) + 1.645, rel=1e-3)


def test_a_power_below_the_level_of_the_test_is_refused():
    with pytest.raises(ValueError, match="is not between the level"):
        visible_size(3.84, 1, 0.9 * float(chi2.sf(3.84, 1)))
    with pytest.raises(ValueError, match="is not between the level"):
        visible_size(3.84, 1, 1.0)


def sight(session, terms):
    model = session.base_model
    return visibilities(model.design, model.noise, model.views, model.rows(), model.fitted, terms)


TERMS = (
    Term(effect("position_dependent_friction"), 0),
    Term(effect("quadratic_loss"), 1),
    Term(effect("load_dependent_friction"), 1),
    Term(effect("pressure_offset"), 0),
)


def test_sizes_are_what_a_refit_with_the_effect_says():
    """Independent of projections: the information of an explicit joint refit with the column in it."""
    session = clean_session()
    model = session.base_model
    for term, seen in zip(TERMS, sight(session, TERMS), strict=True):
        assert isinstance(seen, Visibility)
        extra = extra_columns(model.design, model.views, [term])
        rows = whitened(model.design, model.noise, model.fitted, extra)
        if len(extra.names) == 1:
            refitted = solve(with_prior(rows, model.design.parameters, session.prior), extra.names)
            assert seen.per_unit * refitted.std[-1] == pytest.approx(1.0, rel=1e-4)
        norm = np.sqrt(sum(np.sum(own.A[:, len(model.design.parameters)] ** 2) for own in rows))
        assert seen.surviving == pytest.approx(seen.per_unit / norm, rel=1e-6)
        assert 0 < seen.surviving <= 1


def test_an_effect_of_the_smallest_size_gains_what_is_needed():
    """Injected at the size that is found half of the time, the noise-free gain is the threshold."""
    machine, arm = planar_machine(2), truth(2)
    session = clean_session()
    term = TERMS[0]
    (seen,) = sight(session, [term])
    needed = 20.0
    size = np.sqrt(needed) / seen.per_unit
    values = [size] + [0.0] * (len(term.content.parameters) - 1)
    added = injected(machine, arm, term.content, 0, {}, values)
    model = session.base_model
    design = model.design
    total = 0.0
    root = solve(model.rows()).orthonormal
    shadow = np.zeros(root[0].shape[1])
    for joint in range(2):
        parts = []
        for index in model.fitted:
            # Clean recordings keep every row but the filters' margins.
            own = design.bank.trimmed(added[design.segments[index].recording][:, joint])
            parts.append(design.white(model.noise, joint, index, design.bank.reduce(own)))
        white = np.concatenate(parts)
        total += float(white @ white)
        shadow += root[joint][: len(white)].T @ white
    assert total - shadow @ shadow == pytest.approx(needed, rel=0.03)


def test_a_column_that_the_base_has_already_is_never_seen():
    """``|v| sgn v`` to the power one is the viscous friction of the base."""
    session = clean_session()
    copy = Term(effect("velocity_root_friction"), 0, {"exponent": 1.0})
    name = next(iter(effect("velocity_root_friction").shapes(session.base_model.views[0][0])[0]))
    (seen,) = sight(session, [replace(copy, shape={name: 1.0})])
    assert seen.surviving < 1e-4
    assert seen.smallest(20.0, 0.95) == np.inf


def test_typical_terms_are_one_per_effect_and_place():
    session = clean_session()
    model = session.base_model
    terms = typical_terms(model.design.machine, effects(), model.views[1])
    families = [term.family for term, _ in terms]
    assert len(families) == len(set(families))
    assert ("base_tilt", None) in families
    assert {joint for name, joint in families if name == "stribeck"} == {0, 1}
    choices = {term.id: count for term, count in terms}
    assert choices["pressure_offset"] == 1
    assert choices["stribeck"] > 3
    shown = sight(session, [term for term, _ in terms])
    assert all(0.0 <= seen.surviving <= 1.0 for seen in shown)


# --- forecasts ----------------------------------------------------------------------------------------------------


def plan(machine, roles=USUAL):
    motions = []
    for role, seed in roles:
        moved = make_motion(machine, role, seed)
        rods, values = ("unpinned", moved.x) if role == "unloaded" else ("pinned", moved.q)
        motions.append(
            Motion(machine.name, rods, moved.t, {j.name: values[:, k] for k, j in enumerate(machine.joints)})
        )
    return motions


def test_a_forecast_agrees_with_what_the_recordings_then_show():
    """Shares that survive, from motions alone and a guess, against the same from a fit of the recordings."""
    machine = planar_machine(2)
    base = reduce_parameters(machine)
    fitted = [(role, seed) for role, seed in USUAL if role != "validate"]
    found = forecast(machine, base, plan(machine, fitted), default_guess(machine, base), effects())
    session = clean_session()
    planned = {v.term.family: v.surviving for v in found.visibilities}
    recorded = sight(session, [v.term for v in found.visibilities if v.term.id not in MOVED])
    for seen in recorded:
        assert planned[seen.term.family] == pytest.approx(seen.surviving, abs=0.12), seen.term.family
    assert {t.name for t in found.verdicts} == set(session.base_model.design.parameters.names)


#: Effects whose shape means another thing on another set of forces or recordings.
MOVED = ("payload", "pressure_gain", "pressure_dependent_friction", "structural_flexibility", "backlash", "gas_spring")


def test_a_forecast_in_json_has_every_effect_and_no_infinite_number():
    machine = planar_machine(2)
    base = reduce_parameters(machine)
    guess = default_guess(machine, base)
    (motion,) = plan(machine, [("train", 2)])
    one = replace(motion, columns={"joint1": motion.columns["joint1"]})
    content = forecast_to_json(forecast(machine, base, [one], guess, effects()), guess)
    sizes = {(entry["id"], entry["joint"]): entry["smallest"] for entry in content["effects"]}
    assert sizes[("stribeck", "joint2")] is None
    assert sizes[("stribeck", "joint1")] > 0
    assert all(size is None or np.isfinite(size) for size in sizes.values())
    assert content["power"] == 0.95
    assert content["basis"] == guess.statement
    assert content["parameters_statement"].startswith("this motion tells")


def test_white_noise_is_as_large_as_asked_and_white_in_the_band():
    bank = filter_bank(50.0, 3.0)
    model = white_noise(np.array([3.0, 50.0]), bank)
    np.testing.assert_allclose(model.std, [3.0, 50.0], rtol=0.05)
    noise = np.random.default_rng(3).normal(size=60_000)
    noise *= 3.0 / np.std(bank.reduce(noise))
    white = model.whitenings[0](bank.reduce(noise))[20:]
    lags = [np.corrcoef(white[:-k], white[k:])[0, 1] for k in (1, 2, 3)]
    # Decimated to 1.4 times the band, a spectrum that ends there cannot be flat to the edge.
    assert np.abs(lags).max() < 0.3


# --- identifiability ----------------------------------------------------------------------------------------------


def named(found: tuple[ParameterVerdict, ...]):
    return {telling.name: telling for telling in found}


def test_a_training_session_tells_everything_but_the_moving_masses():
    session = clean_session()
    model = session.base_model
    found = parameter_verdicts(model.design, model.noise, model.fitted, model.fit.theta, model.prior)
    assert [t.name for t in found] == list(model.design.parameters.names)
    np.testing.assert_allclose([t.std for t in found], model.fit.std[: len(found)], rtol=1e-6)
    verdicts = {t.name: t.verdict for t in found}
    assert {name for name, verdict in verdicts.items() if verdict != "told"} <= {"joint1.m", "joint2.m"}
    assert statement(found).startswith(f"this motion tells {sum(v == 'told' for v in verdicts.values())} of ")


def test_a_joint_that_stood_still_is_not_told_and_the_other_one_is():
    machine, arm = planar_machine(2), truth(2)
    session = make_session(machine, arm, [("operation", 2)], moving=[1])
    model = session.base_model
    found = named(parameter_verdicts(model.design, model.noise, model.fitted, model.fit.theta, session.prior))
    assert found["joint1.f_c"].verdict == "not told"
    assert found["joint1.f_c"].std == np.inf
    assert found["joint2.f_c"].verdict == "told"
    assert found["joint1.m"].verdict == "assumed"
    text = statement(tuple(found.values()))
    assert "not told: joint1.K, joint1.f_c" in text
    assert "assumed: joint1.m" in text


def test_without_a_prior_nothing_is_assumed():
    session = clean_session()
    model = session.base_model
    found = parameter_verdicts(model.design, model.noise, model.fitted, model.fit.theta)
    assert "assumed" not in {t.verdict for t in found}


def test_a_parameter_near_zero_is_measured_by_its_kind():
    """A first moment that is a thousandth of its neighbour is not blamed for it; nor is a small part of friction."""
    machine, arm = planar_machine(2), truth(2)
    design = exact_design(machine, arm)
    theta = arm.theta(machine)
    names = list(design.parameters.names)
    fitted = design.indices("unloaded", "train")
    sizes = dict(zip(names, parameter_sizes(design, fitted, theta), strict=True))
    values = dict(zip(names, np.abs(theta), strict=True))
    my = next(name for name in names if name.startswith("MY2"))
    mx = next(name for name in names if name.startswith("MX2"))
    assert sizes[my] == sizes[mx]
    assert sizes[mx] == pytest.approx(np.hypot(values[mx], values[my]) / np.sqrt(2))
    assert sizes["joint1.f_s"] > values["joint1.f_s"]
    fastest = max(np.abs(design.segments[i].v[:, 0]).max() for i in fitted)
    friction = np.sqrt(
        values["joint1.f_c"] ** 2
        + (values["joint1.f_v"] * fastest) ** 2
        + (values["joint1.f_s"] * np.cbrt(fastest)) ** 2
    )
    assert sizes["joint1.f_s"] * np.cbrt(fastest) == pytest.approx(friction)
    assert sizes["joint1.K"] == values["joint1.K"]


def test_a_plan_tells_what_its_recording_then_tells():
    machine, arm = planar_machine(2), truth(2)
    base = reduce_parameters(machine)
    session = make_session(machine, arm, [("train", 2)])
    model = session.base_model
    recorded = named(parameter_verdicts(model.design, model.noise, model.fitted, model.fit.theta, mass_prior(machine)))
    guess = replace(
        default_guess(machine, base), base=base.from_standard(arm.pi), drive=tuple(arm.drive), noise=model.noise.std
    )
    planned = named(forecast(machine, base, plan(machine, [("train", 2)]), guess, []).verdicts)
    for name, telling in recorded.items():
        if np.isfinite(telling.std):
            assert planned[name].std == pytest.approx(telling.std, rel=0.5), name
