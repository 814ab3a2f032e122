"""Laws of two signals: friction by the product of two poses, and what a law of one says stays as it is."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from synthetic_arm import exact_views, make_session, planar_machine, truth

from fitting.loop.residual_loop import run_attribution
from fitting.loop.session import Session
from fitting.report.drawing_data import spline_curve
from fitting.report.wording import verdict_sentence
from fitting.residual.findings import Attribution
from fitting.residual.laws import Law
from fitting.residual.scoring import score_terms
from fitting.residual.stored_terms import term_from_json, term_to_json
from fitting.residual.surfaces import Surface, best_surface, second_variable, surfaces
from fitting.residual.terms import Term
from fitting.selection.evidence import least_gain
from fitting.selection.rated_laws import resolved
from fitting.signals.corrections import Corrections

MACHINE, ARM = planar_machine(3), truth(3)
TWIST, MIDDLE = 400.0, 0.0  # N/rad^2, rad
RECORDINGS = (("unloaded", 1), ("train", 2), ("train", 4), ("repeat", 2), ("validate", 3))


def session_with(force: object, unloaded: bool = False) -> Session:
    """Recordings with ``force(segment)`` (N,) on top of joint 1's drive effort, where the arm is loaded or always."""
    design, _ = exact_views(MACHINE, ARM, recordings=RECORDINGS)
    added = []
    for segment in design.segments:
        extra = np.zeros_like(segment.q)
        if segment.loaded or unloaded:
            extra[:, 0] = force(segment)  # type: ignore[operator]
        added.append(extra)
    return make_session(MACHINE, ARM, RECORDINGS, added=added)


def product(segment: object) -> np.ndarray:
    """Friction by the product of both neighbours' poses, from their middles; N."""
    q, v = segment.q, segment.v  # type: ignore[attr-defined]
    return np.asarray(TWIST * (q[:, 1] - MIDDLE) * (q[:, 2] - MIDDLE) * np.sign(v[:, 0]))


@cache
def twisted() -> Session:
    """Recordings with the product, shared by tests that only read them."""
    return session_with(product)


@pytest.fixture(scope="module")
def found() -> Attribution:
    """What the loop says of the product."""
    session = twisted()
    return run_attribution(session, Corrections(session.machine))


@pytest.mark.slow
def test_a_product_is_a_law_of_both_signals(found: Attribution) -> None:
    (item,) = found.accepted
    law = item.score.term.content
    assert isinstance(law, Surface)
    assert item.score.term.joint == 0
    assert set(law.signals) == {("joint_position", 1), ("joint_position", 2)}
    assert law.signed
    assert found.verdict == "unexplained"


@pytest.mark.slow
def test_what_it_says_is_the_product(found: Attribution) -> None:
    (item,) = found.accepted
    law = item.score.term.content
    assert isinstance(law, Surface)
    part = found.model.term_slice(0)
    curve = spline_curve(law, found.model.fit.theta[part], found.model.fit.covariance[part, part])
    rows = np.array(curve["second"]["value"])
    # Of a product the twist is all there is: opposite corners alike, neighbours of opposite sign (Coulomb aside).
    twist = rows[0, 0] + rows[-1, -1] - rows[0, -1] - rows[-1, 0]
    area = (law.knots[-1] - law.knots[0]) * (law.second_range[1] - law.second_range[0])
    assert twist == pytest.approx(TWIST * area, rel=0.15)
    assert curve["second"]["at"] in (curve["second"]["grid"][0], curve["second"]["grid"][-1])


@pytest.mark.slow
def test_a_small_product_is_found_by_one_function_where_nine_parameters_cost_more_than_they_gain() -> None:
    session = session_with(lambda segment: 0.09 * product(segment))
    nine = best_surface(session.base_model, 0, ("joint_position", 1))
    assert nine is not None and nine.gain < least_gain(9, nine.grid)
    found = run_attribution(session, Corrections(session.machine))
    (item,) = found.accepted
    law = item.score.term.content
    assert isinstance(law, Surface) and law.twist and law.signed
    assert set(law.signals) == {("joint_position", 1), ("joint_position", 2)}
    part = found.model.term_slice(0)
    area = (law.knots[-1] - law.knots[0]) * (law.second_range[1] - law.second_range[0])
    value, std = float(found.model.fit.theta[part][0]), float(found.model.fit.std[part][0])
    assert value == pytest.approx(0.09 * TWIST * area, abs=3 * std)
    curve = spline_curve(law, found.model.fit.theta[part], found.model.fit.covariance[part, part])
    rows = np.array(curve["second"]["value"])
    assert rows[0] == pytest.approx(-rows[-1]) and np.abs(rows[3]).max() < 1e-9, "nothing in the middle"


@pytest.mark.slow
def test_no_product_is_found_where_nothing_was_put_in() -> None:
    session = session_with(lambda segment: np.zeros(len(segment.q)))
    terms = [Term(law, joint) for joint in range(3) for law in surfaces(session.base_model, joint, twist=True)]
    scores = score_terms(session.base_model, terms, [1] * len(terms))
    assert max(s.gain for s in scores) < least_gain(1, len(terms))


@pytest.mark.slow
def test_a_law_of_one_signal_stays_one() -> None:
    session = session_with(lambda s: 60.0 * np.exp(-(((s.x[:, 0] - 0.13) / 0.02) ** 2)))
    (item,) = run_attribution(session, Corrections(session.machine)).accepted
    law = item.score.term.content
    assert isinstance(law, Law)
    assert not isinstance(law, Surface)
    assert law.signal == "piston_position"


@pytest.mark.parametrize("degree", [2, 3, 5])
def test_its_functions_are_a_partition_of_one_and_exact_for_products(degree: int) -> None:
    law = Surface("joint_position", 1, True, True, (-1.0, 2.0), "", "joint_position", 2, (0.0, 4.0), degree=degree)
    rng = np.random.default_rng(0)
    u, w = rng.uniform(-1, 2, 200), rng.uniform(0, 4, 200)
    basis = law.basis(u, w)
    assert basis.shape == (200, law.functions)
    assert basis.sum(axis=1) == pytest.approx(1.0)
    fitted = basis @ np.linalg.lstsq(basis, (u - 0.3) * (w + 1.7), rcond=None)[0]
    assert fitted == pytest.approx((u - 0.3) * (w + 1.7))
    outside = law.basis(np.array([-5.0, 9.0]), np.array([-5.0, 9.0]))
    assert outside == pytest.approx(law.basis(np.array([-1.0, 2.0]), np.array([0.0, 4.0])))


def test_it_is_stored_and_read_back() -> None:
    law = Surface("piston_speed", None, False, True, (-0.1, 0.1), "", "joint_position", 2, (0.0, 4.0))
    term = Term(law, 1)
    assert term_from_json(term_to_json(term)) == term
    twist = Term(replace(law, twist=True), 1)
    stored = term_to_json(twist)
    assert term_from_json(stored) == twist
    del stored["law"]["twist"]
    assert term_from_json(stored) == term, "results from before there were twists"
    one = Term(Law("piston_speed", None, False, False, (0.0,) * 4 + (1.0,) * 4), 1)
    assert term_from_json(term_to_json(one)) == one
    valve = replace(one, content=replace(one.content, only="negative"))
    assert term_from_json(term_to_json(valve)) == valve


@pytest.mark.slow
def test_oil_and_hoses_of_neighbours_act_with_the_arm_off_and_their_poses_do_not() -> None:
    laws = list(surfaces(twisted().base_model, 0))
    through = {law.loaded_only: set[str]() for law in laws}
    for law in laws:
        through[law.loaded_only] |= {f"{name}{'' if other is None else ' of another'}" for name, other in law.signals}
    assert "piston_speed of another" in through[False] and "joint_position of another" not in through[False]


@pytest.mark.slow
def test_a_bend_along_a_sum_of_signals_takes_a_higher_degree() -> None:
    """The loss of a gallery that two cylinders share, ``s |s|`` of both flows."""

    def loss(segment: object) -> np.ndarray:
        flow = segment.v[:, 0] + 0.8 * segment.v[:, 1]  # type: ignore[attr-defined]
        return np.asarray(2e4 * flow * np.abs(flow))

    model = session_with(loss, unloaded=True).base_model
    quadratic = best_surface(model, 0, ("piston_speed", 1))
    assert quadratic is not None
    found = resolved(model, quadratic)
    assert isinstance(found.term.content, Surface) and found.term.content.degree > 2
    assert found.term.content.signals == (("piston_speed", 1), ("piston_speed", None))
    assert found.gain - quadratic.gain > least_gain(found.live) and found.grid == quadratic.grid


@pytest.mark.slow
def test_all_pairs_are_asked_once_and_the_better_known_signal_comes_first() -> None:
    session = twisted()
    laws = list(surfaces(session.base_model, 0))
    names = [(law.signals, law.signed) for law in laws]
    assert len(set(names)) == len(names)
    assert {frozenset(pair) for pair, _ in names} == {frozenset(pair) for pair, signed in names if signed}
    for first in (("joint_position", 1), ("joint_position", 2)):
        best = best_surface(session.base_model, 0, first)
        assert best is not None
        assert isinstance(best.term.content, Surface)
        assert best.term.content.signals[0] == first


def test_the_report_names_both_signals_of_a_surface() -> None:
    joints = ("joint1", "joint2", "joint3")
    law = Surface("joint_position", 1, True, True, (-1.0, 2.0), "", "joint_position", 2, (0.0, 4.0))
    assert second_variable(law, joints) == {"second_variable": "joint3.joint_position"}
    assert second_variable(replace(law).along, joints) == {}
    entry = {"joint": "joint1", "variable": law.variable(joints), **second_variable(law, joints)}
    report = {"loop": {"verdict": "unexplained", "unexplained": [entry]}, "errors": {}, "overall": {}}
    sentence = verdict_sentence(report, {})
    assert "joint2" in sentence
    assert "together with the" in sentence
    assert "joint3" in sentence
