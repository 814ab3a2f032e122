"""Rules of the loop: confirmation on another motion, laws against names, what a report may claim."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from synthetic_arm import RATE, exact_views, force, make_recordings, make_session, planar_machine, truth

from fitting.effects import effect
from fitting.effects.end_cushion import EndCushion
from fitting.loop.refits import SessionSignals, final_model
from fitting.loop.residual_loop import moves, other_bands, run_attribution
from fitting.loop.session import Options, Session
from fitting.residual.confirmation.confirmation import (
    OnValidate,
    on_validate,
    overall_change,
    validate_gain,
    worse_joint,
)
from fitting.residual.confirmation.cross_validation import HeldOut
from fitting.residual.findings import Accepted, Attribution
from fitting.residual.laws import Law
from fitting.residual.scoring import score_terms
from fitting.residual.stored_terms import term_from_json, term_to_json
from fitting.residual.terms import Model, Term, fit_model
from fitting.selection import confirm, priors
from fitting.selection.confirm import objection, silence
from fitting.selection.evidence import least_gain
from fitting.selection.search import Search
from fitting.signals.corrections import Corrections
from fitting.signals.filters import advanced

MACHINE, ARM = planar_machine(2), truth(2)
RECORDINGS = (("unloaded", 1), ("train", 2), ("train", 4), ("repeat", 2), ("validate", 3))


def session_with(law: object, **options: object) -> Session:
    """Recordings with ``law(motion, index)`` (N,) on top of joint 2's drive effort."""
    design, _ = exact_views(MACHINE, ARM, recordings=RECORDINGS)
    added = []
    for index, segment in enumerate(design.segments):
        extra = np.zeros_like(segment.q)
        extra[:, 1] = law(segment, index)  # type: ignore[operator]
        added.append(extra)
    return make_session(MACHINE, ARM, RECORDINGS, added=added, **options)


def run(session: Session) -> Attribution:
    return run_attribution(session, Corrections(session.machine))


def friction_by_place(segment: object, index: int) -> np.ndarray:
    """More friction the farther the piston is out."""
    return np.asarray(900.0 * (segment.x[:, 1] - 0.15) * np.sign(segment.v[:, 1]))  # type: ignore[attr-defined]


@pytest.fixture(scope="module")
def rubbing() -> tuple[Session, Attribution]:
    """An arm with an effect of the catalogue, and what is found in it."""
    session = session_with(friction_by_place)
    return session, run(session)


@pytest.fixture(scope="module")
def nothing_there() -> Attribution:
    """Nothing was put in."""
    return run(session_with(lambda s, i: np.zeros(len(s))))


@pytest.fixture(scope="module")
def strange() -> Attribution:
    """A lump of force at one place of the stroke, whichever way the piston goes: in no catalogue."""
    return run(session_with(lambda s, i: 60.0 * np.exp(-(((s.x[:, 1] - 0.13) / 0.012) ** 2))))


@pytest.mark.slow
def test_what_is_in_no_catalogue_becomes_a_law_of_its_variable(strange: Attribution) -> None:
    assert strange.verdict == "unexplained"
    laws = [a.score.term for a in strange.accepted if isinstance(a.score.term.content, Law)]
    assert laws and all(t.joint == 1 for t in laws)
    assert {t.content.variable(("joint1", "joint2")) for t in laws if isinstance(t.content, Law)} == {"piston_position"}


@pytest.mark.slow
def test_a_law_has_the_shape_of_what_was_put_in(strange: Attribution) -> None:
    model = strange.model
    number = next(n for n, t in enumerate(model.terms) if isinstance(t.content, Law))
    index = model.fitted[1]
    x = model.design.segments[index].x[:, 1]
    lump = 60.0 * np.exp(-(((x - 0.13) / 0.012) ** 2))
    given = model.contribution(number, 1, index)
    # Stiffness and gravity take a smooth part of it, and sixteen functions round its corners.
    assert np.corrcoef(lump, given)[0, 1] > 0.9


@pytest.mark.slow
def test_every_accepted_term_helps_where_nothing_was_fitted(strange: Attribution) -> None:
    assert all(a.validate_gain is not None and a.validate_gain > 0 for a in strange.accepted)
    assert all(a.score.gain > least_gain(a.score.live) for a in strange.accepted)


@pytest.mark.slow
def test_what_is_only_in_the_training_motions_is_refused() -> None:
    """The same friction with the opposite sign in `validate`: what training says is wrong there."""

    def law(segment: object, index: int) -> np.ndarray:
        offset = segment.x[:, 1] - 0.15  # type: ignore[attr-defined]
        sign = -1.0 if RECORDINGS[index][0] == "validate" else 1.0
        return sign * 900.0 * offset * np.sign(segment.v[:, 1])  # type: ignore[attr-defined]

    attribution = run(session_with(law))
    assert ("position_dependent_friction", 1) not in {a.score.term.family for a in attribution.accepted}
    line = next(c for c in attribution.candidates if (c.id, c.joint) == ("position_dependent_friction", 1))
    assert line.status == "rejected" and "validation motion" in line.reason


@pytest.mark.slow
def test_nothing_is_selected_on_the_validation_motion(nothing_there: Attribution) -> None:
    """An effect that only `validate` has is invisible to the loop: no candidate scores differently."""

    def law(segment: object, index: int) -> np.ndarray:
        return (RECORDINGS[index][0] == "validate") * 200.0 * np.sign(segment.v[:, 1])  # type: ignore[attr-defined]

    spoiled, clean = run(session_with(law)), nothing_there
    assert spoiled.verdict == clean.verdict == "nothing_missing"
    assert [c.score for c in spoiled.candidates] == [c.score for c in clean.candidates]


@pytest.mark.slow
def test_without_a_validation_motion_nothing_confirms_and_nothing_is_claimed_to() -> None:
    session = session_with(friction_by_place)
    model = session.base_model
    attribution = Search(model, (), SessionSignals(session, Corrections(session.machine))).run()
    assert [a.score.term.family for a in attribution.accepted] == [("position_dependent_friction", 1)]
    assert attribution.accepted[0].validate_gain is None


def two_effects(segment: object, index: int) -> np.ndarray:
    x, v = segment.x[:, 1], segment.v[:, 1]  # type: ignore[attr-defined]
    other = segment.v[:, 0]  # type: ignore[attr-defined]
    return 900.0 * (x - 0.15) * np.sign(v) + 500.0 * other


@pytest.mark.slow
def test_two_effects_are_both_found() -> None:
    attribution = run(session_with(two_effects))
    assert {a.score.term.family for a in attribution.accepted} == {
        ("position_dependent_friction", 1),
        ("cross_cylinder_coupling", 1),
    }
    assert (attribution.verdict, attribution.nothing_more) == ("effect_added", 1.0)


@pytest.mark.slow
@pytest.mark.parametrize(("most", "verdict"), [(1, "unexplained"), (2, "effect_added")])
def test_what_is_missing_beside_as_many_as_are_looked_for_is_said(
    most: int, verdict: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(priors, "MOST", most)
    attribution = run(session_with(two_effects))
    assert len(attribution.accepted) == most
    assert attribution.verdict == verdict
    assert (attribution.nothing_more < 0.01) if most == 1 else (attribution.nothing_more > 0.5)


@pytest.mark.slow
def test_what_depends_on_two_signals_at_once_is_a_law_of_both() -> None:
    """The loss of a gallery that two cylinders share; a neighbour's speed alone gains much of it."""

    def law(segment: object, index: int) -> np.ndarray:
        flow = segment.v[:, 1] + 0.8 * segment.v[:, 0]  # type: ignore[attr-defined]
        return 2e4 * flow * np.abs(flow)

    (found,) = run(session_with(law)).accepted
    assert isinstance(found.score.term.content, Law)
    assert {name for name, _ in found.score.term.content.signals} == {"piston_speed"}
    assert {other for _, other in found.score.term.content.signals} == {None, 0}


@pytest.mark.slow
def test_the_same_data_give_the_same_answer(strange: Attribution) -> None:
    again = run(session_with(lambda s, i: 60.0 * np.exp(-(((s.x[:, 1] - 0.13) / 0.012) ** 2))))
    assert again.candidates == strange.candidates
    assert np.array_equal(again.model.fit.theta, strange.model.fit.theta)


@pytest.mark.slow
def test_terms_survive_their_way_through_json(strange: Attribution) -> None:
    for term in (*strange.model.terms, Term(effect("sensor_latency"), 1, {}, (0.02,))):
        assert term_from_json(term_to_json(term)) == term


@pytest.mark.slow
def test_the_final_model_is_the_loops_model(rubbing: tuple[Session, Attribution]) -> None:
    session, attribution = rubbing
    model = final_model(session, Corrections(session.machine), attribution.model.terms)[1].model
    assert model.fit.theta == pytest.approx(attribution.model.fit.theta, rel=1e-6, abs=1e-6)


@pytest.mark.slow
def test_limits_are_given_for_what_was_not_found(nothing_there: Attribution) -> None:
    assert nothing_there.verdict == "nothing_missing"
    families = {s.term.family for s in nothing_there.limits}
    assert {("load_dependent_friction", 0), ("sensor_latency", 1), ("payload", None)} <= families


def test_validate_gain_is_the_fall_of_the_whitened_chi_square() -> None:
    session = session_with(friction_by_place)
    before = session.base_model
    term = Term(effect("position_dependent_friction"), 1)
    after = fit_model(before.design, before.noise, before.fitted, [term], session.prior, before)
    gain = validate_gain(before, after, session.plain.validate)
    assert gain > 100
    assert validate_gain(after, before, session.plain.validate) == pytest.approx(-gain)
    seen = on_validate(before, after, session.plain.validate)
    assert seen.gain == pytest.approx(gain)
    # The effect is right: it helps by what was to be expected of it.
    assert abs(seen.short) < 4 and seen.has_power and not seen.refutes
    # Its density knows the noise and the parameters, which cost a few units of chi-square beside a plug-in.
    assert 0.8 * gain < seen.predicted < gain + 5.0 and seen.entered


def test_no_joint_may_get_worse_on_the_validation_motion() -> None:
    """The law's own joint is spoiled by its wrong sign on `validate`; backwards it is an improvement."""

    def law(segment: object, index: int) -> np.ndarray:
        offset = segment.x[:, 1] - 0.15  # type: ignore[attr-defined]
        sign = -1.0 if RECORDINGS[index][0] == "validate" else 1.0
        return sign * 900.0 * offset * np.sign(segment.v[:, 1])  # type: ignore[attr-defined]

    session = session_with(law)
    base, validate = session.base_model, session.plain.validate
    term = Term(effect("position_dependent_friction"), 1)
    trial = fit_model(base.design, base.noise, base.fitted, [term], session.prior)
    found = worse_joint(base, trial, validate)
    assert found is not None and found[0] == 1 and found[1] > 0.01
    assert worse_joint(trial, base, validate) is None
    assert on_validate(base, trial, validate).refutes


HOLDS = HeldOut(gain=60.0, z=3.5, blocks=10, alike=20.0)


@pytest.mark.parametrize(
    ("held_out", "validate", "words"),
    [
        (HOLDS, None, ""),
        (HOLDS, OnValidate(gain=7.0, expected=10.0, spread=6.4, predicted=6.0), ""),
        # What a right effect could fail to show here is no objection, as long as the rows do not speak against it.
        (HOLDS, OnValidate(gain=-3.8, expected=10.0, spread=6.4, predicted=-3.0), ""),
        (HOLDS, OnValidate(gain=-9.0, expected=10.0, spread=6.4, predicted=-7.0), "does not help"),
        # Of what is handed out by what a right term does in one case of a hundred, unless a joint gets worse for it.
        (HOLDS, OnValidate(gain=-7.0, expected=16.0, spread=11.0, predicted=-4.0, rise=0.005), ""),
        (HOLDS, OnValidate(gain=-7.0, expected=16.0, spread=11.0, predicted=-4.0, rise=0.02), "does not help"),
        (HOLDS, OnValidate(gain=-7.0, expected=16.0, spread=9.0, predicted=-4.0, rise=0.005), "does not help"),
        # A right effect would have been confirmed here 99 times of 100.
        (HOLDS, OnValidate(gain=3.0, expected=60.0, spread=16.0, predicted=2.0), "does not help"),
        (HOLDS, OnValidate(gain=50.0, expected=60.0, spread=16.0, predicted=40.0), ""),
        # What is made of it here is as uncertain as it is wrong.
        (HOLDS, OnValidate(gain=-1e6, expected=1e6, spread=5e6, predicted=-20.0), "does not help"),
        (HOLDS, OnValidate(gain=-1e6, expected=1e6, spread=5e6, predicted=20.0), "does not help"),
        # One rule: neither a plain gain, nor a silent motion, nor one recording alone is an exception.
        (replace(HOLDS, gain=5.8), None, "left out of the fit"),
        (replace(HOLDS, gain=5.8), OnValidate(gain=50.0, expected=60.0, spread=16.0, predicted=40.0), "left out"),
        (replace(HOLDS, alike=5.0), None, "one alone shows it"),
        (replace(HOLDS, inflation=4.0), None, "4.0 times as noisy"),
        (replace(HOLDS, gain=5.9), None, ""),
    ],
)
def test_what_is_left_out_confirms_or_refuses_by_one_rule(
    held_out: HeldOut, validate: OnValidate | None, words: str
) -> None:
    said = objection(held_out, validate)
    assert words in said and bool(words) == bool(said)


def test_a_validation_motion_that_never_enters_the_range_says_that_it_confirms_nothing() -> None:
    """A cushion at the end of the stroke, where only the training motion goes; nothing of it is in `validate`."""
    session = session_with(lambda s, i: 9e4 * np.maximum(0.0, s.x[:, 1] - 0.17) * (RECORDINGS[i][0] != "validate"))
    base, validate = session.base_model, session.plain.validate
    outside = max(float(base.design.segments[i].x[:, 1].max()) for i in validate) + 1e-3
    low, high = EndCushion().references(base.views[0][1], {"side": 1.0, "share": 0.0})["x_c"][0], outside
    stroke = low - EndCushion().references(base.views[0][1], {"side": -1.0, "share": 0.0})["x_c"][0]
    term = Term(effect("end_cushion"), 1, {"side": 1.0, "share": (low - high) / stroke, "n": 1.0})
    trial = fit_model(base.design, base.noise, base.fitted, [term], session.prior)
    seen = on_validate(base, trial, validate)
    assert not seen.entered and "never enters its range" in silence(seen)
    shown = replace(seen, entered=True, predicted=50.0)
    assert silence(shown) == "" and silence(None) == ""


def test_shares_of_a_gain_are_what_each_joints_chi_square_falls_by_in_a_refit() -> None:
    session = session_with(lambda s, i: 15.0 * np.sin(s.q[:, 0]) * np.sin(s.q[:, 1]) / s.r[:, 1])
    plain, term = session.plain, Term(effect("base_tilt"), None)
    prior = replace(session.prior, arm=None, point=None)  # whose rows would be at another point in the refit
    base = fit_model(plain.design, plain.noise, plain.fitted, (), prior)
    (tilt,) = score_terms(base, [term], [1])
    with_it = fit_model(base.design, base.noise, base.fitted, [term], prior, start=base, passes=1)
    fall = [a @ a - b @ b for a, b in zip(base.fit.residual, with_it.fit.residual, strict=True)]
    assert tilt.free == tilt.values and sum(tilt.places) == pytest.approx(1.0)
    assert tilt.gain * np.array(tilt.places) == pytest.approx(np.array(fall), rel=1e-6)
    (own,) = score_terms(base, [Term(effect("position_dependent_friction"), 1)], [1])
    assert own.places == ()


@pytest.mark.slow
@pytest.mark.parametrize("spoilt", [True, False])
def test_a_choice_that_makes_a_joint_worse_waits_for_what_that_joint_lacks(
    monkeypatch: pytest.MonkeyPatch, spoilt: bool
) -> None:
    design, _ = exact_views(MACHINE, ARM, recordings=RECORDINGS)
    added = []
    for segment in design.segments:
        place = 900.0 * (segment.x - 0.15) * np.sign(segment.v)
        added.append(place * np.array([0.5, 1.0]))
    session = make_session(MACHINE, ARM, RECORDINGS, added=added)

    def worse(before: Model, after: Model, validate: object) -> tuple[int, float] | None:
        joints = {term.joint for term in after.terms}
        return (0, 0.05) if 1 in joints and (spoilt or 0 not in joints) else None

    monkeypatch.setattr(confirm, "worse_joint", worse)
    found = run(session)
    families = [item.score.term.family for item in found.accepted]
    first, second = ("position_dependent_friction", 0), ("position_dependent_friction", 1)
    if spoilt:
        line = next(c for c in found.candidates if (c.id, c.joint) == second)
        assert first in families and second not in families and "makes joint1 worse" in line.reason
    else:
        assert families == [first, second], "the larger one is tried first, and added second"


@pytest.mark.slow
def test_a_delay_is_named_with_all_that_moving_the_effort_gains() -> None:
    """Its column is short of friction's jumps, which presliding is made of."""

    def late(segment: object, index: int) -> np.ndarray:
        effort = force(MACHINE, ARM, segment)[:, 1]  # type: ignore[arg-type]
        return advanced(effort, -0.006 * RATE) - effort

    session = session_with(late)
    (column,) = score_terms(session.base_model, [Term(effect("sensor_latency"), 1)], [1])
    found = run(session).accepted
    assert [item.score.term.family for item in found] == [("sensor_latency", 1)]
    assert found[0].score.term.rebuilt[0] == pytest.approx(0.006, abs=0.0005)
    assert "presliding_hysteresis" not in [rival.term.id for rival in found[0].rivals]
    assert found[0].held_out.gain > 0.5 * column.gain


@pytest.mark.slow
def test_what_is_added_itself_is_no_other_name_for_what_was_added_before() -> None:
    session = session_with(
        lambda s, i: 900.0 * (s.x[:, 1] - 0.15) * np.sign(s.v[:, 1]) + 9000.0 * s.v[:, 1] * np.abs(s.v[:, 1])
    )
    first, second = Term(effect("quadratic_loss"), 1), Term(effect("position_dependent_friction"), 1)
    score, rival = score_terms(session.base_model, [first, second], [1, 1])
    plain = session.plain
    base = fit_model(plain.design, plain.noise, plain.fitted, [first], session.prior)
    signals = SessionSignals(session, Corrections(session.machine))
    known = Accepted(score, (rival,), HOLDS, 1.0)
    found = Search(base, plain.validate, signals, known=[known]).run()
    assert [(item.score.term.family, item.rivals) for item in found.accepted] == [
        (first.family, ()),
        (second.family, ()),
    ]


def test_overall_change_is_the_ratio_of_root_mean_squares_with_a_block_interval() -> None:
    rng = np.random.default_rng(1)
    before = [3.0 * rng.normal(size=600), 2.0 * rng.normal(size=600)]
    after = [1.0 * rng.normal(size=600), 2.0 * rng.normal(size=600)]
    floor = np.array([1.0, 2.0])
    change = overall_change(before, after, floor, 10.0, np.random.default_rng(2))
    first = np.sqrt(np.mean([np.var(b) / f**2 for b, f in zip(before, floor, strict=True)]))
    second = np.sqrt(np.mean([np.var(a) / f**2 for a, f in zip(after, floor, strict=True)]))
    assert change["before"] == pytest.approx(first) and change["after"] == pytest.approx(second)
    assert change["change_percent"] == pytest.approx(100 * (second / first - 1))
    low, high = change["ci95_percent"]
    assert low < change["change_percent"] < high < 0
    again = overall_change(before, after, floor, 10.0, np.random.default_rng(2))
    assert again == change


def test_no_change_is_an_interval_around_zero() -> None:
    rng = np.random.default_rng(3)
    series = [rng.normal(size=500)]
    change = overall_change(series, series, np.array([1.0]), 10.0, np.random.default_rng(4))
    assert change["change_percent"] == 0.0 and change["ci95_percent"] == [0.0, 0.0]
    nothing = overall_change([np.zeros(0)], [np.zeros(0)], np.array([1.0]), 10.0, np.random.default_rng(4))
    assert nothing["change_percent"] is None and nothing["ci95_percent"] is None


@pytest.mark.slow
def test_a_law_that_another_motion_contradicts_is_told_but_not_added() -> None:
    """A force of the position with another sign in `validate`: structure is certain, its law is not."""

    def law(segment: object, index: int) -> np.ndarray:
        lump = 60.0 * np.exp(-(((segment.x[:, 1] - 0.13) / 0.012) ** 2))  # type: ignore[attr-defined]
        return (-1.0 if RECORDINGS[index][0] == "validate" else 1.0) * lump

    attribution = run(session_with(law))
    assert attribution.verdict == "unexplained"
    assert not [a for a in attribution.accepted if isinstance(a.score.term.content, Law)]
    (question,) = attribution.unconfirmed
    assert question.score.term.joint == 1
    assert question.validate_gain < 0


@pytest.mark.slow
def test_a_name_that_nearly_fits_is_no_name_where_a_law_of_its_variable_fits_better() -> None:
    """A cable that is caught half way: a gas spring takes all but a twentieth of it, far more than noise leaves."""
    attribution = run(session_with(lambda s, i: 12.0 * np.logaddexp(0.0, (s.x[:, 1] - 0.14) / 0.01)))
    assert attribution.verdict == "unexplained"
    (law,) = (a.score.term for a in attribution.accepted)
    assert isinstance(law.content, Law) and law.joint == 1
    assert law.content.variable(("joint1", "joint2")) == "piston_position"
    line = next(c for c in attribution.candidates if (c.id, c.joint) == ("gas_spring", 1))
    assert line.status == "rejected"


@pytest.mark.slow
def test_a_ripple_above_the_band_is_named_and_nothing_is_added() -> None:
    attribution = run(session_with(lambda s, i: 15.0 * np.sin(2 * np.pi * 7.3 * s.t + i)))
    assert attribution.verdict == "effect_added"
    assert not attribution.accepted
    (line,) = attribution.lines
    assert line.joint == 1
    assert line.frequency_hz == pytest.approx(7.3, abs=3 * line.frequency_std + 1e-3)
    assert line.amplitude == pytest.approx(15.0, rel=0.1)


@pytest.mark.slow
def test_an_accepted_effect_holds_at_every_cut_off_and_for_both_witnesses(
    rubbing: tuple[Session, Attribution],
) -> None:
    (accepted,) = rubbing[1].accepted
    assert len(accepted.cutoffs) == 3
    first = accepted.cutoffs[0][1]
    assert all(0.5 < value / first < 2.0 for _, value, _ in accepted.cutoffs)
    assert "unloaded" in accepted.witness


def test_a_coefficient_that_moves_with_the_filter_is_an_artefact() -> None:
    assert not moves([(3.0, 10.0, 1.0), (2.1, 11.0, 1.0), (3.9, 8.0, 1.0)])
    assert not moves([(3.0, 1.0, 1.0), (2.1, -2.0, 1.0)])  # within its own uncertainty
    assert moves([(3.0, 10.0, 0.1), (2.1, -2.0, 0.1)])
    assert moves([(3.0, 10.0, 0.1), (3.9, 200.0, 0.1)])


@pytest.mark.slow
def test_cut_offs_are_those_that_every_recording_is_long_enough_for() -> None:
    """A narrower filter needs a longer stretch: of two seconds it leaves nothing, and they are not refused for that."""
    recordings = make_recordings(MACHINE, ARM, RECORDINGS)
    recordings[2] = recordings[2].cut(slice(0, round(2 * RATE)))
    session = Session(MACHINE, recordings, Options(bootstrap=0, bandwidth_hz=6.0))
    bands = other_bands(session, Corrections(MACHINE))
    assert [hz for hz, _ in bands] == [pytest.approx(1.3 * 6.0)]
