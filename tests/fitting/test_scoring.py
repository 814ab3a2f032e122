"""Scores of candidates are what two explicit least-squares fits would say."""

from __future__ import annotations

import numpy as np
import pytest
from synthetic_arm import clean_session, injected, make_session, planar_machine, truth

from fitting.effects import effect, effects
from fitting.loop.session import Session
from fitting.regression.design import whitened
from fitting.regression.prior import with_prior
from fitting.residual.laws import Law
from fitting.residual.scoring import Candidates, Score, catalogue_terms, law_terms, score_terms
from fitting.residual.terms import Model, Term, extra_columns, fit_model
from fitting.selection.gains import margin
from fitting.signals.splines import evaluate, spline_knots


def explicit_gain(session: Session, model: Model, term: Term) -> tuple[float, np.ndarray]:
    """Chi-square with and without the candidate by numpy's lstsq, and the candidate's parameters."""
    design = model.design
    joint_count = len(design.machine.joints)

    def stacked(terms: tuple[Term, ...]) -> tuple[np.ndarray, np.ndarray]:
        extra = extra_columns(design, model.views, terms)
        rows = with_prior(whitened(design, model.noise, model.fitted, extra), design.parameters, session.prior)
        assert len(rows) == joint_count
        return np.vstack([r.A for r in rows]), np.concatenate([r.b for r in rows])

    chi, theta = [], np.zeros(0)
    for terms in (model.terms, (*model.terms, term)):
        A, b = stacked(terms)
        scale = np.linalg.norm(A, axis=0)
        theta = np.linalg.lstsq(A / scale, b, rcond=1e-13)[0] / scale
        residual = b - A @ theta
        chi.append(residual @ residual)
    width = len(term.names(design.parameters.joints))
    return float(chi[0] - chi[1]), theta[-width:]


CASES = [
    Term(effect("position_dependent_friction"), 1),
    Term(effect("load_dependent_friction"), 0),
    Term(effect("quadratic_loss"), 1),
    Term(effect("pose_dependent_friction"), 0, {"other": 1.0}),
    Term(effect("cross_cylinder_coupling"), 1, {"other": 0.0}),
    Term(effect("payload"), None, {"recording": 1.0, "t_0": 15.0}),
    Term(effect("structural_flexibility"), 1),
    Term(Law("piston_position", None, True, False, tuple(spline_knots(np.linspace(0.05, 0.25, 50), 6))), 1),
]


@pytest.mark.parametrize("term", CASES, ids=lambda t: f"{t.id}-{t.joint}")
def test_a_gain_is_the_difference_of_two_fits(term: Term) -> None:
    session = clean_session(2)
    model = session.base_model
    (score,) = score_terms(model, [term], [1])
    gain, values = explicit_gain(session, model, term)
    # 1e-8 of the chi-square that is taken apart, not of the small difference itself.
    if score.live < len(values):  # a direction that the base has too is known from its prior only, and does not count
        assert 0.98 * gain < score.gain < gain + 1e-8 * model.fit.chi_square
    elif score.free == score.values or term.id == "law":
        assert score.gain == pytest.approx(gain, abs=1e-8 * model.fit.chi_square, rel=1e-8)
    else:
        assert score.gain < gain, "outside of its bounds it would gain more"
    if score.live == len(values):
        assert np.allclose(score.free, values, rtol=1e-5, atol=1e-7 * np.abs(values).max())


def test_a_gain_lets_go_what_the_base_holds_at_zero_only_for_want_of_the_term() -> None:
    """A gas that pushes less the farther out the piston is makes a stiffness negative; beside the gas it is not."""
    machine, arm, shape = planar_machine(2), truth(2), {"side": -1.0, "rest": 0.6, "n": 1.4}
    term = Term(effect("gas_spring"), 1, shape)
    session = make_session(machine, arm, added=injected(machine, arm, term.content, 1, shape, [100.0, 0.0]))
    model = session.base_model
    refit = fit_model(model.design, model.noise, model.fitted, [term], session.prior, model)
    (score,) = score_terms(model, [term], [1])
    assert len(model.held[1]) > 0 and len(refit.held[1]) == 0
    assert score.gain == pytest.approx(model.fit.chi_square - refit.fit.chi_square, rel=1e-4)
    assert score.values[0] == pytest.approx(100.0, rel=0.15)


def test_a_gain_beside_an_accepted_effect_is_the_difference_of_two_fits() -> None:
    session = clean_session(2)
    base = session.base_model
    first = Term(effect("position_dependent_friction"), 1)
    model = fit_model(base.design, base.noise, base.fitted, [first], session.prior, base)
    term = Term(effect("stribeck"), 1, {"v_s": 0.01, "delta": 2.0})
    (score,) = score_terms(model, [term], [1])
    gain, _ = explicit_gain(session, model, term)
    assert score.gain == pytest.approx(gain, abs=1e-8 * model.fit.chi_square)
    # What is in the model already gains nothing.
    assert not [s for s in score_terms(model, [first], [1]) if s.gain > 1e-3]


def test_more_parameters_and_a_larger_grid_have_to_gain_more() -> None:
    model = clean_session(2).base_model
    terms = [Term(effect(name), 0) for name in ("pressure_offset", "position_dependent_friction")]
    few, several = (score_terms(model, [term], [1])[0] for term in terms)
    (many,) = score_terms(model, terms[1:], [20])
    assert few.live < several.live
    assert few.gain - margin(few) < several.gain - margin(several) < many.gain - margin(many)


def test_refreshed_columns_are_those_of_the_present_model() -> None:
    """Columns that hold the model's force go stale with a new model; what is refreshed is as good as built anew."""
    session = clean_session(2)
    base = session.base_model
    few = [effect(name) for name in ("stribeck", "payload", "load_dependent_friction", "sensor_latency")]
    terms, grid = catalogue_terms(base, few)
    candidates = Candidates(base, terms, grid)
    added = Term(effect("position_dependent_friction"), 1)
    model = fit_model(base.design, base.noise, base.fitted, [added], session.prior)
    stale = candidates.scores(model)
    candidates.refresh(model, range(len(terms)))
    renewed, fresh = candidates.scores(model), Candidates(model, terms, grid).scores(model)
    assert renewed.keys() == fresh.keys()
    changed = 0
    for number, score in fresh.items():
        assert renewed[number].gain == pytest.approx(score.gain, rel=1e-6, abs=1e-6)
        if not terms[number].uses_model:
            assert stale[number].gain == pytest.approx(score.gain, rel=1e-6, abs=1e-6)
        else:
            changed += stale[number].gain != pytest.approx(score.gain, rel=1e-6, abs=1e-6)
    assert changed


def test_a_column_that_the_base_explains_is_dead_and_skipped() -> None:
    """Twice the Coulomb friction's own column: what survives the projection is rounding, and must not score."""
    session = clean_session(2)
    model = session.base_model
    # A cubic spline of the speed in full contains the viscous term; five functions, but one direction is the base's.
    v = np.concatenate([model.design.segments[i].v[:, 0] for i in model.fitted])
    knots = spline_knots(v, 5)
    assert np.allclose(evaluate(knots, v).sum(axis=1), 1.0)
    (score,) = score_terms(model, [Term(Law("piston_speed", None, False, False, tuple(knots)), 0)], [1])
    assert score.live == 4
    # An inertia on the first joint's own axis is ZZ1 for every motion; the score must be silent about it.
    scores = score_terms(model, [Term(effect("actuator_inertia"), 0)], [1])
    assert scores == [] or scores[0].live == 0


@pytest.mark.slow
def test_nothing_scores_on_a_joint_that_it_does_not_apply_to() -> None:
    model = clean_session(2).base_model
    terms, grid = catalogue_terms(model, effects())
    assert len(terms) == len(grid)
    assert {t.joint for t in terms} == {None, 0, 1}
    assert not {"backlash", "encoder_offset"} & {t.id for t in terms}  # found between the two position sensors
    assert {t.joint for t in law_terms(model)[0]} == {0, 1}
    for term, size in zip(terms, grid, strict=True):
        assert size == sum(t.family == term.family and t.shape.get("other") == term.shape.get("other") for t in terms)


def test_on_a_clean_arm_scores_are_those_of_noise() -> None:
    """No candidate reaches the threshold, and one-parameter gains are chi-square numbers of one degree of freedom."""
    model = clean_session(2).base_model
    scores: list[Score] = score_terms(model, *catalogue_terms(model, effects()))
    assert max(map(margin, scores)) < 0.0
    singles = [s for s in scores if len(s.values) == 1 and s.values[0] != 0]
    assert len(singles) > 40
    for score in singles:
        assert score.gain == pytest.approx((score.values[0] / score.stds[0]) ** 2, rel=1e-6)
