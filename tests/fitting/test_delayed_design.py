"""Efforts moved in time within a design that is there already, beside the design made anew with them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from synthetic_arm import make_recordings, planar_machine, truth

from fitting.effects import effect, effects
from fitting.loop.refits import SessionSignals
from fitting.loop.session import Options, Session
from fitting.regression.design import Design
from fitting.regression.noise import noise_model
from fitting.residual.confirmation.confirmation import OnValidate, validate_gain
from fitting.residual.scoring import Candidates, catalogue_terms, law_terms
from fitting.residual.terms import Model, Term, fit_model
from fitting.selection.confirm import Gate
from fitting.signals.corrections import Corrections

LATENCY = Term(effect("sensor_latency"), 1)
ROLES = (("unloaded", 1), ("train", 2), ("repeat", 2), ("validate", 3))


def session(effort: str = "pressures") -> Session:
    """Two joints; `train` has a gap, so a segment does not begin where its recording does."""
    machine = planar_machine(2, effort=effort)
    recordings = make_recordings(machine, truth(2), ROLES)
    values = {name: value.copy() for name, value in recordings[1].values.items()}
    values["joint1.q"][700:710] = np.nan
    recordings[1] = replace(recordings[1], values=values)
    return Session(machine, recordings, Options(bandwidth_hz=3.0))


def same(one: Design, other: Design) -> None:
    for first, second in zip(one.segments, other.segments, strict=True):
        assert first.late == second.late and first.start == second.start
        for name in ("q", "qdd", "v", "effort", "p1", "p2", "rest", "lead"):
            assert np.array_equal(getattr(first, name), getattr(second, name), equal_nan=True), name
    for mine, theirs in zip(one.blocks, other.blocks, strict=True):
        for a, b in zip(mine, theirs, strict=True):
            for name in ("target", "columns", "known", "reduced_target", "reduced", "keep"):
                assert np.allclose(getattr(a, name), getattr(b, name), rtol=1e-12, atol=0), name


@pytest.mark.slow
@pytest.mark.parametrize("effort", ["pressures", "cylinder_force"])
@pytest.mark.parametrize(
    ("late", "resampled"),
    [({"joint2": 0.013}, ()), ({"joint2": 0.013}, ("joint2",)), ({"joint1": -0.004, "joint2": 0.03}, ("joint1",))],
)
def test_a_moved_effort_gives_the_design_that_is_made_with_it(
    effort: str, late: dict[str, float], resampled: tuple[str, ...]
) -> None:
    made = session(effort)
    assert len(made.plain.design.segments) == 5
    delayed = made.delayed(made.plain, late, resampled)
    whole = made.prepared(Corrections(made.machine), late, resampled)
    assert delayed.design.noise == whole.design.noise
    same(delayed.design, whole.design)
    assert delayed.pairs == whole.pairs and delayed.fitted == whole.fitted
    for mine, theirs in zip(delayed.noise.whitenings, whole.noise.whitenings, strict=True):
        assert mine.std == pytest.approx(theirs.std, rel=0.01)


def test_no_delay_gives_the_effort_that_was_there() -> None:
    made = session()
    plain = made.plain.design.segments
    again = made.delayed(made.plain, {"joint1": 0.0, "joint2": 0.0}).design.segments
    assert any(segment.start > made.bank.margin for segment in plain), "one begins after a gap"
    for first, second in zip(plain, again, strict=True):
        for name in ("effort", "p1", "p2"):
            assert np.array_equal(getattr(first, name), getattr(second, name)), name


def test_what_did_not_move_is_shared() -> None:
    made = session()
    delayed = made.delayed(made.plain, {"joint2": 0.013})
    plain = made.plain
    assert delayed.design.blocks[0] is plain.design.blocks[0] and delayed.design.blocks[1] is not plain.design.blocks[1]
    assert delayed.design.noise == plain.design.noise, "a delay is not taken for an unsure speed"
    assert delayed.design.noise[1] == made.position_noise[1], "nor is there any other where it is"
    assert delayed.noise.whitenings[0] is plain.noise.whitenings[0]
    assert delayed.noise.whitenings[1] is not plain.noise.whitenings[1]
    again = noise_model(delayed.design, plain.fitted, plain.pairs, start=plain.noise, anew=(1,))
    assert again.whitenings[1].std == pytest.approx(delayed.noise.whitenings[1].std)


@pytest.mark.slow
def test_columns_follow_a_moved_effort() -> None:
    """Of the joint that moved they are those made anew; others keep theirs, the model's own force apart."""
    made = session()
    delayed = made.delayed(made.plain, {"joint2": 0.013})
    before = made.base_model
    after = fit_model(delayed.design, delayed.noise, delayed.fitted, (), made.prior)
    terms = [*catalogue_terms(before, effects())[0], *law_terms(before)[0]]
    kept, anew = (Candidates(model, terms, [1] * len(terms)) for model in (before, after))
    kept.follow(before, after)
    followed, fresh_scores = kept.scores(after), anew.scores(after)
    compared = 0
    for number, score in fresh_scores.items():
        if terms[number].joint == 1 or terms[number].everywhere or not terms[number].uses_model:
            assert followed[number].gain == pytest.approx(score.gain, rel=1e-6, abs=1e-6), terms[number].label
            compared += 1
    assert compared > 50


def chi_square(signals: SessionSignals, late: float) -> float:
    """Of the base model on signals whose second effort is moved by ``late``, s."""
    moved = signals.prepared([replace(LATENCY, rebuilt=(late,))])
    return fit_model(moved.design, moved.noise, moved.fitted, (), signals.prior).fit.chi_square


@pytest.fixture(scope="module")
def arms() -> tuple[SessionSignals, SessionSignals, float]:
    """Recordings in time, the same with the second effort late by one sample, and how long a sample is, s."""
    machine = planar_machine(2)
    recordings = make_recordings(machine, truth(2), ROLES)
    in_time = SessionSignals(Session(machine, recordings, Options(bandwidth_hz=3.0)), Corrections(machine))
    late = []
    for recording in recordings:
        values = dict(recording.values)
        for name in ("joint2.head", "joint2.rod"):
            values[name] = np.concatenate([values[name][:1], values[name][:-1]])
        late.append(replace(recording, values=values))
    behind = SessionSignals(Session(machine, late, Options(bandwidth_hz=3.0)), Corrections(machine))
    return in_time, behind, 1.0 / machine.rate_hz


def mirrored_gain(signals: SessionSignals, model: Model, late: float) -> float:
    """A quarter of what efforts moved the other way lose to those moved right: chi-square is a parabola of delay."""
    other_way, moved = signals.mirrored(model, signals.refit([replace(LATENCY, rebuilt=(late,))]))
    return (other_way.fit.chi_square - moved.fit.chi_square) / 4.0


@pytest.mark.slow
def test_a_delay_gains_what_it_explains_and_not_what_smoothing_does(
    arms: tuple[SessionSignals, SessionSignals, float],
) -> None:
    """Late by one sample nothing is interpolated: that gain is the truth. What is in time gains nothing."""
    in_time, behind, sample = arms
    model = behind.refit(())
    true = model.fit.chi_square - chi_square(behind, sample)
    gain = mirrored_gain(behind, model, sample)
    assert true > 100 and gain == pytest.approx(true, rel=0.1)
    model = in_time.refit(())
    lost = chi_square(in_time, 0.5 * sample) - model.fit.chi_square
    gain = mirrored_gain(in_time, model, 0.5 * sample)
    assert abs(gain) < 0.1 * max(abs(lost), 100.0)


@pytest.mark.slow
def test_a_delay_is_judged_on_the_validation_motion_without_what_smoothing_does_to_its_noise(
    arms: tuple[SessionSignals, SessionSignals, float],
) -> None:
    in_time, behind, sample = arms

    def seen(signals: SessionSignals, late: float) -> tuple[Model, Model, OnValidate]:
        model, trial = signals.refit(()), signals.refit([replace(LATENCY, rebuilt=(late,))])
        _, found = Gate(signals, signals.prepared(()).validate).judged(model, trial)
        assert found is not None
        return model, trial, found

    model, trial, found = seen(behind, sample)
    validate = behind.prepared(()).validate
    true = validate_gain(replace(model, noise=trial.noise), trial, validate)
    assert true > 50
    assert found.gain == pytest.approx(true, rel=0.2)
    assert abs(found.short) < 3.0
    assert found.has_power
    # Half a sample too early or too late costs the same: nothing speaks for either.
    _, _, nothing = seen(in_time, 0.5 * sample)
    assert abs(nothing.gain) < 0.1 * true
