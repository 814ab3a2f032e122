"""Standard deviations of what was found, not given: shapes that were searched, laws without physics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal
from synthetic_arm import clean_session, exact_views, make_session, planar_machine, truth

from fitting.effects import effect
from fitting.loop.refits import final_model
from fitting.loop.session import Session
from fitting.residual.confirmation.uncertainty import is_refused, sandwich_factors, with_uncertainties
from fitting.residual.laws import Law
from fitting.residual.null import Null
from fitting.residual.refinement import refined
from fitting.residual.scoring import score_terms
from fitting.residual.terms import Model, Term, fit_model
from fitting.signals.corrections import Corrections
from fitting.signals.splines import spline_knots

MACHINE, ARM = planar_machine(2), truth(2)
RECORDINGS = (("unloaded", 1), ("train", 2), ("train", 4), ("repeat", 2), ("validate", 3))


def session_with(force: object) -> Session:
    """Recordings with ``force(x, v)`` (N,) of joint 2's piston on top of its drive effort."""
    design, _ = exact_views(MACHINE, ARM, recordings=RECORDINGS)
    added = []
    for segment in design.segments:
        extra = np.zeros_like(segment.q)
        extra[:, 1] = force(segment.x[:, 1], segment.v[:, 1])  # type: ignore[operator]
        added.append(extra)
    return make_session(MACHINE, ARM, RECORDINGS, added=added)


def fitted(session: Session, *terms: Term) -> Model:
    plain = session.plain
    return fit_model(plain.design, plain.noise, plain.fitted, terms, session.prior)


def test_a_shape_that_was_searched_makes_its_parameter_less_certain() -> None:
    session = session_with(lambda x, v: 120.0 * np.exp(-np.abs(v) / 0.02) * np.sign(v))
    term = Term(effect("stribeck"), 1, {"v_s": 0.02, "delta": 1.0})
    model = fitted(session, term)
    # The same from the normal equations with the derivative as one more column, and a prior of half its value; `delta`
    # is a choice between two laws, not a number that was searched.
    rows = model.rows()
    A, value = np.vstack([r.A for r in rows]), model.fit.theta[-1]
    ends = []
    for factor in (1.004, 0.996):
        moved = fitted(session, Term(term.content, 1, {**term.shape, "v_s": 0.02 * factor}))
        ends.append(np.vstack([r.A for r in moved.rows()])[:, -1])
    whole = np.column_stack([A, value * (ends[0] - ends[1]) / 0.008])
    gram = whole.T @ whole + np.diag([0.0] * A.shape[1] + [4.0])
    scale = np.sqrt(np.diag(gram))
    explicit = np.sqrt(np.diag(np.linalg.inv(gram / np.outer(scale, scale)))) / scale
    ours = with_uncertainties(model)
    assert ours.fit.theta == pytest.approx(model.fit.theta)
    ratio = ours.fit.std / explicit[: A.shape[1]]
    # What is beyond is the sandwich of the joint with the effect, and Student's t of the noise's spectrum.
    ratio /= sandwich_factors(model, rows)
    assert ratio.min() > 1 - 1e-4
    assert ratio.max() < 1.3
    names = model.design.parameters.names
    dearer = {name: float(b / a) for name, a, b in zip(names, model.fit.std, explicit, strict=False)}
    assert max(dearer, key=lambda name: dearer[name]).startswith("joint2.f_")  # friction, of the joint that has it
    assert max(dearer.values()) > 1.05


def test_an_unknown_law_of_the_position_leaves_the_stiffness_open() -> None:
    # A spring that is caught half-way: what of it is a stiffness, and what a law, no recording tells.
    session = session_with(lambda x, v: 2000.0 * np.maximum(x - 0.12, 0.0))
    values = np.concatenate([session.plain.design.segments[i].x[:, 1] for i in session.plain.fitted])
    law = Law("piston_position", None, False, False, tuple(spline_knots(values, 8).tolist()))
    plain = fitted(session, Term(law, 1))  # its own deviation of the stiffness depends on rounding: it is held at zero
    model = final_model(session, Corrections(session.machine), [Term(law, 1)])[1].model
    place = model.design.parameters.names.index("joint2.K")
    true = ARM.drive[1][1]
    apart = abs(model.fit.theta[place] - true)
    assert apart < 2 * model.fit.std[place]
    other = model.design.parameters.names.index("joint1.K")
    assert model.fit.std[other] < 1.5 * plain.fit.std[other] + abs(model.fit.theta[other]) * 0.01


def test_a_column_that_the_base_takes_whole_says_nothing_and_does_no_harm() -> None:
    # The first link's own inertia stands in the base: frozen liquid there cannot be told from it.
    session = clean_session(2)
    model = session.base_model
    liquid = effect("carried_liquid")
    shape = liquid.shapes(model.views[model.fitted[0]][0])[20]
    (score,) = score_terms(model, [Term(liquid, 0, shape)], [1])
    assert score.live == 1
    assert not score.information[1].any()
    assert not score.information[:, 1].any()
    draws = np.array([[0.3 * score.stds[0], 1e-15], [-0.4 * score.stds[0], -3e-16], [0.1 * score.stds[0], 2e-16]])
    found = score.against(Null(draws, score.information, score.live))
    assert found.gain * found.trusted == pytest.approx(score.gain, abs=2 + 0.5 * score.gain)


@pytest.mark.slow
def test_a_search_does_not_leave_what_is_plausible() -> None:
    session = session_with(lambda x, v: 1000.0 * np.maximum(x - 0.10, 0.0))
    model = session.base_model
    cushion = Term(effect("end_cushion"), 1, {"side": 1.0, "share": 0.25, "n": 1.0})
    (score,) = score_terms(model, [cushion], [1])
    found = refined(model, refined(model, score))
    assert found.gain >= score.gain
    assert found.term.shape["share"] <= 0.25 * 1.25 + 1e-12, "nor does a second search, from where the first ended"
    assert 0.8 <= found.term.shape["n"] <= 2.5


@pytest.mark.slow
@pytest.mark.parametrize("cycles", [3.6, 4.4, 11.1, 30.4])
def test_a_search_reaches_a_pitch_between_any_two_of_the_grid(cycles: float) -> None:
    span = clean_session().base_model.views[0][1].range.span
    pitch = span / cycles
    model = session_with(lambda x, v: 80.0 * np.sin(2 * np.pi * x / pitch)).base_model
    harmonic = effect("position_harmonic")
    shapes = [shape for shape in harmonic.shapes(model.views[model.fitted[0]][1]) if not shape["odd"]]
    scores = score_terms(model, [Term(harmonic, 1, shape) for shape in shapes], [1] * len(shapes))
    found = refined(model, max(scores, key=lambda score: score.gain))
    assert found.term.shape["pitch"] == pytest.approx(pitch, rel=0.008)


def noisy(kind: str, seed: int) -> tuple[Session, Model, list[np.ndarray]]:
    """The clean arm with made-up whitened residuals: white on joint 1, and of a kind on joint 2."""
    session, rng = clean_session(), np.random.default_rng(seed)
    model = session.base_model
    first, second = (rng.normal(size=len(e)) for e in model.fit.residual)
    if kind == "coloured":
        second = signal.lfilter([1.0], [1.0, -0.7], second)
    elif kind == "knocks":
        second[rng.integers(0, len(second), 12)] += 9.0
    return session, replace(model, fit=replace(model.fit, residual=(first, second))), [first, second]


@pytest.mark.slow
def test_white_and_normal_noise_is_refused_no_more_often_than_is_said() -> None:
    refused, rows = 0, clean_session().base_model.rows()
    for seed in range(150):
        session, model, residuals = noisy("white", seed)
        refused += sum(is_refused(own, e, session.bank) for own, e in zip(rows, residuals, strict=True))
    assert refused <= 3  # of 300 at one in a thousand; Jarque and Bera's is a little more in short series
    assert sandwich_factors(model, rows) == pytest.approx(np.ones(len(model.fit.theta)))


@pytest.mark.parametrize("kind", ["coloured", "knocks"])
def test_noise_that_is_not_as_whitened_is_refused_and_widens_its_own_joint(kind: str) -> None:
    session, model, (_, wrong) = noisy(kind, 5)
    rows = model.rows()
    assert is_refused(rows[1], wrong, session.bank)
    factors = sandwich_factors(model, rows)
    names = model.design.parameters.names
    own = [factors[n] for n, name in enumerate(names) if name.startswith("joint2.f_")]
    other = [factors[n] for n, name in enumerate(names) if name.startswith("joint1.f_")]
    assert max(own) > 1.2
    assert max(other) < min(1.1, max(own))
    # Parameters in other units are as uncertain.
    units = 10.0 ** np.random.default_rng(1).uniform(-6, 6, len(names))
    covariance = model.fit.covariance / np.outer(units, units)
    turned = replace(model, fit=replace(model.fit, covariance=covariance))
    scaled = [replace(one, A=one.A * units) for one in rows]
    assert sandwich_factors(turned, scaled) == pytest.approx(factors, rel=1e-6)
