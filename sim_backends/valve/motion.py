"""Programmes of the simulated controller for its valves: phases, one after the other.

A programme is for one machine; each phase gives what every axis is sent in every cycle of the controller (50 Hz), from
where its pistons are. Commands are fractions of full. Whatever it gives, no axis is driven on towards an end of its
travel that it is near.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim_backends.arrays import FloatArray

NEAR = 0.04  # of the travel: how near to its end an axis may come, beside what it goes until it stops
CAUTION = 0.5  # largest command of a move to a pose
PULL = 4.0  # 1/s: speed wanted per distance left
THERE = 0.02  # of the travel: a pose is reached


@dataclass(frozen=True)
class Guess:
    """Knowledge of an axis that the controller's people have before anything was identified.

    ``low`` and ``high`` in m are the travel, ``speed`` in m/s what full command gives, ``edge`` its dead band as a
    fraction of full, ``delay`` in s how late it moves.
    """

    low: float
    high: float
    speed: float
    edge: float
    delay: float

    def command(self, speed: float) -> float:
        """Compute the command for a speed in m/s by a straight line beyond the dead band."""
        if abs(speed) < 0.01 * self.speed:
            return 0.0
        return float(np.clip(np.sign(speed) * (self.edge + (1 - self.edge) * abs(speed) / self.speed), -1.0, 1.0))


class Phase:
    """One thing that all axes do; ``command`` is called each cycle until it gives None."""

    def command(self, time: float, x: FloatArray, guesses: Sequence[Guess]) -> list[float] | None:
        """Return commands of all axes ``time`` s into the phase, pistons at ``x`` m; None: it is over."""
        raise NotImplementedError


@dataclass(frozen=True)
class Hold(Phase):
    """Constant commands for so many seconds; 0 is rest with the valves closed."""

    commands: tuple[float, ...]
    seconds: float

    def command(self, time: float, x: FloatArray, guesses: Sequence[Guess]) -> list[float] | None:
        """Return the constants."""
        return None if time >= self.seconds else list(self.commands)


@dataclass(frozen=True)
class GoTo(Phase):
    """Move to a pose, given as fractions of the travel, by simple feedback; gives up after ``patience`` s."""

    pose: tuple[float, ...]
    patience: float = 8.0

    def command(self, time: float, x: FloatArray, guesses: Sequence[Guess]) -> list[float] | None:
        """Compute proportional speed, the dead band added; None once all are there."""
        commands = []
        for at, where, guess in zip(x, self.pose, guesses, strict=True):
            span = guess.high - guess.low
            left = guess.low + where * span - float(at)
            commands.append(0.0 if abs(left) < THERE * span else guess.command(PULL * left))
        if time >= self.patience or not any(commands):
            return None
        return [float(np.clip(u, -CAUTION, CAUTION)) for u in commands]


@dataclass(frozen=True)
class Swing(Phase):
    """A slow sine of the command: ``amplitudes`` of full, ``cycles`` of ``frequency`` Hz."""

    amplitudes: tuple[float, ...]
    frequency: float
    cycles: float

    def command(self, time: float, x: FloatArray, guesses: Sequence[Guess]) -> list[float] | None:
        """Swing, upwards a quarter of a cycle before its peak: the rod swings about where it is."""
        if time * self.frequency >= self.cycles:
            return None
        return [a * float(np.cos(2 * np.pi * self.frequency * time)) for a in self.amplitudes]


@dataclass(frozen=True)
class Follow(Phase):
    """Follow a path of the pistons, sampled at 50 Hz (N, J) in m, by a straight line of the speed and feedback."""

    path: FloatArray
    gain: float = 2.0  # 1/s

    def command(self, time: float, x: FloatArray, guesses: Sequence[Guess]) -> list[float] | None:
        """Follow the speed of the path, with feedback on where it is."""
        row = round(time * 50.0)
        if row + 1 >= len(self.path):
            return None
        speed = (self.path[row + 1] - self.path[row]) * 50.0 + self.gain * (self.path[row] - x)
        return [guess.command(float(v)) for v, guess in zip(speed, guesses, strict=True)]


class Operator:
    """Runs a programme on one machine, cycle by cycle."""

    def __init__(self, phases: Sequence[Phase], guesses: Sequence[Guess], period: float) -> None:
        self._phases, self._guesses, self._period = list(phases), guesses, period
        self._number, self._cycle = 0, 0

    @property
    def done(self) -> bool:
        """True if the programme is over; the valves are then closed."""
        return self._number >= len(self._phases)

    def __call__(self, x: FloatArray) -> list[float]:
        """Compute commands of this cycle for pistons at ``x`` (J,) in m."""
        while not self.done:
            commands = self._phases[self._number].command(self._cycle * self._period, x, self._guesses)
            self._cycle += 1
            if commands is not None:
                return [self._within(u, float(at), g) for u, at, g in zip(commands, x, self._guesses, strict=True)]
            self._number, self._cycle = self._number + 1, 0
        return [0.0] * len(self._guesses)

    @staticmethod
    def _within(u: float, x: float, guess: Guess) -> float:
        near = NEAR * (guess.high - guess.low) + guess.speed * abs(u) * guess.delay
        return 0.0 if (u > 0.0 and x > guess.high - near) or (u < 0.0 and x < guess.low + near) else u


def valve_motion(axis: int, guesses: Sequence[Guess], poses: Sequence[tuple[float, ...]], levels: float) -> list[Phase]:
    """Plan the motion of one axis from which its valve can be identified.

    At each of ``poses`` (of all axes, fractions of the travel) a rest with the valve closed and a staircase of six
    levels of both signs up to ``levels`` of full, each held for three delays and 0.4 s and undone by its opposite; at
    the first also a ladder of 1 % steps around the expected edges, up and down, and three slow sines.
    """
    own, count = guesses[axis], len(guesses)

    def alone(u: float) -> tuple[float, ...]:
        return tuple(u if j == axis else 0.0 for j in range(count))

    held = 3.0 * own.delay + 0.4
    phases: list[Phase] = []
    for number, pose in enumerate(poses):
        phases += [GoTo(pose), Hold(alone(0.0), 10.0 if number == 0 else 4.0)]
        for level in np.linspace(own.edge + 0.06, levels, 6):
            phases += [GoTo(pose), Hold(alone(0.0), 0.6)]
            phases += [Hold(alone(sign * float(level)), held) for sign in (1.0, -1.0)]
        if number == 0:
            for sign in (1.0, -1.0):
                middle = round(own.edge, 2)
                rungs = middle + 0.01 * np.arange(-5, 6)
                up = [Hold(alone(sign * float(u)), 0.4) for u in (*rungs, *rungs[-2::-1])]
                phases += [GoTo(pose), *up]
            span = own.high - own.low
            for amplitude, share in ((0.35, 0.5), (0.55, 0.6), (0.8 * levels, 0.7)):
                # A half-wave of this speed crosses ``share`` of the travel.
                speed = own.speed * max(amplitude - own.edge, 0.05)
                frequency = float(np.clip(speed / (np.pi * share * span), 0.05, 0.4))
                phases += [GoTo(pose), Swing(alone(amplitude), frequency, 1.0)]
    return phases


def joint_motion(guesses: Sequence[Guess], rng: np.random.Generator, level: float) -> list[Phase]:
    """Move all axes at once: random levels up to ``level``, which ask the pump for what it has."""
    count = len(guesses)
    phases: list[Phase] = [GoTo((0.5,) * count)]
    for number in range(10):
        size = rng.uniform(0.5, 1.0, count) * level
        sign = rng.choice([-1.0, 1.0], count) if number % 2 else np.where(np.arange(count) % 2 == 0, 1.0, -1.0)
        seconds = float(rng.uniform(0.8, 1.6))
        phases += [Hold(tuple(float(u) for u in sign * size), seconds), GoTo((0.5,) * count, 4.0)]
        phases.append(Hold((0.0,) * count, float(rng.uniform(0.3, 0.8))))
    return phases


def working_motion(
    guesses: Sequence[Guess], rng: np.random.Generator, seconds: float, share: float = 0.7
) -> list[Phase]:
    """Smooth paths of all axes, as work has them: sums of sines that use ``share`` of the travel or of the speed."""
    time = np.arange(round(seconds * 50.0) + 1) / 50.0
    ramp = np.clip(np.minimum(time, time[-1] - time) / 2.0, 0.0, 1.0)
    fade = ramp**3 * (10 - 15 * ramp + 6 * ramp**2)
    columns = []
    for guess in guesses:
        frequency = rng.uniform(0.06, 0.3, 4)
        phase = rng.uniform(0.0, 2 * np.pi, 4)
        wave = (np.sin(2 * np.pi * frequency * time[:, None] + phase) / (1.0 + 4.0 * frequency)).sum(axis=1) * fade
        rate = float(np.abs(np.gradient(wave, time)).max())
        scale = share * min(0.5 * (guess.high - guess.low) / float(np.abs(wave).max()), guess.speed / rate)
        columns.append(0.5 * (guess.low + guess.high) + scale * wave)
    return [GoTo((0.5,) * len(guesses)), Follow(np.stack(columns, axis=1))]
