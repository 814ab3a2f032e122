"""The loop on long recordings: which pieces it searches, and that what it finds is fitted to everything."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from synthetic_arm import Noise, exact_design, force, make_motion, planar_machine, sample, truth

import fitting.loop.session
import fitting.signals.preparation
from daq.recordings.recording import Recording
from daq.scratch import Scratch
from fitting.arm.dynamics import rigid_body_regressor
from fitting.effects import effect
from fitting.loop.everything import held_against_everything, renumbered, search_note, with_best_shapes
from fitting.loop.refits import SessionSignals
from fitting.loop.residual_loop import attributed, run_attribution
from fitting.loop.search_pieces import _level, choose_pieces, thinned
from fitting.loop.session import Options, Search, Session
from fitting.regression.design import Design, build_design, white_noise_model
from fitting.regression.prior import mass_prior
from fitting.regression.stored import storing
from fitting.residual.confirmation.cross_validation import HeldOut
from fitting.residual.findings import Accepted, Attribution
from fitting.residual.scoring import score_terms
from fitting.residual.terms import Model, Term, extra_columns, fit_model
from fitting.residual.views import SegmentViews
from fitting.signals.corrections import Corrections
from fitting.signals.filters import filter_bank
from fitting.signals.preparation import segments_of

MACHINE, ARM = planar_machine(2), truth(2)
BANK = filter_bank(50.0, 3.0)
FITTED = (0, 1, 2)


def recording(role: str, motion: int, seconds: float, number: int = 0, added: float = 0.0) -> Recording:
    """A recording; ``added`` is friction that grows with the piston's position, N/m, on joint 2."""
    moved = make_motion(MACHINE, role, motion, seconds)
    effort = force(MACHINE, ARM, moved)
    effort[:, 1] += added * (moved.x[:, 1] - 0.15) * np.sign(moved.v[:, 1])
    return sample(MACHINE, moved, effort, role, 3, Noise(), number=number)


@pytest.fixture(scope="module")
def hour() -> list[Recording]:
    """Ten minutes of training stand for hours; the rest is short, but for a repetition."""
    roles = (("unloaded", 1, 40.0), ("train", 2, 600.0), ("repeat", 2, 300.0), ("validate", 3, 60.0))
    return [recording(role, motion, seconds, n) for n, (role, motion, seconds) in enumerate(roles)]


@given(st.lists(st.integers(1, 5000), min_size=1, max_size=9), st.integers(10, 20_000))
def test_short_recordings_leave_their_share_to_long_ones(lengths: list[int], budget: int) -> None:
    level = _level(lengths, budget)
    taken = sum(min(length, level) for length in lengths)
    assert taken <= budget + 1e-6
    if sum(lengths) > budget:
        assert taken == pytest.approx(budget)
    else:
        assert level >= max(lengths)


def test_pieces_keep_within_the_budget_and_every_role(hour: list[Recording]) -> None:
    for budget in (14_000, 20_000, 30_000):
        chosen = choose_pieces(MACHINE, hour, BANK, budget)
        assert [own.number for own in chosen] == [0, 1, 2, 3]
        assert sum(own.rows for own in chosen) <= budget
        assert sum(own.rows for own in chosen) > 0.7 * budget
        unloaded, train, repeat, validate = (own.pieces for own in chosen)
        assert unloaded == (slice(0, 2000),) and validate == (slice(0, 3000),)
        # From its beginning to its end, whole filters long, each sample once.
        assert train[0].start == 0 and train[-1].stop == 30_000
        assert all(first.stop < second.start for first, second in itertools.pairwise(train))
        assert all(piece.stop - piece.start >= 20 * (BANK.margin + BANK.half) for piece in train)
        # The repetition, half as long, is looked at where the training motion is.
        assert repeat and all(any(p.start <= r.start and r.stop <= p.stop for p in train) for r in repeat)


def test_recordings_that_fit_are_taken_whole(hour: list[Recording]) -> None:
    for own in choose_pieces(MACHINE, hour, BANK, 60_000):
        assert own.pieces == (slice(0, len(hour[own.number])),)


def test_very_many_recordings_are_thinned_out_by_role() -> None:
    many = [recording(role, 2, 40.0, n) for n, role in enumerate(["unloaded", *["train"] * 12, "validate"])]
    chosen = choose_pieces(MACHINE, many, BANK, 5 * 5040)
    roles = [many[own.number].role for own in chosen]
    assert set(roles) == {"unloaded", "train", "validate"} and len(roles) < 14
    assert [own.number for own in chosen] == sorted(own.number for own in chosen)


def test_a_recording_more_than_fits_leaves_out_no_more_than_one_and_not_itself() -> None:
    roles = ["unloaded", "train", "train", "repeat", "validate"]
    usual = [recording(role, 2, 60.0, n) for n, role in enumerate(roles)]
    for more in ("train", "unloaded"):
        for seconds in (60.0, 60.04):
            chosen = choose_pieces(MACHINE, [*usual, recording(more, 3, seconds, 5)], BANK, 5 * 3000)
            assert len(chosen) == 5 and 5 in [own.number for own in chosen]
            assert all(own.pieces == (slice(0, own.rows),) and own.rows >= 3000 for own in chosen)


def test_a_pose_that_is_seen_once_is_among_the_pieces(hour: list[Recording]) -> None:
    train = hour[1]
    values = {name: value.copy() for name, value in train.values.items()}
    there = slice(17_000, 17_400)  # eight seconds of ten minutes, in none of the evenly spread pieces
    names = [c.name for c in MACHINE.channels if c.joint == "joint1" and "position" in c.quantity]
    for name in names:
        span = float(np.ptp(values[name]))
        values[name][there] = values[name].max() + 0.5 * span * np.hanning(400)
    rare = replace(train, values=values)

    def sees(which: Recording) -> bool:
        chosen = choose_pieces(MACHINE, [which, hour[3]], BANK, 14_000)[0]
        return any(piece.start <= there.start and there.stop <= piece.stop for piece in chosen.pieces)

    assert sees(rare) and not sees(train)


def test_pieces_of_a_recording_keep_its_clock(hour: list[Recording]) -> None:
    chosen = choose_pieces(MACHINE, hour, BANK, 20_000)
    cut = [thinned(hour[own.number], own.pieces) for own in chosen]
    whole = [s for s in segments_of(MACHINE, hour, BANK) if s.recording == 1]
    parts = [s for s in segments_of(MACHINE, cut, BANK) if s.recording == 1]
    assert len(whole) == 1 and len(parts) == len(chosen[1].pieces) > 1
    assert parts[0].t[0] == whole[0].t[0] and parts[-1].t[-1] == whole[0].t[-1]
    for part in parts:
        rows = slice(round((part.t[0] - whole[0].t[0]) * 50), None)
        assert np.array_equal(part.t, whole[0].t[rows][: len(part)])
        assert np.array_equal(part.effort, whole[0].effort[rows][: len(part)])
        # Sensors are weighed by their noise in what is there: a jump over a gap must not count as noise.
        assert np.allclose(part.qdd, whole[0].qdd[rows][: len(part)], atol=2e-3 * np.abs(part.qdd).max())


TERMS = (
    Term(effect("position_dependent_friction"), 1),
    Term(effect("pressure_dependent_friction"), 0, {"head": 1.0, "rod": 1.0}),
    Term(effect("payload"), None, {"recording": -1.0, "t_0": 20.0}),
    Term(effect("thermal_viscosity_drift"), 0, {"tau": 30.0}),
)


@pytest.fixture(scope="module")
def both() -> tuple[Design, Design]:
    dense = exact_design(MACHINE, ARM, (("unloaded", 1), ("train", 2), ("train", 4), ("validate", 3)))
    store = storing(dense.bank, Scratch())
    args = dense.machine, dense.parameters.base, dense.bank, dense.noise, dense.segments
    return dense, build_design(*args, store)


def test_views_from_the_file_are_those_in_memory(both: tuple[Design, Design]) -> None:
    dense, stored = both
    theta = 1.05 * ARM.theta(MACHINE)
    first, second = SegmentViews(dense, theta, FITTED), SegmentViews(stored, theta, FITTED)
    assert len(second) == len(first) == 4 and len(list(second)) == 4 and len(second[1:3]) == 2
    for one, other in zip(first, second, strict=True):
        for own, same in zip(one, other, strict=True):
            assert np.allclose(own.forces, same.forces, rtol=1e-12) and np.allclose(own.loads, same.loads, rtol=1e-12)
            assert own.ranges == pytest.approx(same.ranges) and own.loaded_recordings == same.loaded_recordings
            assert np.array_equal(own.clock, same.clock)
            assert np.allclose(own.p2, same.p2, rtol=1e-6)
    columns = [extra_columns(d, v, TERMS).columns for d, v in ((dense, first), (stored, second))]
    assert len(columns[1][0]) == 4 and len(columns[1][0][1:3]) == 2
    for joint in range(2):
        for index in range(4):
            own_columns, same_columns = columns[0][joint][index], columns[1][joint][index]
            assert own_columns is not None and same_columns is not None
            assert np.allclose(own_columns, same_columns, rtol=1e-6, atol=1e-9 * np.abs(own_columns).max())


def test_effects_are_fitted_from_the_file_as_in_memory(both: tuple[Design, Design]) -> None:
    noise, prior = white_noise_model(2), mass_prior(MACHINE)
    first, second = (fit_model(d, noise, FITTED, TERMS, prior) for d in both)
    assert np.allclose(first.fit.theta, second.fit.theta, rtol=1e-5, atol=1e-6 * np.abs(first.fit.theta).max())
    assert np.allclose(first.fit.std, second.fit.std, rtol=1e-5)
    assert np.allclose(first.contribution(0, 1, 1), second.contribution(0, 1, 1), rtol=1e-5)


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Budgets at which minutes are long."""
    monkeypatch.setattr(fitting.loop.session, "LOOP_SAMPLES", 2 * 16_000)
    monkeypatch.setattr(fitting.loop.session, "SEARCH_SAMPLES", 2 * 16_000)
    monkeypatch.setattr(fitting.signals.preparation, "PIECE_SAMPLES", 2 * 4000)


def test_a_motion_more_has_no_less_searched(hour: list[Recording], monkeypatch: pytest.MonkeyPatch) -> None:
    short = [hour[0], hour[3], replace(hour[3], role="train")]
    rows = sum(len(own) for own in short)
    monkeypatch.setattr(fitting.loop.session, "LOOP_SAMPLES", rows * 2)
    monkeypatch.setattr(fitting.loop.session, "SEARCH_SAMPLES", rows)
    before, after = Session(MACHINE, short), Session(MACHINE, [*short, replace(hour[3], role="repeat")])
    assert not before.long and after.long
    assert after.search.seconds >= 0.9 * before.search.seconds


def test_what_fits_is_searched_as_it_is(hour: list[Recording]) -> None:
    short = Session(MACHINE, [hour[0], hour[3], replace(hour[3], role="train")])
    assert not short.long and short.search.session is short and short.search.whole


@pytest.mark.slow
def test_pieces_are_searched_in_memory_however_long_the_filters_make_them(
    hour: list[Recording], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fitting.loop.session, "LOOP_SAMPLES", 2000)
    monkeypatch.setattr(fitting.loop.session, "SEARCH_SAMPLES", 1000)
    session = Session(MACHINE, hour)
    search = session.search
    assert session.long
    assert sum(map(len, search.session.recordings)) > 2000
    assert not search.session.plain.design.stored
    assert not search.session.at_bandwidth(2.5).plain.design.stored


@pytest.mark.slow
def test_an_effect_is_found_on_pieces_and_fitted_to_everything(hour: list[Recording], small: None) -> None:
    size = 400.0
    recordings = [
        recording(r.role, motion, r.duration, n, size)
        for n, (r, motion) in enumerate(zip(hour, (1, 2, 2, 3), strict=True))
    ]
    session = Session(MACHINE, recordings, Options(bootstrap=0))
    search = session.search
    assert session.long and not search.whole and search.pieces > 4
    assert search.session.bank.bandwidth_hz == session.bank.bandwidth_hz
    assert search.seconds < 0.4 * search.of_seconds and "pieces" in search_note(search)
    corrections = Corrections(MACHINE)
    pieces = run_attribution(search.session, corrections)
    found = attributed(session, corrections)
    assert [(a.score.term.id, a.score.term.joint) for a in found.accepted] == [("position_dependent_friction", 1)]
    assert found.accepted[0].validate_gain is not None and found.accepted[0].validate_gain > 100
    terms = [a.score.term for a in found.accepted]
    whole = SessionSignals(session, corrections).refit(terms)
    part = whole.term_slice(0)
    assert whole.wald(0) > 1.5 * pieces.model.wald(0)
    assert whole.fit.std[part][0] < 0.8 * pieces.model.fit.std[pieces.model.term_slice(0)][0]
    assert abs(whole.fit.theta[part][0] - size) < 0.1 * size
    session.forget_search()
    assert session.search is not search


def _claimed(model: Model, term: Term) -> Attribution:
    """An attribution that claims a term."""
    score = score_terms(model, [term], [1])[0]
    return Attribution(model, model, (Accepted(score, (), HeldOut(1.0, 1.0, 1), 1.0),), (), (), ())


@pytest.mark.slow
def test_what_does_not_stand_on_everything_is_dropped(hour: list[Recording], small: None) -> None:
    session = Session(MACHINE, hour, Options(bootstrap=0))
    model = session.search.session.base_model
    claimed = _claimed(model, Term(effect("position_dependent_friction"), 1))
    assert held_against_everything(session, Corrections(MACHINE), session.search, claimed).accepted == ()


@pytest.mark.slow
def test_a_moment_between_pieces_is_found_on_all_samples(hour: list[Recording], small: None) -> None:
    kilograms, moment = 6.0, 243.0
    moved = make_motion(MACHINE, "train", 2, 600.0)
    effort = force(MACHINE, ARM, moved)
    tip = rigid_body_regressor(MACHINE, moved.q, moved.qd, moved.qdd, columns=[10])[:, :, 0]
    effort += kilograms * (tip / moved.r) * (moved.t >= moment)[:, None]
    train = sample(MACHINE, moved, effort, "train", 3, Noise(), number=1)
    session = Session(MACHINE, [hour[0], train, hour[3]], Options(bootstrap=0))
    assert session.search.gap > 30.0
    assert not any(
        p.start < 50 * moment < p.stop for p in choose_pieces(MACHINE, session.recordings, BANK, 16_000)[1].pieces
    )
    guess = Term(effect("payload"), None, {"recording": 1.0, "t_0": moment + 0.4 * session.search.gap})
    signals = SessionSignals(session, Corrections(MACHINE))
    (found,) = with_best_shapes(signals.refit([guess]), session.prior, session.search.gap)
    assert abs(found.shape["t_0"] - moment) < 5.0
    model = signals.refit([found])
    # The moment is half a second off, and what was carried then counts against the mass: five per cent.
    assert model.fit.theta[model.term_slice(0)][0] == pytest.approx(kilograms, rel=0.05)


def test_recordings_are_numbered_as_in_the_whole(hour: list[Recording]) -> None:
    search = Search(Session(MACHINE, hour), (0, 4, 7), 3, 60.0, 600.0)
    term = Term(effect("payload"), None, {"recording": 2.0, "t_0": 1.0})
    whole = dict(enumerate(search.numbers))
    there = renumbered(term, whole)
    assert there.shape == {"recording": 7.0, "t_0": 1.0}
    assert renumbered(there, {n: k for k, n in whole.items()}) == term
    every = Term(effect("payload"), None, {"recording": -1.0, "t_0": 1.0})
    assert renumbered(every, whole) == every
    assert not search.whole
