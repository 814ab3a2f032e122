"""The arm's own controller: brings it to the start of a motion, follows the motion, then holds the last pose.

Each joint (or, unpinned, each piston) has a computed-torque loop: its feed-forward is exact and its feedback makes
the tracking error behave as a damped oscillator, driven by what the valves do at random. The closed loop is linear,
so the error is integrated exactly instead of step by step, and position, speed and acceleration belong together to
rounding. The force that such a controller had to apply is then the arm's inverse dynamics at the actual motion.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.linalg import solve_continuous_lyapunov

from daq.machine.machine_file import Machine
from daq.motion_files import Rods
from sim_backends.arrays import FloatArray
from sim_backends.plant.linear_filter import ColouredNoise, second_order
from sim_backends.plant.motion import Motion, SplinePath

Phase = Literal["idle", "moving_to_start", "following", "done"]

LOOP_FREQUENCY = 1.5  # Hz: bandwidth of position loops of such arms
LOOP_DAMPING = 0.7
VALVE_NOISE_TIME = 0.1  # s


@dataclass(frozen=True)
class Reference:
    """A block of what the controller does: positions of joints (pinned) or pistons (unpinned), (n, J)."""

    pinned: bool
    motion_time: FloatArray  # s since the current motion began; negative while there is none
    position: FloatArray
    speed: FloatArray
    acceleration: FloatArray


@dataclass
class _Segment:
    rods: Rods
    path: SplinePath
    steps: int
    phase: Phase
    motion: str
    done: int = 0


class Controller:
    """Follows motions one after the other, in steps of ``dt`` s; a segment takes whole multiples of ``grain`` steps.

    Parameters
    ----------
    travel : array (J, 2)
        Piston positions at the ends of each joint's travel, low to high.
    piston_of : callable
        Piston positions (J,) at joint positions (J,).
    tracking : float
        Standard deviation of the random tracking error over the travel.
    """

    def __init__(
        self,
        machine: Machine,
        travel: FloatArray,
        piston_of: Callable[[FloatArray], FloatArray],
        *,
        tracking: float,
        dt: float,
        grain: int,
        rng: np.random.Generator,
    ) -> None:
        self._machine = machine
        self._dt, self._grain = dt, grain
        self._limits = np.array([joint.limits.position for joint in machine.joints])
        self._speed = np.array([joint.limits.velocity for joint in machine.joints])
        self._acceleration = np.array([joint.limits.acceleration for joint in machine.joints])
        self._travel = travel
        self._x = piston_of
        self._tracking = tracking
        self._noise = ColouredNoise(VALVE_NOISE_TIME, dt, len(machine.joints), rng)
        self._loop = second_order(LOOP_FREQUENCY, LOOP_DAMPING, dt, len(machine.joints))
        self._loop_gain = 1.0 / output_std()
        self.park = self._limits.mean(axis=1)
        self.joints = self.park.copy()  # last joint positions asked for
        self.pistons = self._x(self.park)
        self.pinned = True
        self.phase: Phase = "idle"
        self.motion = ""
        self._queue: deque[_Segment] = deque()

    def place(self, motion: Motion) -> None:
        """Put the arm (or the pistons of the parked arm) at a motion's start, without moving there."""
        self.pinned = motion.rods == "pinned"
        self.joints, self.pistons = self.park.copy(), self._x(self.park)
        index = self._index(motion)
        if self.pinned:
            self.joints[index] = motion.positions[0]
            self.pistons = self._x(self.joints)
        else:
            self.pistons[index] = motion.positions[0]

    def follow(self, motion: Motion, name: str = "", *, at_once: bool = False) -> None:
        """Queue a motion, after what it takes to get to its start (nothing if ``at_once``).

        To unpin the rods the arm is parked first; to pin them the pistons are brought back to where the pins fit.
        """
        pinned = motion.rods == "pinned"
        was_pinned, joints, pistons = self._after_queue()
        index = self._index(motion)
        if pinned:
            start = joints.copy()
            start[index] = motion.positions[0]
            if not at_once:
                if not was_pinned:
                    self._move("unpinned", pistons, self._x(joints), name)
                self._move("pinned", joints, start, name)
        else:
            if was_pinned and not at_once:
                self._move("pinned", joints, self.park, name)
                joints, pistons = self.park, self._x(self.park)
            start = pistons.copy()
            start[index] = motion.positions[0]
            if not at_once:
                self._move("unpinned", pistons, start, name)
        positions = np.tile(start, (len(motion.time), 1))
        positions[:, index] = motion.positions
        self._append(motion.rods, SplinePath(motion.time, positions), "following", name)

    def _index(self, motion: Motion) -> list[int]:
        names = [joint.name for joint in self._machine.joints]
        return [names.index(name) for name in motion.joints]

    def _after_queue(self) -> tuple[bool, FloatArray, FloatArray]:
        """Return pinned or not, joint and piston positions once all that is queued is done."""
        pinned, joints, pistons = self.pinned, self.joints, self.pistons
        for segment in self._queue:
            end = segment.path(np.array([segment.path.duration]))[0][0]
            pinned = segment.rods == "pinned"
            joints, pistons = (end, self._x(end)) if pinned else (joints, end)
        return pinned, joints, pistons

    def _append(self, rods: Rods, path: SplinePath, phase: Phase, name: str) -> None:
        steps = int(np.ceil(path.duration / self._dt / self._grain - 1e-9)) * self._grain
        self._queue.append(_Segment(rods, path, steps, phase, name))

    def _move(self, rods: Rods, start: FloatArray, end: FloatArray, name: str) -> None:
        """Plan a minimum-jerk move: peak speed 15/8, peak acceleration 10/sqrt(3) of the mean."""
        distance = np.abs(end - start)
        speed, acceleration = self._speed, self._acceleration
        if rods == "unpinned":
            lever = (self._travel[:, 1] - self._travel[:, 0]) / (self._limits[:, 1] - self._limits[:, 0])
            speed, acceleration = speed * lever, acceleration * lever
        longest = max(
            float(np.max(1.875 * distance / speed)), float(np.sqrt(np.max(5.7735 * distance / acceleration))), 0.2
        )
        s = np.linspace(0.0, 1.0, 41)
        shape = s**3 * (10 - 15 * s + 6 * s**2)
        path = SplinePath(1.2 * longest * s, start + shape[:, None] * (end - start))
        self._append(rods, path, "moving_to_start", name)

    @property
    def remaining(self) -> int:
        """Steps until the current segment ends; 0 when the arm holds its pose."""
        return self._queue[0].steps - self._queue[0].done if self._queue else 0

    def advance(self, n: int) -> Reference:
        """Advance ``n`` steps; they must not reach beyond the current segment (see :attr:`remaining`)."""
        if self._queue:
            segment = self._queue[0]
            if n > self.remaining:
                raise ValueError(f"{n} steps reach beyond the current segment ({self.remaining} left)")
            self.phase, self.motion, self.pinned = segment.phase, segment.motion, segment.rods == "pinned"
            time = np.arange(segment.done + 1, segment.done + n + 1, dtype=np.float64) * self._dt
            position, speed, acceleration = segment.path(time)
            motion_time = time if segment.phase == "following" else np.full(n, -1.0, dtype=np.float64)
            segment.done += n
            if self.pinned:
                self.joints, self.pistons = position[-1], self._x(position[-1])
            else:
                self.pistons = position[-1]
            if segment.done >= segment.steps:
                self._queue.popleft()
        else:
            if self.phase in ("following", "moving_to_start"):
                self.phase = "done"
            hold = self.joints if self.pinned else self.pistons
            position = np.tile(hold, (n, 1))
            speed, acceleration = np.zeros_like(position), np.zeros_like(position)
            motion_time = np.full(n, -1.0, dtype=np.float64)
        error, rate, change = self._loop(self._noise(n))
        span = (self._limits if self.pinned else self._travel) @ np.array([-1.0, 1.0])
        scale = self._tracking * self._loop_gain * span
        return Reference(
            self.pinned, motion_time, position + scale * error, speed + scale * rate, acceleration + scale * change
        )


def output_std() -> float:
    """Compute the loop output's stationary deviation for unit coloured noise (continuous Lyapunov equation)."""
    w = 2 * np.pi * LOOP_FREQUENCY
    rate = 1.0 / VALVE_NOISE_TIME
    A = np.array([[0.0, 1.0, 0.0], [-(w**2), -2 * LOOP_DAMPING * w, w**2], [0.0, 0.0, -rate]])
    Q = np.diag([0.0, 0.0, 2.0 * rate])
    return float(np.sqrt(solve_continuous_lyapunov(A, -Q)[0, 0]))
