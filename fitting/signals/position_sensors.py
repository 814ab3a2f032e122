"""How well a joint's motion is measured: noise of its position sensors, and what each of them weighs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from daq.machine.machine_file import Channel, Joint, Machine
from daq.recordings.recording import Recording
from daq.recordings.recording_checks import long_runs, runs
from fitting.arm.linkage import cylinder_of, joint_position, lever_arm
from fitting.arrays import BoolArray, FloatArray
from fitting.signals.filters import FilterBank, white_noise_of

Motion = tuple[FloatArray, FloatArray, FloatArray]

_TINY = 1e-300
#: Rest shorter than this, s, is a reversal; the expected sign (:mod:`fitting.arm.expected`) handles it.
REST_SECONDS = 0.3
#: Rows that a fourth difference needs beside its own, and the share of a channel's rows that determine its noise.
_TAPS, _LEAST = 4, 0.05


@dataclass(frozen=True)
class VelocityShare:
    """Weight of the velocity channel, 0 to 1, in a joint's speed and in its acceleration.

    Two sources state how fast a joint turns: the smoothed position's derivative, with its white noise through
    the first derivative's kernel, and the smoothed velocity channel, with its own noise through the smoothing kernel.
    They are averaged with the inverse of their variances; accelerations likewise, one derivative higher.

    A velocity channel may also have a gain, a delay or a filter of its own, which no noise estimate sees. The
    derivative of the position has neither, and the arm's geometry hangs on positions; so what the two disagree by
    beyond the noise of both, and beyond what chance makes of that (two standard deviations of a mean square, with two
    independent samples per period of the smoothing filter's cut-off), is counted as the velocity's variance. A channel
    that is late or scaled wrong thus loses its weight instead of bending the motion.
    """

    speed: float
    acceleration: float

    def fused(self, motion: Motion, velocity: FloatArray, bank: FilterBank) -> Motion:
        """Fuse the measured velocity into a joint's motion.

        Parameters
        ----------
        motion : (N,) position, speed and acceleration from the position
        velocity : (N + 2 bank.margin,) measured velocity, rad/s (m/s)
        """
        q, qd, qdd = motion
        speed, acceleration = bank.smooth(velocity)[:2]
        return q, qd + self.speed * (speed - qd), qdd + self.acceleration * (acceleration - qdd)

    def noise(self, speed: float, acceleration: float) -> tuple[float, float]:
        """Compute standard deviations of fused speed and acceleration from those of the position's derivatives.

        With weights by inverse variances the variance that is left is the other's share of the position's.
        """
        return speed * np.sqrt(1.0 - self.speed), acceleration * np.sqrt(1.0 - self.acceleration)


def velocity_share(
    position: FloatArray,
    velocity: FloatArray,
    parts: Sequence[slice],
    bank: FilterBank,
    position_std: float,
    velocity_std: float,
) -> VelocityShare:
    """Compute weights of a velocity channel over gapless ``parts`` of a recording.

    Parameters
    ----------
    position, velocity : (N,) measured, rad and rad/s (m and m/s)
    position_std, velocity_std : their white noise
    """
    smoothing = float(np.linalg.norm(bank.value))
    ours = (bank.speed_noise(position_std) ** 2, bank.acceleration_noise(position_std) ** 2)
    theirs = ((smoothing * velocity_std) ** 2, bank.speed_noise(velocity_std) ** 2)
    squares, count = np.zeros(2), 0
    for part in parts:
        if part.stop - part.start <= 2 * bank.margin:
            continue
        measured, derived = bank.smooth(velocity[part])[:2], bank.smooth(position[part])[1:]
        squares += [float(np.sum((a - b) ** 2)) for a, b in zip(measured, derived, strict=True)]
        count += len(measured[0])
    independent = max(1.0, 2.0 * min(5 / 3 * bank.bandwidth_hz / bank.rate_hz, 0.45) * count)
    chance = 1.0 + 2.0 * np.sqrt(2.0 / independent)
    shares = []
    for square, own, other in zip(squares, ours, theirs, strict=True):
        beyond = max(0.0, square / max(count, 1) - chance * (own + other))
        shares.append(own / max(own + other + beyond, _TINY))
    return VelocityShare(*shares)


def position_channel(machine: Machine, joint: Joint) -> Channel | None:
    """Return a joint's position channel, else its piston's; None where only its motor measures it."""
    return machine.channel("joint_position", joint.name) or machine.channel("piston_position", joint.name)


def joint_velocity_share(
    machine: Machine, joint: Joint, recording: Recording, bank: FilterBank
) -> VelocityShare | None:
    """Return the joint velocity channel's weight; None without one, or with the rod off its pin."""
    speed = machine.channel("joint_velocity", joint.name)
    if speed is None or (joint.cylinder is not None and recording.role == "unloaded"):
        return None
    angle = machine.channel("joint_position", joint.name)
    piston = machine.channel("piston_position", joint.name)
    places, positions = [speed.name], []
    for channel in (angle, piston):
        if channel is not None:
            places.append(channel.name)
            values = recording.values[channel.name]
            positions.append(values if channel is angle else joint_position(joint, values))
    weight = piston_weight(machine, joint, recording)
    q = positions[0] if len(positions) == 1 else (1 - weight) * positions[0] + weight * positions[1]
    std = np.sqrt(1.0 / sum(1.0 / v for v in position_variances(machine, joint, recording).values()))
    if joint.cylinder is not None:
        std /= np.sqrt(np.nanmean(lever_arm(joint.cylinder.linkage, q) ** 2))
    velocity = recording.values[speed.name]
    parts = recording.segments(places)
    return velocity_share(q, velocity, parts, bank, float(std), channel_noise(recording, speed.name))


def piston_weight(machine: Machine, joint: Joint, recording: Recording) -> float:
    """Compute the piston sensor's weight beside the joint's; NaN where there is nothing to fuse."""
    variances = position_variances(machine, joint, recording)
    if len(variances) < 2:
        return np.nan
    return variances["joint"] / (variances["joint"] + variances["piston"])


def piston_of(machine: Machine, joint: Joint, recording: Recording) -> FloatArray:
    """Return a joint's piston position (N,), m: of both sensors where two, each by its noise.

    Where the joint's sensor puts the rod somewhere else by a constant, that changes no speed.
    """
    angle, piston = (machine.channel(q, joint.name) for q in ("joint_position", "piston_position"))
    found = []
    if angle is not None:
        found.append(cylinder_of(joint).linkage.piston_position(recording.values[angle.name]))
    if piston is not None:
        found.append(recording.values[piston.name])
    if len(found) == 1:
        return np.asarray(found[0], dtype=float)
    weight = piston_weight(machine, joint, recording)
    return np.asarray((1.0 - weight) * found[0] + weight * found[1])


def position_variances(machine: Machine, joint: Joint, recording: Recording) -> dict[str, float]:
    """Return white-noise variances of usable position sensors, in the piston's unit squared."""
    angle = machine.channel("joint_position", joint.name)
    piston = machine.channel("piston_position", joint.name)
    result = {}
    if piston is not None:
        result["piston"] = max(channel_noise(recording, piston.name) ** 2, 1e-18)
    if angle is not None and (recording.role != "unloaded" or piston is None):
        values = recording.values[angle.name]
        values = values[np.isfinite(values)]
        scale = 1.0
        if joint.cylinder is not None:
            scale = float(np.sqrt(np.mean(lever_arm(joint.cylinder.linkage, values) ** 2)))
        result["joint"] = max((scale * channel_noise(recording, angle.name)) ** 2, 1e-18)
    return result


def channel_noise(recording: Recording, channel: str) -> float:
    """Estimate a channel's white noise where measured and not constant, between gaps.

    Where that leaves next to nothing (every fourth row lost), of all that is there.
    """
    values = recording.values[channel]
    there = np.isfinite(values) & ~held(values, recording.rate_hz)
    if recording.bridged is not None:
        there &= ~recording.bridged
    parts = runs(there, recording.joined)
    if sum(max(part.stop - part.start - _TAPS, 0) for part in parts) < _LEAST * len(values):
        parts = recording.segments([channel])
    return white_noise_of([values[part] for part in parts])


def reading_error(recordings: Sequence[Recording], channel: str) -> tuple[float, float]:
    """Estimate a channel's white noise and rounding steps (0 or next to it without any)."""
    std = float(np.median([channel_noise(recording, channel) for recording in recordings]))
    changes = np.concatenate([np.abs(np.diff(recording.values[channel])) for recording in recordings])
    changes = changes[np.isfinite(changes) & (changes > 1e-12)]
    return std, float(np.quantile(changes, 0.01)) if len(changes) else 0.0


def rounded_noise(position: FloatArray, error: tuple[float, float], rng: np.random.Generator) -> FloatArray:
    """Return readings less position (N,) of a sensor of such noise and steps: slow motion makes them no noise."""
    std, step = error
    white = np.sqrt(max(std**2 - step**2 / 12.0, 0.0))
    reading = position + white * rng.standard_normal(len(position)) + step * rng.uniform()
    return np.asarray((np.round(reading / step) * step if step > 0 else reading) - position)


def held(values: FloatArray, rate_hz: float) -> BoolArray:
    """Find rows (N,) whose value is constant for longer than a reversal takes: an encoder at rest is silent."""
    same = long_runs(np.diff(values, prepend=np.nan) == 0, REST_SECONDS * rate_hz)
    same[:-1] |= same[1:]  # and the row that the first of a run is the same as
    return same
