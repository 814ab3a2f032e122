"""Low-passed, thinned samples of recordings, from which a trial regression is put together in milliseconds.

Positions and efforts go through one smoothing filter and are decimated at once; columns are then computed from few
samples. That bends what jumps (the sign of a speed at a reversal) by a few per cent of the friction, which an
identification could not afford and a search for mistakes, which are larger by far, can. Joints and pistons then move as
the sensor has it that is chosen for each.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from daq.machine.machine_file import Machine
from daq.recordings.recording import Recording
from fitting.arm.linkage import joint_motion, lever_arm, piston_motion
from fitting.arrays import BoolArray, FloatArray
from fitting.signals.filters import FilterBank, edge_frequency, filter_bank, white_noise_of

IntArray = npt.NDArray[np.int64]

#: Samples that a trial uses at most: rows of six joints are some thirty times the parameters of their arm.
MOST_SAMPLES = 420
#: Rows of one recording that are looked at by the regression at most (four minutes at 50 Hz, one at 200 Hz).
MOST_ROWS = 12_000
_BANDWIDTH_FACTOR, _LEAST_BANDWIDTH = 5.0, 1.5
#: An element moves where its speed is above this share of its own largest and above five times its noise.
_MOVES, _OF_NOISE = 0.02, 5.0

POSITIONS = ("joint_position", "piston_position")
PRESSURES = ("head_pressure", "rod_pressure")
EFFORTS = (*PRESSURES, "cylinder_force", "joint_effort")


@dataclass(frozen=True)
class Signal:
    """A channel through the filter: values, first and second time derivative, (T,) each, SI; noise of the first two."""

    value: FloatArray
    first: FloatArray
    second: FloatArray
    noise: float = 0.0
    speed_noise: float = 0.0

    def mapped(self, gain: float, offset: float = 0.0) -> Signal:
        """Return ``gain * signal + offset``."""
        noise, speed_noise = abs(gain) * self.noise, abs(gain) * self.speed_noise
        return Signal(gain * self.value + offset, gain * self.first, gain * self.second, noise, speed_noise)

    def faster(self, factor: float) -> Signal:
        """Return the same values in a time that runs ``factor`` times as fast."""
        speeds = factor * self.first, factor**2 * self.second
        return replace(self, first=speeds[0], second=speeds[1], speed_noise=factor * self.speed_noise)


@dataclass(frozen=True)
class Samples:
    """Samples of all recordings one after another; ``T`` of them, ``n`` joints.

    Attributes
    ----------
    machine : whose channels they are
    signals : by (quantity, number of the joint)
    dense : the same at the recordings' rate, stretch after stretch, (D,) each, for trials that move them in time
    at, first, last : (T,) where a sample is in them, and the ends of its stretch
    recording : (T,) index among the recordings
    time : (T,) s of the recordings' own clocks
    loaded : (T,) False in `unloaded` recordings
    external : (T, n) N, forces from outside
    used : (T,) False where a trial leaves a recording out
    bank : filters they went through
    """

    machine: Machine
    signals: Mapping[tuple[str, int], Signal]
    dense: Mapping[tuple[str, int], Signal]
    at: IntArray
    first: IntArray
    last: IntArray
    recording: IntArray
    time: FloatArray
    loaded: BoolArray
    external: FloatArray
    used: BoolArray
    bank: FilterBank

    def __len__(self) -> int:
        return len(self.time)

    @cached_property
    def since(self) -> FloatArray:
        """(T,) s since the beginning of each one's recording."""
        numbers = range(self.recording.max() + 1)
        begins = np.array([self.time[self.recording == k].min(initial=np.inf) for k in numbers])
        return np.asarray(self.time - begins[self.recording])

    @property
    def efforts(self) -> tuple[tuple[str, int], ...]:
        """Keys of the signals that efforts are made of."""
        return tuple(key for key in self.dense if key[0] in EFFORTS)

    def get(self, quantity: str, joint: int) -> Signal | None:
        """Return a joint's signal of that quantity, or None."""
        return self.signals.get((quantity, joint))

    def replaced(self, changes: Mapping[tuple[str, int], Signal]) -> Samples:
        """Return the samples with some signals in place of others."""
        return replace(self, signals={**self.signals, **changes})

    def moved(self, keys: Iterable[tuple[str, int]], seconds: FloatArray | float) -> Samples:
        """Take some signals ``seconds`` later, (T,) or one number: what a channel that is late so much has to be.

        Samples for which that lies beyond the end of their stretch are not used.
        """
        wanted = self.at + np.asarray(seconds) * self.bank.rate_hz
        place = np.clip(wanted, self.first, self.last - 1)
        below = np.minimum(place.astype(np.int64), self.last - 2)
        share = place - below
        moved = {}
        for key in keys:
            own = self.dense[key]
            parts = (own.value, own.first, own.second)
            value, first, second = ((1 - share) * part[below] + share * part[below + 1] for part in parts)
            moved[key] = Signal(value, first, second, own.noise, own.speed_noise)
        return replace(self.replaced(moved), used=self.used & (np.abs(place - wanted) < 1.0))


def take_samples(machine: Machine, recordings: Sequence[Recording]) -> Samples | None:
    """Take the samples of the stretches without a gap; None where none is long enough.

    Only channels that every recording has are used. A recording in which no joint moves adds what it has.
    """
    names = [c.name for c in machine.channels if c.joint is not None and all(c.name in r.values for r in recordings)]
    if not recordings or not names:
        return None
    bank = _bank(machine, recordings, names)
    parts = []
    for index, recording in enumerate(recordings):
        left = MOST_ROWS
        for part in recording.segments(names):
            stop = min(part.stop, part.start + left)
            if stop - part.start > 2 * bank.margin + 8 * bank.decimation:
                parts.append((index, slice(part.start, stop)))
                left -= stop - part.start
            if left < 3 * bank.margin:
                break
    total = sum(part.stop - part.start - 2 * bank.margin for _, part in parts)
    if not parts or total < 200:
        return None
    step = max(1, bank.decimation // 2, -(-total // MOST_SAMPLES))
    lengths = [part.stop - part.start - 2 * bank.margin for _, part in parts]
    starts = np.concatenate([[0], np.cumsum(lengths)])
    picked = [np.arange(0, length, step) for length in lengths]
    at = np.concatenate([start + own for start, own in zip(starts[:-1], picked, strict=True)])
    first_of, last_of = (
        np.concatenate([np.full(len(own), end) for end, own in zip(ends, picked, strict=True)])
        for ends in (starts[:-1], starts[1:])
    )
    signals: dict[tuple[str, int], Signal] = {}
    dense: dict[tuple[str, int], Signal] = {}
    places = {joint.name: number for number, joint in enumerate(machine.joints)}
    external = np.zeros((len(at), len(places)))
    for channel in machine.channels:
        if channel.name not in names or channel.joint is None:
            continue
        smooth = [bank.smooth(recordings[i].values[channel.name][part]) for i, part in parts]
        value, first, second = (np.concatenate([own[k] for own in smooth]) for k in range(3))
        noise = white_noise_of([recordings[i].values[channel.name][part] for i, part in parts])
        if channel.quantity == "external_force":
            external[:, places[channel.joint]] = value[at]
        elif channel.quantity in POSITIONS or channel.quantity in EFFORTS:
            key, speed_noise = (channel.quantity, places[channel.joint]), bank.speed_noise(noise)
            dense[key] = Signal(value, first, second, noise, speed_noise)
            signals[key] = Signal(value[at], first[at], second[at], noise, speed_noise)
    numbers = np.concatenate([np.full(len(own), i) for (i, _), own in zip(parts, picked, strict=True)])
    time = np.concatenate([bank.trimmed(recordings[i].time[part])[::step] for i, part in parts])
    roles = np.array([recording.role != "unloaded" for recording in recordings])
    used = np.ones(len(at), dtype=bool)
    return Samples(machine, signals, dense, at, first_of, last_of, numbers, time, roles[numbers], external, used, bank)


def _bank(machine: Machine, recordings: Sequence[Recording], names: Sequence[str]) -> FilterBank:
    """Build filters of five times the motion's own frequency, as an identification takes them."""
    rate = machine.rate_hz
    smooth = filter_bank(rate, min(8.0, rate / 8))
    edges = []
    for channel in machine.channels:
        if channel.quantity not in POSITIONS or channel.name not in names:
            continue
        for recording in recordings[:3]:
            parts = [p for p in recording.segments([channel.name]) if p.stop - p.start > 4 * smooth.margin][:3]
            parts = [slice(p.start, min(p.stop, p.start + MOST_ROWS)) for p in parts]
            values = [recording.values[channel.name][part] for part in parts]
            if values:
                speeds = [smooth.smooth(own)[1] for own in values]
                edges.append(edge_frequency(speeds, rate, 0.99, white_noise_of(values), smooth.first))
    motion = float(np.median([e for e in edges if e > 0])) if any(e > 0 for e in edges) else 0.0
    least = min(_LEAST_BANDWIDTH, rate / 8)
    return filter_bank(rate, float(np.clip(_BANDWIDTH_FACTOR * motion, least, min(rate / 8, 20.0))))


def _moving(speed: FloatArray, noise: float) -> BoolArray:
    """Return where an element moves."""
    size = np.abs(speed)
    top = float(np.percentile(size, 98)) if len(size) else 0.0
    return np.asarray(size > max(_MOVES * top, _OF_NOISE * noise))


@dataclass(frozen=True)
class Motion:
    """Motion of joints (T, n) and of what drives them; ``r`` the lever arm, 1 without a cylinder."""

    q: FloatArray
    qd: FloatArray
    qdd: FloatArray
    x: FloatArray
    v: FloatArray
    a: FloatArray
    r: FloatArray
    speed_noise: FloatArray
    active: BoolArray


def positions_of(machine: Machine, samples: Samples) -> tuple[str, ...]:
    """Return which position sensor is used of each joint: its own, else the piston's."""
    return tuple(
        "joint_position" if samples.get("joint_position", number) is not None else "piston_position"
        for number in range(len(machine.joints))
    )


def motion_of(machine: Machine, samples: Samples, positions: Sequence[str]) -> Motion:
    """Compute all joints' motion from the sensor chosen for each; in `unloaded` the piston's own."""
    count = len(samples)
    columns: dict[str, list[FloatArray]] = {key: [] for key in ("q", "qd", "qdd", "x", "v", "a", "r")}
    noises, active = [], []
    for number, joint in enumerate(machine.joints):
        signal = samples.get(positions[number], number)
        if signal is None:
            signal = Signal(np.full(count, np.mean(joint.limits.position)), np.zeros(count), np.zeros(count))
        own = (signal.value, signal.first, signal.second)
        noise = signal.speed_noise
        if joint.cylinder is None:
            q, x, r = own, own, np.ones(count)
        else:
            linkage = joint.cylinder.linkage
            piston = samples.get("piston_position", number)
            at_piston = positions[number] == "piston_position"
            q, x = (joint_motion(joint, *own), own) if at_piston else (own, piston_motion(linkage, *own))
            r = lever_arm(linkage, q[0])
            if not at_piston:
                noise *= float(np.sqrt(np.mean(r**2)))
            if piston is not None and not samples.loaded.all():
                free = ~samples.loaded
                x = (
                    np.where(free, piston.value, x[0]),
                    np.where(free, piston.first, x[1]),
                    np.where(free, piston.second, x[2]),
                )
                middle = float(np.median(q[0][free]))
                q = (np.where(free, middle, q[0]), np.where(free, 0.0, q[1]), np.where(free, 0.0, q[2]))
        for key, value in zip(("q", "qd", "qdd", "x", "v", "a"), (*q, *x), strict=True):
            columns[key].append(value)
        columns["r"].append(np.where(np.abs(r) < 1e-6, 1e-6, r))
        noises.append(noise)
        active.append(_moving(x[1], noise))
    stacked = {key: np.nan_to_num(np.stack(value, axis=1)) for key, value in columns.items()}
    return Motion(**stacked, speed_noise=np.array(noises), active=np.stack(active, axis=1))
