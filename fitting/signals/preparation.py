"""From recordings to the smooth motion and the measured drive effort that regressions are built on.

A :class:`Segment` is one gap-free stretch of one recording. Positions are fused where a joint has both kinds: each
weighted by the inverse variance of its own white noise; a measured velocity is fused with the position's derivative
(:mod:`fitting.signals.position_sensors`). The drive effort of a joint with a cylinder is
``p1 A1 - p2 A2`` in N (positive extends), of a joint driven directly its measured effort.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any, Literal

import numpy as np
import scipy

from daq.errors import RecordingError
from daq.machine.machine_file import Joint, Machine
from daq.recordings.recording import Recording
from daq.recordings.recording_checks import long_runs, runs
from fitting.arm.linkage import joint_motion, joint_position, lever_arm, piston_motion
from fitting.arrays import BoolArray, FloatArray
from fitting.signals.filters import FilterBank, advanced
from fitting.signals.position_sensors import (
    REST_SECONDS,
    Motion,
    VelocityShare,
    channel_noise,
    joint_velocity_share,
    piston_weight,
    position_variances,
)

PositionError = Callable[[FloatArray], FloatArray]
#: Play between a joint's two position sensors. In the pin: piston and joint move apart, and each sensor is right for
#: its own. In the piston's sensor: both move as the joint's sensor states.
Play = Literal["pin", "sensor"]

#: A joint is parked where it remains within this share of its reach for so long, s.
STILL, PARKED_SECONDS = 2e-3, 4.0
# A speed below so many times its own noise has no sign worth using; five is the usual margin.
REST_SPEED = 5.0
# The first stretch of a recording that determines at what speed it begins.
_FIRST_SECONDS = 0.2
# Samples of all joints together in one piece of a long recording: 80 s of six joints at 50 Hz, some 24 MB.
PIECE_SAMPLES = 24_000


@dataclass(frozen=True)
class PositionNoise:
    """White noise of one joint's fused position, as seen by the regressors.

    Attributes
    ----------
    position : std of the position that ``x`` and ``v`` come from, in the piston's (or joint's) unit
    speed : std of the smoothed speed ``v``
    acceleration : std of the smoothed acceleration ``a``
    turning : deviation of ``v`` where its sign turns, if more: of motion that the filter takes
    """

    position: float
    speed: float
    acceleration: float
    turning: float = 0.0

    @property
    def sign(self) -> float:
        """Deviation of the speed that expectations of its sign have."""
        return max(self.speed, self.turning)


@dataclass(frozen=True)
class Segment:
    """One gap-free stretch of a recording, smoothed; ``N`` samples at the recording's rate, ``n`` joints.

    Attributes
    ----------
    recording : index among the recordings that were prepared together
    role : role of that recording
    start : row of the recording that sample 0 is
    t : (N,) s
    q, qd, qdd : (N, n) joint motion, rad (m), zero speed where the joint is parked
    x, v, a : (N, n) motion of the driving element: the piston (m), or the joint itself where there is none
    r : (N, n) lever arm dx/dq, m/rad; 1 where there is no cylinder
    effort : (N, n) measured drive effort, unfiltered; N at a piston, the joint's effort unit elsewhere
    p1, p2 : (N, n) smoothed chamber pressures in Pa; NaN where there are none
    rest : (N, n) True where the driving element is at rest
    loaded : False for `unloaded` recordings (F_l = 0)
    temperature : (N,) K, or None
    gap : (N, n) m, smoothed piston position less x(joint position), NaN where one of the two is not measured
    external : (N, n) N, smoothed measured forces from outside the arm, positive against extension; None without any
    lead : (M, n) joint accelerations up to sample 0, over the samples that the filter loses at the start, for what
        remembers them; the machine went on at constant speed, or stood, before. None: it stood
    bridged : (N,) True in rows that hold something made up between measured rows; None: none does
    late : per joint by how many samples its effort was sampled late and was moved; empty: none was
    """

    recording: int
    role: str
    start: int
    t: FloatArray
    q: FloatArray
    qd: FloatArray
    qdd: FloatArray
    x: FloatArray
    v: FloatArray
    a: FloatArray
    r: FloatArray
    effort: FloatArray
    p1: FloatArray
    p2: FloatArray
    rest: BoolArray
    loaded: bool
    temperature: FloatArray | None
    gap: FloatArray
    # Made by a function: a default of the class would be found before what a stored segment reads.
    external: FloatArray | None = field(default_factory=lambda: None)
    lead: FloatArray | None = field(default_factory=lambda: None)
    bridged: BoolArray | None = field(default_factory=lambda: None)
    late: tuple[float, ...] = field(default_factory=tuple)

    def __len__(self) -> int:
        return len(self.t)


def motion_segment(
    machine: Machine, t: Any, moved: Sequence[Any], pistons: Sequence[Any] = (), **others: Any
) -> Segment:
    """Make an unseen motion a segment: numbers, or expressions in their place.

    Parameters
    ----------
    t, moved : times (N,), s; ``q, qd, qdd`` of all joints, (N, n) each
    pistons : motion ``x, v, a`` of what drives them; that which follows from the joints' if empty
    others : fields of the segment in place of those of rods that are on, at no effort and never at rest
    """
    levers = np.ones_like(moved[0])
    driven = [own.copy() for own in moved]
    for number, joint in enumerate(machine.joints):
        if joint.cylinder is not None:
            q, qd, qdd = (own[:, number] for own in moved)
            levers[:, number] = lever_arm(joint.cylinder.linkage, q)
            for own, values in zip(driven, piston_motion(joint.cylinder.linkage, q, qd, qdd), strict=True):
                own[:, number] = values
    unknown = np.full(np.shape(moved[0]), np.nan)
    named = dict(zip(("q", "qd", "qdd", "x", "v", "a"), (*moved, *(pistons or driven)), strict=True))
    named |= {"r": levers, "effort": 0.0 * moved[0], "rest": np.zeros(np.shape(moved[0]), dtype=bool)}
    named |= {"p1": unknown, "p2": unknown, "gap": unknown, "start": 0, "loaded": True, "temperature": None}
    return Segment(**{"t": t} | named | others)


def position_noise(machine: Machine, recordings: Sequence[Recording], bank: FilterBank) -> tuple[PositionNoise, ...]:
    """Estimate each driving element's noise from position channels' high-frequency part."""
    result = []
    for joint in machine.joints:
        variances, shares = [], []
        for recording in recordings:
            sources = position_variances(machine, joint, recording)
            if sources:
                variances.append(1.0 / sum(1.0 / v for v in sources.values()))
            share = joint_velocity_share(machine, joint, recording, bank)
            if share is not None:
                shares.append(share)
        std = float(np.sqrt(np.median(variances))) if variances else 0.0
        speed, acceleration = bank.speed_noise(std), bank.acceleration_noise(std)
        if shares:
            usual = VelocityShare(*np.median([(s.speed, s.acceleration) for s in shares], axis=0).tolist())
            speed, acceleration = usual.noise(speed, acceleration)
        result.append(PositionNoise(std, speed, acceleration))
    return tuple(result)


def position_channel_noise(machine: Machine, recordings: Sequence[Recording]) -> dict[str, float]:
    """Estimate the standard deviation of every motion channel's white noise, SI: median over recordings."""
    result = {}
    for channel in machine.channels:
        if channel.quantity in ("joint_position", "joint_velocity", "piston_position"):
            stds = [channel_noise(recording, channel.name) for recording in recordings]
            result[channel.name] = float(np.median(stds))
    return result


def segments_of(
    machine: Machine,
    recordings: Sequence[Recording],
    bank: FilterBank,
    *,
    noise: Sequence[PositionNoise] | None = None,
    latency: Mapping[str, float] | None = None,
    resampled: Collection[str] = (),
    position_error: Mapping[str, PositionError] | None = None,
    play: Mapping[str, Play] | None = None,
    long: bool = False,
    synthetic: bool = False,
) -> Iterator[Segment]:
    """Smooth all recordings, segment by segment.

    Parameters
    ----------
    machine : the machine (with corrected linkages, if the loop found them wrong)
    recordings : in any order
    bank : filters
    noise : per joint; estimated from the recordings if not given
    latency : joint name to seconds by which its effort channels are late
    resampled : joints whose effort was not sampled late, but passed on late and interpolated
    position_error : joint name to a callable ``q -> error`` that is subtracted from the measured joint position
    play : joints between whose two position sensors there is play, and where: they are not fused
    long : cut stretches into pieces (:func:`pieces`)
    synthetic : nobody could record these again: what is too short for the filters is left out

    Raises
    ------
    RecordingError
        If no segment of a recording is longer than the filters.
    """
    noise = position_noise(machine, recordings, bank) if noise is None else noise
    for index, recording in enumerate(recordings):
        parts = stretches(machine, recording, bank)
        if not parts and not synthetic:
            raise RecordingError(
                "fitting.no_stretch_without_gap", file=recording.file, bank=shortest(bank) / bank.rate_hz
            )
        sensed = tuple(
            _Sensed(
                piston_weight(machine, joint, recording),
                joint_velocity_share(machine, joint, recording, bank),
                (position_error or {}).get(joint.name),
                (play or {}).get(joint.name),
            )
            for joint in machine.joints
        )
        if long:
            most = PIECE_SAMPLES // len(machine.joints)
            parts = [piece for whole in parts for piece in pieces(whole, bank, most)]
        for part in parts:
            segment = _segment(machine, recording.cut(part), index, part.start, bank, noise, sensed)
            yield with_delays(machine, recording, segment, bank, latency, resampled) if latency else segment


def shortest(bank: FilterBank) -> int:
    """Count the rows of the shortest gapless stretch that survives the filters."""
    return 2 * (bank.margin + bank.half) + 4 * bank.decimation + 1


def stretches(machine: Machine, recording: Recording, bank: FilterBank) -> list[slice]:
    """Return the gapless stretches of a recording that survive the filters."""
    used = [channel.name for channel in machine.channels if channel.joint is not None]
    return [part for part in recording.segments(used) if part.stop - part.start >= shortest(bank)]


def pieces(whole: slice, bank: FilterBank, most: int) -> list[slice]:
    """Cut a stretch into pieces of at most about ``most`` samples, overlapping by both filters' loss.

    They start on the decimated grid: together they give the very reduced rows of the whole stretch, each once.
    """
    lost = 2 * (bank.margin + bank.half)
    count = -(-(whole.stop - whole.start - lost) // most)
    step = -(-(whole.stop - whole.start - lost) // count)
    step += -step % bank.decimation
    return [slice(start, min(start + step + lost, whole.stop)) for start in range(whole.start, whole.stop - lost, step)]


@dataclass(frozen=True)
class _Sensed:
    """Weights of a joint's position sensors and velocity channel, the error of its position, and its play."""

    piston_weight: float
    velocity_share: VelocityShare | None
    position_error: PositionError | None
    play: Play | None


def _segment(
    machine: Machine,
    recording: Recording,
    index: int,
    start: int,
    bank: FilterBank,
    noise: Sequence[PositionNoise],
    sensed: Sequence[_Sensed],
) -> Segment:
    """Make the segment of a gapless recording; it starts at row ``start`` of what it was cut from."""
    columns: dict[str, list[Any]] = {
        key: [] for key in ("q", "qd", "qdd", "x", "v", "a", "r", "effort", "p1", "p2", "gap", "rest", "lead")
    }
    before = _with_start(machine, recording, bank)
    for number, joint in enumerate(machine.joints):
        motion, gap = _motion(machine, joint, recording.values, recording.role, bank, sensed[number])
        columns["lead"].append(_motion(machine, joint, before, recording.role, bank, sensed[number])[0][2])
        for key, value in zip(("q", "qd", "qdd", "x", "v", "a"), motion, strict=True):
            columns[key].append(value)
        columns["gap"].append(np.full_like(motion[0], np.nan) if gap is None else gap)
        linkage = joint.cylinder.linkage if joint.cylinder else None
        columns["r"].append(np.ones_like(motion[0]) if linkage is None else lever_arm(linkage, motion[0]))
        measured = _effort(machine, joint, recording, bank, 0.0, columns["r"][-1])
        for key, value in zip(("effort", "p1", "p2"), measured, strict=True):
            columns[key].append(value)
        way = reach(joint, joint.cylinder is not None)
        # At rest for longer than a reversal, by its sensor; or parked, by its reach.
        slow = np.abs(motion[4]) <= REST_SPEED * noise[number].speed
        columns["rest"].append(long_rests(slow, bank.rate_hz) | parked(motion[3], way, bank.rate_hz))
    stacked: dict[str, Any] = {key: np.stack(value, axis=1) for key, value in columns.items()}
    return Segment(
        recording=index,
        role=recording.role,
        start=start + bank.margin,
        t=bank.trimmed(recording.time),
        loaded=recording.role != "unloaded",
        temperature=_temperature(machine, recording, bank),
        external=_external(machine, recording, bank),
        bridged=None if recording.bridged is None else recording.bridged[bank.margin : len(recording) - bank.margin],
        **stacked,
    )


def with_delays(
    machine: Machine,
    recording: Recording,
    segment: Segment,
    bank: FilterBank,
    latency: Mapping[str, float],
    resampled: Collection[str],
) -> Segment:
    """Return a segment of ``recording``, prepared without delays, with some joints' efforts moved in time.

    ``latency`` and ``resampled`` as :func:`segments_of` takes them; the motion is kept.
    """
    moved = with_efforts_of(machine, recording, segment, bank, latency)
    sampled_late = (0.0 if j.name in resampled else latency.get(j.name, 0.0) * bank.rate_hz for j in machine.joints)
    return replace(moved, late=tuple(sampled_late))


def with_efforts_of(
    machine: Machine, recording: Recording, segment: Segment, bank: FilterBank, latency: Mapping[str, float]
) -> Segment:
    """Read the efforts of the joints in ``latency`` (s) anew, of this recording or another of the very same motion."""
    first = segment.start - bank.margin
    recording = recording.cut(slice(first, first + len(segment) + 2 * bank.margin))
    effort, p1, p2 = segment.effort.copy(), segment.p1.copy(), segment.p2.copy()
    for number, joint in enumerate(machine.joints):
        if joint.name in latency:
            late, lever = latency[joint.name], segment.r[:, number]
            own = _effort(machine, joint, recording, bank, late, lever)
            effort[:, number], p1[:, number], p2[:, number] = own
    return replace(segment, effort=effort, p1=p1, p2=p2)


def _with_start(machine: Machine, recording: Recording, bank: FilterBank) -> dict[str, FloatArray]:
    """Prepend a straight line to a motion's channels: smoothed, they give the samples up to the first."""
    count = max(2, round(_FIRST_SECONDS * bank.rate_hz))
    values = {}
    for channel in machine.channels:
        if channel.quantity in ("joint_position", "piston_position"):
            own = recording.values[channel.name]
            first = own[:count]
            line = np.polynomial.Polynomial.fit(np.arange(len(first)), first, 1)
            values[channel.name] = np.concatenate([line(np.arange(-bank.margin, 0)), own[: 2 * bank.margin]])
        elif channel.quantity == "joint_velocity":
            own = recording.values[channel.name]
            values[channel.name] = np.concatenate([np.full(bank.margin, own[:count].mean()), own[: 2 * bank.margin]])
    return values


def _temperature(machine: Machine, recording: Recording, bank: FilterBank) -> FloatArray | None:
    """Return a segment's oil temperature; None where not measured all along."""
    channel = next((c for c in machine.channels if c.quantity == "oil_temperature"), None)
    values = None if channel is None else recording.values.get(channel.name)
    return None if values is None or not np.isfinite(values).all() else bank.smoothed(values)


def _external(machine: Machine, recording: Recording, bank: FilterBank) -> FloatArray | None:
    """Return outside forces by load cells, (N, n), zero where there is none; None for a machine without."""
    channels = [machine.channel("external_force", joint.name) for joint in machine.joints]
    if not any(channels):
        return None
    nothing = np.zeros(len(recording) - 2 * bank.margin)
    forces = [nothing if c is None else bank.smoothed(recording.values[c.name]) for c in channels]
    return np.stack(forces, axis=1)


def _motion(
    machine: Machine,
    joint: Joint,
    values: Mapping[str, FloatArray],
    role: str,
    bank: FilterBank,
    sensed: _Sensed,
) -> tuple[tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray], FloatArray | None]:
    """Smooth ``q, qd, qdd, x, v, a`` of a joint and its gap, of gapless channels; None without two sensors."""
    share = sensed.velocity_share
    angle = machine.channel("joint_position", joint.name)
    piston = machine.channel("piston_position", joint.name)
    speed = machine.channel("joint_velocity", joint.name)
    q_raw = None if angle is None else values[angle.name]
    if q_raw is not None and sensed.position_error is not None:
        q_raw = q_raw - sensed.position_error(q_raw)

    def fused(motion: Motion) -> Motion:
        if share is None or speed is None:
            return motion
        return share.fused(motion, values[speed.name], bank)

    if joint.cylinder is None:
        assert q_raw is not None  # the machine file guarantees a position
        motion = fused(bank.smooth(q_raw))
        return (*motion, *motion), None
    linkage = joint.cylinder.linkage
    if piston is None:
        assert q_raw is not None
        motion = fused(bank.smooth(q_raw))
        return (*motion, *piston_motion(linkage, *motion)), None
    x_raw = values[piston.name]
    smooth_x = bank.smooth(x_raw)
    if role == "unloaded":
        # The rod is off its pin: the joint is where its encoder states (or mid-range), the piston moves alone.
        parked = np.mean(joint.limits.position) if q_raw is None else float(np.mean(q_raw))
        q = np.full_like(smooth_x[0], parked)
        return (q, np.zeros_like(q), np.zeros_like(q), *smooth_x), None
    if q_raw is None:
        motion = fused(joint_motion(joint, *smooth_x))
        return (*motion, *(smooth_x if share is None else piston_motion(linkage, *motion))), None
    gap = smooth_x[0] - bank.smoothed(linkage.piston_position(q_raw))
    if sensed.play == "pin":
        return (*fused(bank.smooth(q_raw)), *smooth_x), gap
    fraction = 0.0 if sensed.play == "sensor" else sensed.piston_weight
    motion = fused(bank.smooth((1 - fraction) * q_raw + fraction * joint_position(joint, x_raw)))
    return (*motion, *piston_motion(linkage, *motion)), gap


def _effort(
    machine: Machine, joint: Joint, recording: Recording, bank: FilterBank, latency: float, lever: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return measured drive effort (unfiltered, trimmed), smoothed chamber pressures (NaN where unmeasured).

    What was measured as a torque is divided by the ``lever`` (N,) of the joint's cylinder.
    """

    @cache
    def channel(quantity: str) -> FloatArray | None:
        found = machine.channel(quantity, joint.name)
        return None if found is None else advanced(recording.values[found.name], latency * bank.rate_hz)

    effort = drive_effort(joint, channel)
    if effort is None:
        raise RecordingError("fitting.no_effort_channel", file=recording.file, joint=joint.name)
    effort, head, rod = bank.trimmed(effort), channel("head_pressure"), channel("rod_pressure")
    if joint.cylinder is not None and head is not None and rod is not None:
        return effort, bank.smoothed(head), bank.smoothed(rod)
    torque, nothing = joint.cylinder is not None and channel("cylinder_force") is None, np.full_like(effort, np.nan)
    return effort / lever if torque else effort, nothing, nothing


def drive_effort(joint: Joint, channel: Callable[[str], FloatArray | None]) -> FloatArray | None:
    """Compute the effort of a joint's drive in N or N m: of both pressures if measured; None if nothing is.

    Parameters
    ----------
    channel : the joint's measured values of a quantity, or None
    """
    head, rod = channel("head_pressure"), channel("rod_pressure")
    if joint.cylinder is not None and head is not None and rod is not None:
        return head * joint.cylinder.head_area - rod * joint.cylinder.rod_area
    for quantity in ("cylinder_force", "joint_effort"):
        measured = channel(quantity)
        if measured is not None:
            return measured
    return None


def parked(x: FloatArray, reach: float, rate_hz: float) -> BoolArray:
    """Find rows (N,) with a position within :data:`STILL` of the joint's reach for :data:`PARKED_SECONDS`.

    A joint that is held trembles while others move, by more than its sensor's noise.
    """
    window = min(max(1, round(PARKED_SECONDS * rate_hz)), len(x))
    # The range of the window that begins at each row.
    high = scipy.ndimage.maximum_filter1d(x, window, origin=-(window // 2))[: len(x) - window + 1]
    low = scipy.ndimage.minimum_filter1d(x, window, origin=-(window // 2))[: len(x) - window + 1]
    rows = np.zeros(len(x), dtype=bool)
    for run in runs(high - low < STILL * reach):
        rows[run.start : run.stop + window - 1] = True
    return rows


def reach(joint: Joint, piston: bool) -> float:
    """Return how far a joint goes, or its piston: rad or m."""
    if piston and joint.cylinder is not None:
        return joint.cylinder.stroke
    return float(np.ptp(joint.limits.position))


def long_rests(slow: BoolArray, rate_hz: float) -> BoolArray:
    """Keep samples (N,) of a slow element that are no mere reversal."""
    return long_runs(slow, REST_SECONDS * rate_hz)
