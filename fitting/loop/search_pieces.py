"""The pieces of long recordings that the loop searches: whole stretches, spread in time, chosen for what they cover.

The loop weighs hundreds of columns against each other in memory, which hours do not fit in. What it needs of hours is
that nothing is left out that happens in them, so of every recording

* the first and the last piece are taken, so that times are counted from the recording's beginning and changes have the
  whole time to happen in,
* half of its share is spread evenly over its time,
* the rest is chosen for coverage: each joint's range of position, speed, acceleration, effort and pressure is cut into
  bins, in both directions of motion, and the next piece is the one that adds most to the sum of ``1 - exp(-T / 3 s)``
  over the time ``T`` spent in each bin: ten correlation times of a residual in one place show that something is there,
  and it is not worth seeing a pose again while another has not been seen. Among equals, what adds to the sum of
  ``sqrt(T)``, as the significance of an effect in one bin does.

The same stretches are taken of a training motion and of its repetition. Recordings that fit into an equal share of the
budget are taken whole. Bins are of measured signals, but only their occupancy counts, never a residual: what is chosen
does not depend on what the model leaves there.

Source: G. Nemhauser, L. Wolsey and M. Fisher, "An analysis of approximations for maximizing submodular set functions",
Math. Programming 14, 1978 (a greedy choice has at least 63 % of the best coverage).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from daq.machine.machine_file import Joint, Machine
from daq.recordings.recording import Recording
from fitting.arrays import FloatArray
from fitting.signals.filters import FilterBank, lag_between
from fitting.signals.position_sensors import position_channel

#: Samples of a piece in samples that filters lose at its ends: so a tenth is lost.
_LOSSES = 10
#: Pieces that a recording's share has to hold at least; with more recordings than that allows, some are left out.
_LEAST_PIECES = 3
#: Share by which what is taken may exceed the budget: a minute is 3000 rows, or 3001.
_ABOUT = 0.02
#: Shares of the groups of roles in the budget: on `validate` nothing is selected, and all of it judges in the end.
_GROUPS = {("unloaded",): 0.2, ("train", "operation", "repeat"): 0.6, ("validate",): 0.2}
#: Bins per signal, seconds between two looks at it, and share of outliers on each side that no bin is made for.
_BINS, _STEP_SECONDS, _OUTLIERS = 10, 0.1, 0.001
#: Time in one bin after which more of it is worth little: ten correlation times of a filter of 3 Hz.
_ENOUGH_SECONDS = 3.0
#: A repetition lies at most this far from its training motion, s, and follows it within this share of its spread.
_MAX_LAG_SECONDS, _SAME_MOTION = 4.0, 0.05


@dataclass(frozen=True)
class Chosen:
    """Rows of a recording, by its number, that are searched: stretches in order, apart from each other."""

    number: int
    pieces: tuple[slice, ...]

    @property
    def rows(self) -> int:
        """Number of rows."""
        return sum(piece.stop - piece.start for piece in self.pieces)

    @property
    def gap(self) -> int:
        """Most rows between two pieces."""
        return max((after.start - before.stop for before, after in pairwise(self.pieces)), default=0)


def choose_pieces(machine: Machine, recordings: Sequence[Recording], bank: FilterBank, budget: int) -> list[Chosen]:
    """Choose stretches of recordings, in any order of roles, with at most about ``budget`` rows in all.

    Returns
    -------
    list
        Recordings with their pieces, in the order given. All roles that were there are there; with very many recordings
        some are left out, evenly.
    """
    length = _LOSSES * 2 * (bank.margin + bank.half)
    numbers = _kept(recordings, budget, length)
    partners = _partners(machine, recordings, numbers, length)
    chosen: dict[int, tuple[slice, ...]] = {}
    levels: dict[str, float] = {}
    groups = [[n for n in numbers if recordings[n].role in roles] for roles in _GROUPS]
    shares = _shares([sum(len(recordings[n]) for n in own) for own in groups], budget)
    for own, share in zip(groups, shares, strict=True):
        if not own:
            continue
        level = _level([len(recordings[n]) for n in own], int(share))
        levels |= {recordings[n].role: level for n in own}
        wholes = [n for n in own if len(recordings[n]) <= (1 + _ABOUT) * level and n not in partners]
        cut = [n for n in own if n not in wholes and n not in partners]
        chosen |= {n: (slice(0, len(recordings[n])),) for n in wholes}
        if cut:
            chosen |= _covering(machine, [(n, recordings[n]) for n in cut], length, level)
    for number, (train, lag) in partners.items():
        rows, level = len(recordings[number]), levels["repeat"]
        if max(rows, len(recordings[train])) <= (1 + _ABOUT) * level:
            chosen[number] = (slice(0, rows),)
            continue
        moved = [slice(max(0, p.start + lag), min(rows, p.stop + lag)) for p in chosen[train]]
        inside = [p for p in moved if p.stop - p.start >= length // 2]
        chosen[number] = tuple(inside) or (slice(0, min(rows, int(level))),)
    return [Chosen(n, chosen[n]) for n in numbers]


def thinned(recording: Recording, pieces: Sequence[slice]) -> Recording:
    """Return a recording of some stretches only, in memory, on its own clock, with gaps between."""
    if len(pieces) == 1 and pieces[0] == slice(0, len(recording)):
        return recording.cut(pieces[0])
    cuts = [recording.cut(piece) for piece in pieces]

    def whole(name: str) -> Any:
        parts = [getattr(cut, name) for cut in cuts]
        if isinstance(parts[0], Mapping):
            return {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}
        return None if parts[0] is None else np.concatenate(parts)

    columns = ("time", "values", "age", "quality", "cycle", "utc_ns", "bridged")
    return replace(cuts[0], notes=(), events=(), **{name: whole(name) for name in columns})


def _kept(recordings: Sequence[Recording], budget: int, length: int) -> list[int]:
    """Choose the recordings that share ``budget`` rows.

    Each has to hold some pieces of ``length``, or all that there is of it. Where that is too much, recordings are left
    out, one after another, in the group of roles that is the furthest beyond its share and the role that has the most.
    Those kept are evenly spread, and the last is one of them: somebody has just made it for what is not known yet.
    """
    need = [min(len(recording), _LEAST_PIECES * length) for recording in recordings]
    kept = {role: [n for n, r in enumerate(recordings) if r.role == role] for group in _GROUPS for role in group}
    spread = dict(kept)
    while several := [role for role, own in spread.items() if len(own) > 1]:
        rows = {group: sum(need[n] for role in group for n in spread[role]) for group in _GROUPS}
        if sum(rows.values()) <= (1 + _ABOUT) * budget:
            break
        beyond = {role: rows[group] / share for group, share in _GROUPS.items() for role in group}
        role = max(several, key=lambda one: (beyond[one], len(spread[one])))
        places = np.linspace(len(kept[role]) - 1, 0, len(spread[role]) - 1)
        spread[role] = [kept[role][round(place)] for place in places]
    return sorted(n for own in spread.values() for n in own)


def _shares(lengths: Sequence[int], budget: int) -> list[float]:
    """Share the rows among roles, at most a fifth for all but the training; what one leaves goes to the others."""
    shares = [float(min(length, share * budget)) for length, share in zip(lengths, _GROUPS.values(), strict=True)]
    for place in sorted(range(len(lengths)), key=lambda k: -list(_GROUPS.values())[k]):
        shares[place] = min(float(lengths[place]), shares[place] + budget - sum(shares))
    return shares


def _level(lengths: Sequence[int], budget: int) -> float:
    """Compute each recording's rows so that all have ``budget``; what short ones leave goes to the others."""
    left, rest = float(budget), sorted(lengths)
    for place, length in enumerate(rest):
        share = left / (len(rest) - place)
        if length > share:
            return share
        left -= length
    return float(rest[-1])


def _partners(
    machine: Machine, recordings: Sequence[Recording], numbers: Sequence[int], length: int
) -> dict[int, tuple[int, int]]:
    """Return each repetition's training recording and by how many rows it is later."""
    found: dict[int, tuple[int, int]] = {}
    trains = [n for n in numbers if recordings[n].role == "train"]
    for repeat in (n for n in numbers if recordings[n].role == "repeat"):
        best = _SAME_MOTION
        for train in trains:
            rows = slice(0, min(length, len(recordings[train]), len(recordings[repeat])))
            a, b = (_positions(machine, recordings[n], rows) for n in (train, repeat))
            if not (np.isfinite(a).all() and np.isfinite(b).all()):
                continue
            lag = lag_between(a, b, int(_MAX_LAG_SECONDS * machine.rate_hz))
            overlap = len(a) - abs(lag)
            spread = np.maximum(a.std(axis=0), 1e-9)
            apart = a[max(0, -lag) :][:overlap] - b[max(0, lag) :][:overlap]
            cost = float(np.max(apart.std(axis=0) / spread))
            if cost < best:
                best = cost
                found[repeat] = (train, lag)
    return found


def _positions(machine: Machine, recording: Recording, rows: slice) -> FloatArray:
    return np.column_stack([recording.values[_position_name(machine, j)][rows] for j in machine.joints])


def _position_name(machine: Machine, joint: Joint) -> str:
    channel = position_channel(machine, joint)
    assert channel is not None  # the machine file guarantees a position
    return channel.name


def _covering(
    machine: Machine, recordings: Sequence[tuple[int, Recording]], length: int, level: float
) -> dict[int, tuple[slice, ...]]:
    """Choose pieces of recordings of one kind, each within its share ``level``, that together cover most."""
    used = [c.name for c in machine.channels if c.joint is not None]
    cut = {n: _pieces(recording.segments(used), length) for n, recording in recordings}
    seconds = _occupancy(machine, [(recording, cut[n]) for n, recording in recordings])
    covered = np.zeros(seconds[0].shape[1])
    result = {}
    for (number, _), table in zip(recordings, seconds, strict=True):
        own = cut[number]
        sizes = np.array([piece.stop - piece.start for piece in own])
        taken: list[int] = []
        for place in _even(len(own), max(2, int(0.5 * level / length))):
            if not taken or sizes[taken].sum() + sizes[place] <= level:
                taken.append(place)
                covered = covered + table[place]
        while True:
            fits = sizes[taken].sum() + sizes <= level
            fits[taken] = False
            if not fits.any():
                break
            gains = _coverage(covered + table)
            best = int(np.argmax(np.where(fits, gains, -np.inf)))
            taken.append(best)
            covered = covered + table[best]
        result[number] = _joined([own[place] for place in sorted(taken)])
    return result


def _coverage(seconds: FloatArray) -> FloatArray:
    """Compute the value of times (.., bins) s in all bins."""
    enough = seconds / _ENOUGH_SECONDS
    return np.asarray((1 - np.exp(-enough) + 0.01 * np.sqrt(enough)).sum(axis=-1))


def _even(count: int, wanted: int) -> list[int]:
    """Return first and last of ``count`` places, and others evenly between them: the ends come first."""
    places = [round(k) for k in np.linspace(0, count - 1, min(wanted, count))]
    return list(dict.fromkeys([places[0], places[-1], *places]))


def _pieces(stretches: Sequence[slice], length: int) -> list[slice]:
    """Cut gap-free stretches into pieces of ``length`` to twice that; shorter ones are left out if they may be."""
    result = []
    for stretch in stretches:
        rows = stretch.stop - stretch.start
        count = rows // length
        if not count:
            continue
        edges = stretch.start + np.linspace(0, rows, count + 1).round().astype(int)
        result += [slice(int(a), int(b)) for a, b in pairwise(edges)]
    if result:
        return result
    return sorted(stretches, key=lambda s: s.start)


def _joined(pieces: Sequence[slice]) -> tuple[slice, ...]:
    """Join neighbours that touch."""
    result: list[slice] = []
    for piece in pieces:
        if result and result[-1].stop == piece.start:
            result[-1] = slice(result[-1].start, piece.stop)
        else:
            result.append(piece)
    return tuple(result)


def _occupancy(machine: Machine, recordings: Sequence[tuple[Recording, Sequence[slice]]]) -> list[FloatArray]:
    """Compute per recording the seconds (pieces, bins) of its pieces in each bin of each signal."""
    step = max(1, round(_STEP_SECONDS * machine.rate_hz))
    tables: list[list[FloatArray]] = [[] for _ in recordings]
    names: list[tuple[Joint | None, str]] = []
    names += [name for joint in machine.joints for name in _signal_names(machine, joint)]
    names += [
        (None, c.name)
        for c in machine.channels
        if c.quantity == "oil_temperature" and all(np.isfinite(own.values[c.name]).all() for own, _ in recordings)
    ]
    for joint, name in names:
        signals = [list(_signals(machine, joint, name, recording, step)) for recording, _ in recordings]
        for kind in range(len(signals[0])):
            together = np.concatenate([own[kind][0] for own in signals])
            low, high = np.nanquantile(together, [_OUTLIERS, 1 - _OUTLIERS]) if np.isfinite(together).any() else (0, 0)
            for place, own in enumerate(signals):
                values, forth = own[kind]
                tables[place].append(_seconds(values, forth, low, high, recordings[place][1], step) * _STEP_SECONDS)
    return [np.hstack(own) for own in tables]


def _signal_names(machine: Machine, joint: Joint) -> Iterator[tuple[Joint, str]]:
    """Return the channels of a joint whose range is to be covered."""
    yield joint, _position_name(machine, joint)
    for quantity in ("head_pressure", "rod_pressure", "cylinder_force", "joint_effort"):
        channel = machine.channel(quantity, joint.name)
        if channel is not None:
            yield joint, channel.name


def _signals(
    machine: Machine, joint: Joint | None, name: str, recording: Recording, step: int
) -> Iterator[tuple[FloatArray, npt.NDArray[np.bool_]]]:
    """Yield a channel's binned values and where its joint moves forth; of a position speed and acceleration too."""
    values = np.asarray(recording.values[name][::step])
    if joint is None:
        yield values, np.ones(len(values), dtype=bool)
        return
    position = _position_name(machine, joint)
    speed = np.gradient(np.asarray(recording.values[position][::step]))
    forth = speed >= 0
    yield values, forth
    if name == position:
        yield speed, forth
        yield np.gradient(speed), forth


def _seconds(
    values: FloatArray, forth: npt.NDArray[np.bool_], low: float, high: float, pieces: Sequence[slice], step: int
) -> FloatArray:
    """Count looks (pieces, 2 bins) of each piece in each bin, in each direction."""
    if not high > low:
        return np.zeros((len(pieces), 1))
    seen = np.isfinite(values)
    scaled = np.where(seen, (values - low) / (high - low), 0.0)
    bins = 2 * np.clip((_BINS * scaled).astype(int), 0, _BINS - 1) + forth
    starts = np.array([-(-piece.start // step) for piece in pieces])
    stops = np.array([-(-piece.stop // step) for piece in pieces])
    owner = np.full(len(values), -1)
    for number, (start, stop) in enumerate(zip(starts, stops, strict=True)):
        owner[start:stop] = number
    used = seen & (owner >= 0)
    width = 2 * _BINS
    counts = np.bincount(owner[used] * width + bins[used], minlength=len(pieces) * width)
    return counts.reshape(len(pieces), width).astype(float)
