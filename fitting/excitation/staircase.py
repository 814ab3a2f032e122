"""A staircase of constant speeds, out and back at each: where nothing accelerates, the force over the speed is the
friction curve itself.
"""

from __future__ import annotations

from itertools import chain, pairwise

import numpy as np

from daq.errors import InputError
from fitting.arrays import FloatArray

LEVEL_SECONDS = 2.5  # what a level gets at least
SLOWEST = 0.03  # of the top speed
_SHORTEST_RAMP = 0.2  # s: several samples at 50 Hz, so that a controller can follow


def staircase(
    time: FloatArray,
    seconds: float,
    levels: int,
    half: float,
    top_speed: float,
    top_acceleration: float,
    slowest: float = SLOWEST,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Make constant speeds, slow to fast: from the middle out to one side, over to the other, and back.

    Fast levels run the whole stroke, as often as their share of the time allows, or once if it takes no more than 40 %
    of what is left; slower ones share the rest.
    Between speeds ``v0`` and ``v1`` the speed follows ``v0 + (v1 - v0) (10 s^3 - 15 s^4 + 6 s^5)``, whose steepest
    slope is ``1.875 (v1 - v0) / duration``.

    Parameters
    ----------
    time : shape (N,), s from the start of the staircase
    seconds : what it may last; it ends at rest in the middle, where it started
    levels : number of speeds, in equal ratios
    half : way from the middle to either end, rad or m
    top_speed, top_acceleration : limits, per second and per second squared
    slowest : slowest speed over ``top_speed``

    Returns
    -------
    tuple of ndarray
        Displacement from the middle, speed and acceleration, each (N,).

    Raises
    ------
    InputError
        If the time is too short for anything to be constant.
    """
    parts: list[list[tuple[float, float]]] = []
    left = seconds
    for place, speed in enumerate(top_speed * np.geomspace(1.0, slowest, levels)):
        speed_held = _speed_with_hold(float(speed), half, top_acceleration)
        whole_stroke = 4 * half / speed_held + 2.25 * _ramp(speed_held, top_acceleration)
        budget = max(left / (levels - place), min(1.001 * whole_stroke, 0.4 * left))
        budget = min(budget, left - (levels - place - 1) * LEVEL_SECONDS)
        part = _level(budget, speed_held, half, top_acceleration)
        left -= sum(duration for duration, _ in part)
        parts.append(part)
    now = 0.0
    knots: list[tuple[float, float]] = [(0.0, 0.0)]  # time, speed; ramps where the speed changes
    for duration, speed in _without_stops(list(chain.from_iterable(reversed(parts)))):
        now += duration
        knots.append((now, speed))
    return _follow(time, knots)


def _without_stops(steps: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Join a cycle and the next, in the same direction, without rest: at rest a speed has no sign.

    ``(t0, 0), (t1, v1)`` after the speed ``v0`` becomes one ramp from ``v0`` to ``v1`` that covers the same way, and so
    lasts ``(v0 t0 + v1 t1) / (v0 + v1)``.
    """
    merged: list[tuple[float, float]] = []
    waiting: tuple[float, float] | None = None  # speed before a stop, duration of the ramp down to it
    for duration, speed in steps:
        if speed == 0.0:
            waiting = merged[-1][1], duration
        elif waiting is not None:
            before, down = waiting
            merged.append(((before * down + speed * duration) / (before + speed), speed))
            waiting = None
        else:
            merged.append((duration, speed))
    if waiting is not None:
        merged.append((waiting[1], 0.0))
    return merged


def _ramp(speed: float, top_acceleration: float) -> float:
    return max(1.875 * speed / top_acceleration, _SHORTEST_RAMP)


def _speed_with_hold(speed: float, half: float, top_acceleration: float) -> float:
    """Return ``speed``, or the highest below it that is held for a while between stroke ends."""
    while half / speed - 1.1875 * _ramp(speed, top_acceleration) < _ramp(speed, top_acceleration) / 2:
        speed *= 0.95
    return speed


def _level(seconds: float, speed: float, half: float, top_acceleration: float) -> list[tuple[float, float]]:
    """Make one level as (duration, end speed): cycles out, over and back, at ``speed`` or the highest possible.

    A cycle of period ``P``: ramp 0 to v (``t``), hold ``a``, reverse (``2 t``), hold ``b``, reverse (``2 t``), hold
    ``a``, ramp v to 0 (``t``). Half a reversal covers ``0.6875 v t``, a ramp from rest ``0.5 v t``, so the turn is ``v
    (a + 1.1875 t)`` from the middle; the cycle closes with ``b = 2 a + t``, hence ``P = 4 a + 7 t``.
    """
    while True:
        ramp = _ramp(speed, top_acceleration)
        hold = half / speed - 1.1875 * ramp  # all of the stroke, or what there is time for
        hold = min(hold, (seconds - 7 * ramp) / 4)
        if hold >= ramp / 2:
            break
        speed *= 0.9  # nothing would be constant any more
        if speed < 1e-3 * half / seconds:
            raise InputError("fitting.seconds_level_too_short", seconds=seconds)
    cycles = int(seconds / (4 * hold + 7 * ramp) + 1e-9)
    cycle = [
        (ramp, speed),
        (hold, speed),
        (2 * ramp, -speed),
        (2 * hold + ramp, -speed),
        (2 * ramp, speed),
        (hold, speed),
        (ramp, 0.0),
    ]
    return cycle * cycles


def _follow(time: FloatArray, knots: list[tuple[float, float]]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Integrate displacement, speed and acceleration of a piston from rest at 0; exact for the ramps."""
    x, xd, xdd = np.zeros((3, time.size))
    position = 0.0
    for (t0, v0), (t1, v1) in pairwise(knots):
        inside = (time >= t0) & (time <= t1 + 1e-12)
        duration, step = t1 - t0, v1 - v0
        s = (time[inside] - t0) / duration
        x[inside] = position + duration * (v0 * s + step * (2.5 * s**4 - 3 * s**5 + s**6))
        xd[inside] = v0 + step * (10 * s**3 - 15 * s**4 + 6 * s**5)
        xdd[inside] = step / duration * 30 * (s**2 - 2 * s**3 + s**4)
        position += duration * (v0 + step / 2)
    x[time > knots[-1][0]] = position
    return x, xd, xdd
