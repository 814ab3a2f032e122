"""Signals over time: no peak is lost, whatever the plot's width; memory is bounded; time runs forward."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_live_stream import Source, rows, write

from server.platform.errors import InvalidError
from server.traces.extremes import Extremes, at_most, extremes, runs
from server.traces.signal_collector import SignalCollector, SignalMemory

SMALL = ((0.0, 400), (0.1, 200), (1.0, 300))


def remembered(memory: SignalMemory, time: np.ndarray, values: np.ndarray, step: int = 37) -> None:
    for start in range(0, len(time), step):
        part = slice(start, start + step)
        memory.add(time[part], values[part, None], np.isnan(values[part, None]))


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(rows=st.integers(2, 3000), moments=st.integers(2, 300), step=st.integers(1, 400), seed=st.integers(0, 2**32 - 1))
def test_the_extremes_of_a_range_are_those_of_its_rows_at_every_width(
    rows: int, moments: int, step: int, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    time = 1.7e9 + np.cumsum(rng.uniform(0.001, 0.05, rows))
    values = rng.normal(size=rows).astype(np.float32).astype(np.float64)
    memory = SignalMemory(1)
    remembered(memory, time, values, step)
    found = memory.read(time[0] - 2, time[-1] + 2, moments, [0])
    assert len(found.time) <= moments + 1
    assert np.all(np.diff(found.time) > 0)
    assert found.low.min() == values.min() and found.high.max() == values.max()
    # Each row lies in the moment whose middle is nearest to it: its value is between what that moment says.
    nearest = np.abs(found.time[None, :] - time[:, None]).argmin(axis=1)
    if found.width:
        inside = np.abs(found.time[nearest] - time) < 0.499 * found.width  # at an edge either is nearest
        assert np.all(found.low[nearest, 0][inside] <= values[inside])
        assert np.all(found.high[nearest, 0][inside] >= values[inside])


def test_what_is_older_than_the_finest_level_is_there_at_a_coarser_one_with_its_peak() -> None:
    memory = SignalMemory(1, SMALL)
    time = 1000 + np.arange(10_000) / 50  # 200 s; rows are kept for 8 s to 10 s, tenths for 20 s to 25 s
    values = np.zeros(10_000)
    values[501] = 7.0  # at 1010.02 s
    remembered(memory, time, values)
    old = memory.read(1000, 1200, 1000, [0])
    assert old.width == 1.0
    assert old.high.max() == 7.0 and old.time[old.high[:, 0].argmax()] == 1010.5
    assert memory.read(1185, 1200, 1000, [0]).width == 0.1
    assert memory.read(1196, 1200, 1000, [0]).width == 0.0
    assert len(memory.read(1000, 1200, 50, [0]).time) <= 51


def test_memory_is_bounded_and_a_clock_that_was_set_back_takes_along_what_is_later() -> None:
    memory = SignalMemory(1, SMALL)
    for hour in range(20):
        time = 3600 * hour + np.arange(0, 3600, 0.5)
        remembered(memory, time, np.full(len(time), float(hour)), 1000)
    whole = memory.read(0, 72_000, 4000, [0])
    assert len(whole.time) <= 300 * 1.25
    memory.add(np.array([71_990.25]), np.array([[-5.0]]), np.array([[False]]))
    assert memory.newest == 71_990.25
    again = memory.read(71_980, 71_999, 4000, [0])
    assert again.low.min() == -5.0 and np.all(np.diff(again.time) > 0) and again.time[-1] <= 71_991


def test_missing_values_stay_missing_and_are_marked_from_when_to_when() -> None:
    time = np.arange(100) / 50 + 0.005
    values = np.ones((100, 1))
    values[50:60] = np.nan
    found = extremes(time, values, values, np.isnan(values), 0.1)
    assert np.isnan(found.low[10]) and np.isnan(found.low[11]) and found.low[12] == 1
    assert runs(found.time, found.flagged[:, 0], 0.1) == [(pytest.approx(1.0), pytest.approx(1.2))]
    assert runs(time, np.isnan(values[:, 0]), 0.0) == [(pytest.approx(1.005), pytest.approx(1.205))]
    few = Extremes(time, values, values, np.isnan(values), 0.0)
    assert at_most(few, 0, 2, 100) is few


def test_the_collector_reads_a_ring_from_its_oldest_row_and_goes_on_with_the_next_ring() -> None:
    source = Source()
    collector = SignalCollector(source)
    stamped = rows(*(cycle / 50 for cycle in range(1, 21)), angle=np.pi / 6)
    stamped["utc_ns"] = (1.7e18 + stamped["time"] * 1e9).astype(np.int64)
    assert collector.read("lever", 10, None, 100, None) is None
    with source.running() as writer:
        write(writer, stamped[:10])
        collector.step()
    collector.step()  # it does not run: no reason to fail
    with source.running() as writer:
        write(writer, stamped[10:])
        collector.step()
        found = collector.read("lever", 10, None, 1000, ["joint1.angle"])
        assert found is not None
        channels, columns, traces, (start, end) = found
        assert (channels.names[columns[0]], channels.units[columns[0]]) == ("joint1.angle", "deg")
        assert len(traces.time) == 20 and end - start == pytest.approx(10)
        assert np.allclose(traces.low, 30.0)
        with pytest.raises(InvalidError, match="channel 'nothing'"):
            collector.read("lever", 10, None, 100, ["nothing"])
    collector.stop()
