"""Rows that a bus or a recorder lost: put back into the clock, and bridged where they hide nothing of the motion.

A lost row would cut a recording in two, and each filter loses seconds at a cut; thirty of them leave nothing. But a gap
much shorter than a period of the motion hides none of it: there the motion is the cubic through what was measured on
both sides. It is fitted, not interpolated: across a longer gap the noise of two rows on either side would grow into a
wave inside the band. So such gaps are bridged before any filter. What is made up is marked: it is no witness of noise,
and a reduced row that rests on much of it has no weight. Longer gaps cut the recording.

Source: A. Savitzky and M. Golay, "Smoothing and differentiation of data by simplified least squares procedures",
Analytical Chemistry 36, 1964.
"""

from __future__ import annotations

from collections.abc import Mapping, MutableMapping
from dataclasses import replace
from functools import lru_cache

import numpy as np

from daq.recordings.recording import Recording
from daq.recordings.recording_checks import long_runs, lost_between, runs
from daq.scratch import ScratchColumns
from fitting.arrays import BoolArray, FloatArray
from fitting.signals.filters import FilterBank

#: s; a clock that goes on after a longer time was paused: nothing was lost.
_PAUSE_S = 1.0
#: Share of a channel's rows that may be bridged: a device that is read at every other row has another rate.
_MOST = 0.3
#: s; rows that repeat the one before for longer are no rows that were lost; how many that do by chance are expected.
_REPEATED_S, _CHANCE = 0.1, 1e-3
#: Longest gap that is bridged, in periods of the identification bandwidth, which is five times the motion's frequency.
_PERIODS = 0.5
#: Rows on either side that a gap is bridged from, beside as many as it is long; degree of the polynomial.
_BESIDE, _CUBIC = 2, 3


def repeated_rows(recording: Recording) -> BoolArray:
    """Find rows (N,) that a recorder wrote once more for want of new ones, seen as steps in a motion.

    Every channel has the value of the row before there, although they repeat it so seldom elsewhere that not one such
    row is to be expected. What lasts longer is a machine at rest, or a device that hangs, and more than a third of
    all rows is another rate.
    """
    count, alike = len(recording) - 1, np.ones(max(len(recording) - 1, 0), dtype=bool)
    own = []
    for values in recording.values.values():
        equal = np.diff(values) == 0
        alike &= equal
        own.append(np.count_nonzero(equal))
    again, most = np.count_nonzero(alike), max(1, round(_REPEATED_S * recording.rate_hz))
    if not 0 < again <= _MOST * count or count * np.prod((np.array(own) - again + 1.0) / (count - again)) > _CHANCE:
        return np.zeros(len(recording), dtype=bool)
    return np.concatenate([[False], alike & ~long_runs(alike, most + 1)])


def with_lost_rows(recording: Recording) -> Recording:
    """Insert a row for every period that the recording's clock left out, all its values missing, as in rows that repeat
    the one before.

    Quality, age and UTC of such rows are unknown; a recording that has some is without them altogether.
    """
    again = repeated_rows(recording)
    if again.any():
        shelf = _shelf(recording.values)
        for name, own in recording.values.items():
            shelf[name] = np.where(again, np.nan, own)
        recording = replace(recording, values=shelf)
    lost = lost_between(recording.time, recording.rate_hz)
    lost = np.where(lost > _PAUSE_S * recording.rate_hz, 0, lost)
    if not lost.any():
        return recording
    place = np.arange(len(recording)) + np.concatenate([[0], np.cumsum(lost)])
    every = np.arange(place[-1] + 1)
    values = _shelf(recording.values)
    for name, own in recording.values.items():
        wide = np.full(len(every), np.nan)
        wide[place] = own
        values[name] = wide
    cycle = recording.cycle
    return replace(
        recording,
        time=np.interp(every, place, recording.time),
        values=values,
        age={},
        quality={},
        cycle=None if cycle is None else cycle[0] + np.rint(np.interp(every, place, cycle - cycle[0])).astype(np.int64),
        utc_ns=None,
    )


def longest_bridge(bank: FilterBank) -> int:
    """Count the rows of the longest bridged gap; a single row always is."""
    return max(1, round(_PERIODS * bank.rate_hz / bank.bandwidth_hz))


def bridged(recording: Recording, most: int) -> Recording:
    """Fill gaps of at most ``most`` rows in each channel, and mark them.

    Left open are gaps at the ends and beside a jump of the clock, and those of a channel that lacks more than a third.
    """
    if not any(np.isnan(own).any() for own in recording.values.values()):
        return recording
    joined, made_up = recording.joined, np.zeros(len(recording), dtype=bool)
    values = _shelf(recording.values)
    for name, own in recording.values.items():
        short = short_gaps(~np.isfinite(own), joined, most)
        few = np.count_nonzero(short) <= _MOST * len(own)
        values[name] = filled(own, short) if few and short.any() else own
        made_up |= short & few
    if not made_up.any():
        return recording
    if recording.bridged is not None:
        made_up |= recording.bridged
    return replace(recording, values=values, bridged=made_up)


def short_gaps(missing: BoolArray, joined: BoolArray, most: int) -> BoolArray:
    """Find missing rows (N,) in runs of at most ``most`` between two measured ones; ``joined`` (N-1,) steps."""
    short = np.zeros(len(missing), dtype=bool)
    for run in runs(missing):
        inside = run.start > 0 and run.stop < len(missing) and joined[run.start - 1 : run.stop].all()
        if inside and run.stop - run.start <= most:
            short[run] = True
    return short


def filled(values: FloatArray, rows: BoolArray, closely: bool = False) -> FloatArray:
    """Fill some rows of values (N,) by the cubic that fits the measured ones on both sides best.

    A cubic does not fit as well across long gaps, and a step at either end passes for a fast motion. ``closely``, a row
    counts the less the further it is from the gap.
    """
    known = np.flatnonzero(np.isfinite(values))
    out = values.copy()
    for run in runs(rows):
        length, middle = run.stop - run.start, int(np.searchsorted(known, run.start))
        # No further away than that, be it that another gap is near: across it the motion is no cubic any more.
        first, last = np.searchsorted(known, [run.start - length - _BESIDE, run.stop + length + _BESIDE])
        near = known[max(0, min(first, middle - _BESIDE)) : max(last, middle + _BESIDE)]
        if len(near) > _CUBIC:
            offsets = tuple((near - run.start).tolist())
            out[run] = _weights(offsets, length, closely) @ values[near]
    return out


@lru_cache(maxsize=4096)
def _weights(near: tuple[int, ...], length: int, closely: bool) -> FloatArray:
    """Compute weights (length, k) of values at ``near`` in the best cubic's at places 0 to ``length - 1``."""
    places = np.array(near)
    counts = 1.0 / np.maximum(-places, places - length + 1) ** 2 if closely else np.ones(len(places))
    scale = float(np.abs(near).max())
    powers = np.vander(places / scale, _CUBIC + 1) * counts[:, None]
    return np.asarray(np.vander(np.arange(length) / scale, _CUBIC + 1) @ np.linalg.pinv(powers) * counts)


def hidden(made_up: BoolArray, most: int) -> BoolArray:
    """Find rows made up (N,) in runs of more than ``most``: what such a gap hides is unknown."""
    return long_runs(made_up, most + 1)


def _shelf(columns: Mapping[str, FloatArray]) -> MutableMapping[str, FloatArray]:
    """Return the shelf of columns: in a file, where given ones are."""
    return ScratchColumns(columns.scratch) if isinstance(columns, ScratchColumns) else {}
