"""Work of the drives in a motion: what they put in, what comes back, what friction takes.

Power is the drive's effort times its speed. Work is linear in the parameters, so its standard deviation follows from
their covariance. Hydraulic losses in valves and pump are not the arm's, and no part of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from daq.recordings.recording import Recording
from fitting.arrays import FloatArray
from fitting.model import motion
from fitting.model.arm_model import ArmModel
from fitting.model.evaluation import Evaluated, evaluate, without
from fitting.model.prediction import on_recording
from fitting.model.uses.feedforward import Trajectory


@dataclass(frozen=True)
class Energy:
    """Work of all drives in a motion, J: (n,) each.

    Attributes
    ----------
    joints : names
    seconds : length of the motion
    given : work while the drive pushes the way it moves, and its standard deviation
    given_std : of the parameters
    returned : work that comes back while the load drives the drive, 0 or more
    friction : what of the work given friction takes
    measured : work given by the measured efforts; None of a motion that nobody measured
    """

    joints: tuple[str, ...]
    seconds: float
    given: FloatArray
    given_std: FloatArray
    returned: FloatArray
    friction: FloatArray
    measured: FloatArray | None


def energy_of_motion(model: ArmModel, path: Trajectory, temperature: float | None = None) -> Energy:
    """Compute a motion's work by the model; ``temperature`` of the oil in K, for laws of it."""
    found = motion.on_motion(model, path.q, path.qd, path.qdd, path.t, temperature=temperature)
    return _energy(model, found, measured=False)


def energy_of_recording(model: ArmModel, recording: Recording) -> Energy:
    """Compute a recorded motion's work, by model and by measurement; rows lost at gaps are in neither.

    Raises
    ------
    RecordingError
        If it has no stretch that is long enough.
    """
    found, _ = on_recording(model, recording)
    return _energy(model, found, measured=True)


def _energy(model: ArmModel, found: Evaluated, *, measured: bool) -> Energy:
    n, dt = len(model.joints), 1.0 / model.machine.rate_hz
    alone = without(found.model, motion.left_out(found.model))  # what sensors add does no work
    found = evaluate(alone, found.design.segments, found.starts)
    given, returned, lost, seen, variance = (np.zeros(n) for _ in range(5))
    for index, segment in enumerate(found.design.segments):
        power = found.drive_effort(index) * segment.v
        pushing = power > 0
        given += dt * np.where(pushing, power, 0.0).sum(axis=0)
        returned -= dt * np.where(pushing, 0.0, power).sum(axis=0)
        friction = motion.friction(model, segment.q, segment.qd, temperature=segment.temperature) / segment.r
        lost += dt * (friction * segment.v).sum(axis=0)
        own = segment.effort * segment.v
        seen += dt * np.where(own > 0, own, 0.0).sum(axis=0)
        variance += found.sum_variance(index, dt * np.where(pushing, segment.v, 0.0))
    seconds = dt * sum(len(segment) for segment in found.design.segments)
    return Energy(model.joints, seconds, given, np.sqrt(variance), returned, lost, seen if measured else None)
