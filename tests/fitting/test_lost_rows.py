"""Lost rows: put back into the clock, bridged by what is measured beside them, and without weight where they hide."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic_arm import RATE, clean_session, make_recordings, planar_machine, truth

from daq.errors import RecordingError
from daq.recordings.recording import Recording
from fitting.loop.session import Options, Session
from fitting.regression.design import measured_rows
from fitting.regression.noise import pair_repeats
from fitting.signals.filters import filter_bank
from fitting.signals.lost_rows import bridged, hidden, with_lost_rows
from fitting.signals.motion_frequency import motion_frequency
from fitting.signals.position_sensors import channel_noise

MACHINE = planar_machine(2)
ARM = truth(2)
RECORDINGS = make_recordings(MACHINE, ARM)


def without(recording: Recording, lost: np.ndarray) -> Recording:
    """The recording with some rows gone from its file."""
    kept = np.setdiff1d(np.arange(len(recording)), lost)
    values = {name: np.asarray(own)[kept] for name, own in recording.values.items()}
    return replace(recording, time=recording.time[kept], values=values)


def simple(values: np.ndarray) -> Recording:
    return Recording("m", "train", "r", "", RATE, np.arange(len(values)) / RATE, {"x": values})


@given(lost=st.sets(st.integers(1, 98), max_size=40))
def test_lost_rows_are_put_back_where_they_were(lost: set[int]) -> None:
    whole = simple(np.arange(100.0))
    found = with_lost_rows(without(whole, np.array(sorted(lost), dtype=int)))
    gaps = [len(run) for run in np.split(np.array(sorted(lost)), np.flatnonzero(np.diff(sorted(lost)) > 1) + 1)]
    if max(gaps, default=0) > RATE:
        return  # a pause
    assert found.time == pytest.approx(whole.time, abs=1e-9)
    missing = np.isin(np.arange(100), sorted(lost))
    assert np.array_equal(np.isnan(found.values["x"]), missing)
    assert np.array_equal(found.values["x"][~missing], np.arange(100.0)[~missing])


def repeating(recording: Recording, rows: np.ndarray) -> Recording:
    """The recording as a recorder writes it that repeats its last row where it has no new one."""
    source = np.arange(len(recording))
    source[rows] -= 1
    return replace(recording, values={name: np.asarray(own)[source] for name, own in recording.values.items()})


@settings(max_examples=20, deadline=None)
@given(lost=st.sets(st.integers(1, 198).map(lambda k: 2 * k), min_size=1, max_size=60))
def test_rows_that_repeat_the_one_before_are_lost(lost: set[int]) -> None:
    rows = np.array(sorted(lost))
    whole = replace(RECORDINGS[1].cut(slice(0, 400)), role="train")
    found = with_lost_rows(repeating(whole, rows))
    for name, own in found.values.items():
        assert np.flatnonzero(np.isnan(own)).tolist() == rows.tolist()
        assert np.delete(own, rows) == pytest.approx(np.delete(np.asarray(whole.values[name]), rows), abs=0)


def test_a_machine_that_stands_a_slow_device_and_few_levels_repeat_no_rows() -> None:
    whole, rows = RECORDINGS[1], np.arange(len(RECORDINGS[1]))
    values = {name: np.asarray(own) for name, own in whole.values.items()}
    stands = {name: own[np.clip(rows, None, 300)] for name, own in values.items()}
    slow = {name: own[rows // 2 * 2] for name, own in values.items()}
    coarse = {name: np.round(own / np.ptp(own) * 40) for name, own in list(values.items())[:2]}
    for changed in (values, stands, slow, coarse):
        assert with_lost_rows(replace(whole, values=changed)).values == changed


def test_a_pause_is_no_lost_rows() -> None:
    recording = simple(np.arange(100.0))
    paused = replace(recording, time=recording.time + 30.0 * (recording.time > 1.0))
    assert with_lost_rows(paused) is paused


@given(
    coefficients=st.lists(st.floats(-2, 2), min_size=4, max_size=4),
    gaps=st.lists(st.tuples(st.integers(10, 180), st.integers(1, 6)), min_size=1, max_size=4),
)
def test_a_cubic_is_bridged_exactly_and_marked(coefficients: list[float], gaps: list[tuple[int, int]]) -> None:
    t = np.linspace(-1, 1, 200)
    values = np.polyval(coefficients, t)
    missing = np.zeros(200, dtype=bool)
    for start, length in gaps:
        missing[start : start + length] = True
    edges = np.flatnonzero(np.diff(np.concatenate([[0], missing.astype(int), [0]])))
    short = np.zeros(200, dtype=bool)
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        short[start:stop] = stop - start <= 4
    found = bridged(simple(np.where(missing, np.nan, values)), 4)
    assert found.values["x"][~missing | short] == pytest.approx(values[~missing | short], abs=1e-9)
    assert np.isnan(found.values["x"][missing & ~short]).all()
    assert np.array_equal(short, np.zeros(200, dtype=bool) if found.bridged is None else found.bridged)


def test_a_slow_device_and_the_ends_are_no_gaps() -> None:
    half = np.where(np.arange(200) % 2, np.nan, np.arange(200.0))
    ends = np.where(np.isin(np.arange(200), [0, 1, 199]), np.nan, np.arange(200.0))
    for values in (half, ends):
        assert bridged(simple(values), 4).bridged is None


def test_what_is_made_up_is_no_witness_of_noise() -> None:
    rng = np.random.default_rng(3)
    values = np.sin(np.arange(4000) / 200) + 1e-3 * rng.normal(size=4000)
    holes = np.where(rng.random(4000) < 0.2, np.nan, values)
    assert channel_noise(bridged(simple(holes), 4), "x") == pytest.approx(1e-3, rel=0.08)
    assert channel_noise(bridged(simple(np.where(np.arange(4000) % 4 == 3, np.nan, values)), 4), "x") > 5e-4
    # A sensor that stands says nothing of the noise that it has while it moves.
    stands = np.concatenate([values, np.full(4000, values[-1])])
    assert channel_noise(simple(stands), "x") == pytest.approx(1e-3, rel=0.05)


def test_rows_beside_what_hides_have_no_weight_and_beside_a_single_one_they_do() -> None:
    bank = filter_bank(RATE, 3.0)
    session = clean_session(2)
    segment = session.plain.design.segments[0]
    single, long = np.zeros(len(segment), dtype=bool), np.zeros(len(segment), dtype=bool)
    single[::7] = True
    long[900:908] = True
    assert measured_rows(bank, replace(segment, bridged=single)).all()
    told = measured_rows(bank, replace(segment, bridged=long))
    middles = bank.half + bank.decimation * np.arange(len(told))
    assert not told[np.abs(middles - 904) < 4].any()
    assert told[np.abs(middles - 904) > 40].all()
    assert hidden(single | long, 2).sum() == 8 + (long[899] or single[899] or single[908])


def test_long_gaps_beside_one_another_are_no_fast_motion() -> None:
    """Up to a second each: a cubic through what lies beyond the next gap misses its ends, and a step is fast."""
    whole, rng = RECORDINGS[1], np.random.default_rng(3)
    expected = motion_frequency(MACHINE, [whole], in_pieces=False)
    for _ in range(10):
        lost = np.concatenate([np.arange(k, k + rng.integers(5, 45)) for k in rng.choice(len(whole) - 60, 20) + 5])
        cut = with_lost_rows(without(whole, np.unique(lost)))
        assert motion_frequency(MACHINE, [cut], in_pieces=False) < 1.5 * expected


def lost_of(pattern: str, rows: int, rng: np.random.Generator) -> np.ndarray:
    inner = np.arange(1, rows - 1)
    if pattern == "thirty":
        return rng.choice(inner, 30, replace=False)
    if pattern == "a fifth":
        return inner[rng.random(len(inner)) < 0.2]
    if pattern == "every fifth":
        return inner[3::5]
    starts = rng.choice(inner[:-8], rows // 60, replace=False)
    return np.unique(np.concatenate([starts + k for k in range(8)]))


@pytest.mark.slow
@pytest.mark.parametrize("pattern", ["thirty", "a fifth", "every fifth", "bursts"])
def test_any_pattern_of_loss_identifies_as_the_whole_does(pattern: str) -> None:
    rng = np.random.default_rng(5)
    whole = Session(MACHINE, RECORDINGS, Options(loop=False))
    holed = Session(MACHINE, [without(r, lost_of(pattern, len(r), rng)) for r in RECORDINGS], Options(loop=False))
    assert holed.bank.bandwidth_hz == whole.bank.bandwidth_hz
    assert whole.plain.pairs and holed.plain.pairs
    first, second = whole.base_model.fit, holed.base_model.fit
    apart = (second.theta - first.theta) / np.hypot(first.std, second.std)
    assert np.all(np.abs(apart) < 4.0)
    assert np.all(second.std < 3.0 * first.std)


def test_frequency_is_that_of_the_motion_not_of_a_stretch() -> None:
    whole = RECORDINGS[1]
    cut = without(whole, np.arange(40, len(whole) - 40, 100))
    found = motion_frequency(MACHINE, [with_lost_rows(cut)], in_pieces=False)
    assert found == pytest.approx(motion_frequency(MACHINE, [whole], in_pieces=False), rel=0.05)


def test_short_stretches_of_other_motions_are_no_repeats_and_no_crash() -> None:
    """A lag of four seconds is more than all of a stretch of three."""
    recordings = [replace(r.cut(slice(0, 230)), role=r.role) for r in RECORDINGS]
    recordings[2] = replace(RECORDINGS[3].cut(slice(0, 230)), role="repeat")
    session = Session(MACHINE, recordings, Options(loop=False, bandwidth_hz=3.0))
    assert pair_repeats(session.plain.design) == ()


def test_a_replica_is_not_looked_at_as_if_somebody_had_sent_it() -> None:
    recording = RECORDINGS[1]
    values = {**recording.values, "joint1.q": np.asarray(recording.values["joint1.q"])[::-1].copy()}
    odd = replace(recording, values=values)
    with pytest.raises(RecordingError, match="its joint does not follow"):
        Session(MACHINE, [odd])
    assert Session(MACHINE, [odd], synthetic=True).recordings[0] is odd


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**31))
def test_a_lost_row_changes_the_filtered_motion_by_less_than_its_noise(seed: int) -> None:
    rng = np.random.default_rng(seed)
    bank = filter_bank(RATE, 3.0)
    t = np.arange(600) / RATE
    noise = 1e-4
    values = np.sin(2 * np.pi * 0.4 * t + rng.uniform(0, 6)) + noise * rng.normal(size=len(t))
    row = int(rng.integers(100, 500))
    holed = bridged(simple(np.where(np.arange(600) == row, np.nan, values)), 1).values["x"]
    for kernel, change in zip((bank.value, bank.first, bank.second), bank.smooth(holed - values), strict=True):
        assert np.abs(change).max() < 6.0 * noise * np.linalg.norm(kernel)
