"""Paths followed through identified inverses: what the simulated controller gains by them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.valve.drawing import ValveKey, order_of
from benchmarks.valve.judging import Answer
from daq.machine.machine_file import load_machine
from sim_backends.valve.motion import Follow, working_motion
from sim_backends.valve.tracking import Control, Inverse, Pressures, linear_inverse, track
from sim_backends.valve.truth import load_valve_truth

FloatArray = npt.NDArray[np.float64]

SECONDS = 30.0
CALM = 0.5  # of the travel, or of the speed
POWER_ON = 1000.0  # s: later than any recording
PRESSURE_NOISE = 2.0e4  # Pa
HALF_A_CYCLE = 0.01  # s for which a command is older than when it was sent, on the average


def inverse_of(answer: Answer) -> Inverse:
    """Combine all axes' inverses; an axis ordered to rest does so until it is asked for enough."""
    axes = list(answer.axes.values())
    moving = [False] * len(axes)

    def inverse(speed: FloatArray, p: Pressures) -> FloatArray:
        told = np.zeros(len(axes))
        for j, axis in enumerate(axes):
            assert axis.command is not None
            told[j] = axis.command(float(speed[j]), float(p.head[j]), float(p.rod[j]), p.supply, p.tank, moving[j])
            moving[j] = told[j] != 0.0
        return told

    return inverse


def followed(folder: Path, key: ValveKey, answer: Answer) -> dict[str, Any]:
    """Measure tracking errors (RMS of all axes, over travel) of one feedback with four feedforwards."""
    machine, truth = load_machine(folder / "machine.yaml"), load_valve_truth(folder / "truth.yaml")
    guesses = order_of(key)[3]
    rng = np.random.default_rng([80, key.seed, key.number])
    path = next(p.path for p in working_motion(guesses, rng, SECONDS, CALM) if isinstance(p, Follow))
    linear, late = linear_inverse(guesses), np.array([axis.delay[0] + HALF_A_CYCLE for axis in answer.axes.values()])
    ways = {
        "feedback": Control(linear, feedforward=False),
        "linear": Control(linear),
        "inverse": Control(inverse_of(answer)),
        "preview": Control(inverse_of(answer), preview=late),
    }
    tracked = track(machine, truth, path, list(ways.values()), power_on=POWER_ON, pressure_std=PRESSURE_NOISE, rng=rng)
    travel = np.array([guess.high - guess.low for guess in guesses])
    return {way: float(np.sqrt(((own.rms / travel) ** 2).mean())) for way, own in zip(ways, tracked, strict=True)}
