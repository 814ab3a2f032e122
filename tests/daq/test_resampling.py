"""Resampling: what is in the band survives, what is above does not fold in, gaps stay gaps, and it is always said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from bench_machines import plain
from hypothesis import given, settings
from hypothesis import strategies as st

from daq import Machine, Quality, RecordingError, parse_machine, read_recording
from daq.recordings.resampling import PASSBAND, grid, native_rate, resample

RATE = 50.0
MACHINE: Machine = parse_machine(plain())
#: What a band-limited signal may lose of its amplitude.
LOST = 1e-3


def sines(t: np.ndarray, frequencies: np.ndarray, phases: np.ndarray) -> np.ndarray:
    """Sines of one amplitude each over their number: between -1 and 1."""
    return np.sin(2 * np.pi * frequencies * t[:, None] + phases).mean(axis=1)


def brought(time: np.ndarray, values: np.ndarray, rate: float = RATE) -> tuple[np.ndarray, np.ndarray]:
    """Times and values of one column at the machine's rate, where something is said."""
    at = grid([time], rate)
    out = resample(time, {"a": values}, rate, at).values["a"]
    known = np.isfinite(out)
    return at[known], out[known]


@given(
    rate=st.sampled_from([51.3, 60.0, 96.7, 100.0, 125.0, 200.0, 333.3, 1000.0]),
    shares=st.lists(st.floats(0.0, PASSBAND), min_size=1, max_size=4),
    seed=st.integers(0, 2**31),
)
@settings(max_examples=40, deadline=None)
def test_band_limited_signals_survive(rate: float, shares: list[float], seed: int) -> None:
    phases = np.random.default_rng(seed).uniform(0, 2 * np.pi, len(shares))
    frequencies = np.array(shares) * RATE / 2
    t = 3.0 + np.arange(int(6 * rate)) / rate
    at, out = brought(t, sines(t, frequencies, phases))
    assert len(at) > 4.9 * RATE
    assert np.max(np.abs(out - sines(at, frequencies, phases))) < LOST


@pytest.mark.slow
@given(rate=st.sampled_from([100.0, 125.0, 200.0, 333.3, 1000.0]), share=st.floats(0, 1), seed=st.integers(0, 2**31))
@settings(max_examples=40, deadline=None)
def test_nothing_above_the_new_band_folds_in(rate: float, share: float, seed: int) -> None:
    frequency = np.array([RATE / 2 + share * (rate / 2 - RATE / 2)])
    phase = np.random.default_rng(seed).uniform(0, 2 * np.pi, 1)
    t = np.arange(int(6 * rate)) / rate
    _, out = brought(t, sines(t, frequency, phase))
    assert np.max(np.abs(out)) < LOST


def test_resampling_leaves_a_constant_unchanged() -> None:
    t = np.arange(2000) / 200.0
    assert np.allclose(brought(t, np.full(2000, 21e6))[1], 21e6, rtol=1e-13)


@pytest.mark.parametrize("rate", [50.0, 200.0])
def test_an_uneven_clock_is_straightened(rate: float) -> None:
    rng = np.random.default_rng(4)
    t = (np.arange(int(10 * rate)) + rng.uniform(-0.2, 0.2, int(10 * rate))) / rate
    frequencies, phases = np.array([0.3, 1.1, 2.0]), np.array([0.0, 1.0, 2.0])
    at, out = brought(t, sines(t, frequencies, phases))
    assert np.max(np.abs(out - sines(at, frequencies, phases))) < LOST
    fast, there = np.array([8.0]), (at > 0.5) & (at < 9.5)  # the widest identification band of this rate is 10 Hz
    assert np.max(np.abs(brought(t, sines(t, fast, phases[:1]))[1] - sines(at, fast, phases[:1]))[there]) < LOST
    naive = sines(t, frequencies, phases)[:: round(rate / RATE)][: len(at)]
    assert np.max(np.abs(naive - sines(grid([t], RATE), frequencies, phases)[: len(naive)])) > 5 * LOST


@pytest.mark.slow
@given(lost=st.lists(st.tuples(st.floats(1.0, 8.0), st.floats(0.011, 1.5)), min_size=1, max_size=3))
@settings(max_examples=30, deadline=None)
def test_gaps_stay_gaps(lost: list[tuple[float, float]]) -> None:
    """No value is made of samples from both sides of a gap: changing all after it changes nothing before it."""
    t = np.arange(2000) / 200.0
    kept = np.ones(len(t), dtype=bool)
    for begin, length in lost:
        kept &= ~((t >= begin) & (t < begin + length))
    time = t[kept]
    at = grid([time], RATE)
    values = np.sin(2 * np.pi * 0.7 * time)
    out = resample(time, {"a": values}, RATE, at).values["a"]
    edges = np.flatnonzero(np.diff(time) * 200.0 > 1.5)
    for edge in edges:
        inside = (at > time[edge] + 1e-9) & (at < time[edge + 1] - 1e-9)
        assert not np.any(np.isfinite(out[inside]))
        other = np.where(np.arange(len(time)) > edge, 100.0, values)
        before = at <= time[edge] + 1e-9
        again = resample(time, {"a": other}, RATE, at).values["a"]
        assert np.array_equal(again[before], out[before], equal_nan=True)
    known = np.isfinite(out)
    assert np.all(np.abs(out[known] - np.sin(2 * np.pi * 0.7 * at[known])) < LOST)


def test_a_channel_that_was_silent_is_missing_alone() -> None:
    t = np.arange(2000) / 200.0
    silent = np.where((t > 4) & (t < 5), np.nan, 1.0)
    done = resample(t, {"a": silent, "b": np.ones(2000)}, RATE, grid([t], RATE))
    middle = (done.time > 4) & (done.time < 5)
    assert np.all(np.isnan(done.values["a"][middle])) and np.allclose(done.values["b"][middle], 1.0)
    assert native_rate(t) == pytest.approx(200.0) and 1.0 < done.gap_seconds < 4.0


def recording(path: Path, rate: float, seconds: float = 20.0, gap: tuple[float, float] | None = None) -> Path:
    """A CSV of the bench at another rate, in its declared units."""
    rng = np.random.default_rng(2)
    t = np.arange(int(seconds * rate)) / rate
    if gap is not None:
        t = t[(t < gap[0]) | (t >= gap[1])]
    q = 0.8 * np.sin(2 * np.pi * 0.2 * t)
    noise = 0.1 * rng.standard_normal((2, len(t)))
    columns = [t, np.rad2deg(q), 100 * (q + 1.2), 60 + 20 * np.sin(t) + noise[0], 30 + 10 * np.cos(t) + noise[1]]
    rows = np.column_stack([*columns, np.full(len(t), 45.0)])
    np.savetxt(path, rows, delimiter=",", header="time,j1.angle,j1.piston,j1.head,j1.rod,oil", comments="", fmt="%.9g")
    return path


def test_other_rates_are_refused_unless_asked_for(tmp_path: Path) -> None:
    path = recording(tmp_path / "fast.csv", 200.0)
    with pytest.raises(RecordingError) as caught:
        read_recording(path, MACHINE, "train")
    line = str(caught.value)
    assert "\n" not in line and line.startswith(str(path))
    assert "200 Hz" in line and "rate_hz 50" in line and "--resample" in line


@pytest.mark.slow
@pytest.mark.parametrize("rate", [200.0, 1000.0, 60.0])
def test_other_rates_are_brought_to_the_machines_and_it_is_said(tmp_path: Path, rate: float) -> None:
    read = read_recording(recording(tmp_path / "fast.csv", rate), MACHINE, "train", resample=True)
    assert np.allclose(np.diff(read.time), 1 / RATE)
    assert np.max(np.abs(read.values["j1.angle"] - 0.8 * np.sin(2 * np.pi * 0.2 * read.time))) < 0.8 * LOST
    assert len(read.notes) == 1
    for word in ("fast.csv", f"from {rate:g} Hz", "to 50 Hz", "low pass", "20 Hz"):
        assert word in read.notes[0], read.notes


def test_a_gap_is_marked_missing(tmp_path: Path) -> None:
    path = recording(tmp_path / "gap.csv", 200.0, gap=(9.0, 11.0))
    read = read_recording(path, MACHINE, "train", resample=True)
    inside = (read.time > 9.0) & (read.time < 11.0)
    assert np.count_nonzero(inside) >= 98
    for channel in MACHINE.channels:
        assert np.all(np.isnan(read.values[channel.name][inside]))
        assert np.all(read.quality[channel.name][inside] == Quality.MISSING)
    assert len(read.segments()) == 2 and "left out" in read.notes[0]


def test_the_machines_own_rate_is_left_alone(tmp_path: Path) -> None:
    path = recording(tmp_path / "own.csv", RATE)
    plainly, asked = (read_recording(path, MACHINE, "train", resample=how) for how in (False, True))
    assert asked.notes == () and np.array_equal(plainly.values["j1.head"], asked.values["j1.head"])


def test_a_slower_file_says_what_it_lacks(tmp_path: Path) -> None:
    read = read_recording(recording(tmp_path / "slow.csv", 25.0), MACHINE, "train", resample=True)
    assert "nothing above 12.5 Hz" in read.notes[0] and np.allclose(np.diff(read.time), 1 / RATE)


def test_saturation_is_seen_before_it_is_smoothed(tmp_path: Path) -> None:
    path = recording(tmp_path / "clipped.csv", 200.0)
    rows = np.loadtxt(path, delimiter=",", skiprows=1)
    head = MACHINE.channel("head_pressure", "j1")
    assert head is not None and head.range is not None
    rows[:, 3] = np.where(rows[:, 3] > 75.0, head.range[1], rows[:, 3])
    np.savetxt(path, rows, delimiter=",", header=path.read_text().splitlines()[0], comments="", fmt="%.9g")
    with pytest.raises(RecordingError, match="saturated"):
        read_recording(path, MACHINE, "train", resample=True)


def test_single_lost_samples_are_no_gaps_and_two_together_are() -> None:
    """A sine of a tenth of the new rate, with every twentieth of its samples lost, is what it was."""
    time = np.arange(4000) / 100.0
    wave = np.sin(2 * np.pi * 5.0 * time)
    at = np.arange(50, 1950) / 50.0
    single = np.setdiff1d(np.arange(4000), np.arange(11, 4000, 20))
    found = resample(time[single], {"x": wave[single]}, 50.0, at)
    inner = (at > 1.0) & (at < 38.0)
    assert found.values["x"][inner] == pytest.approx(np.sin(2 * np.pi * 5.0 * at[inner]), abs=2e-3)
    double = np.setdiff1d(np.arange(4000), [2000, 2001])
    assert np.isnan(resample(time[double], {"x": wave[double]}, 50.0, at).values["x"]).any()
