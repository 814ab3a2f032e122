"""A controller that follows a path through an inverse of the valves: how much each part of it is worth.

Every cycle (50 Hz) each axis wants the speed of its path and feedback on where it is, ``v = v_ref + Kp (x_ref - x)``; a
way of control makes a command of it. With ``preview`` the path's speed is taken so many seconds ahead: a path is known
before it is driven, and the axis is late.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from daq.machine.machine_file import Machine
from sim_backends.arrays import FloatArray
from sim_backends.valve.motion import Guess
from sim_backends.valve.plant import STEP, ValvePlant
from sim_backends.valve.truth import ValvePlantTruth

SETTLING = 2.0  # s at the start that do not count
GAIN = 2.0  # 1/s, feedback Kp


@dataclass(frozen=True)
class Pressures:
    """Measurements of a cycle, Pa: chambers (J,), supply and tank."""

    head: FloatArray
    rod: FloatArray
    supply: float
    tank: float


#: Speeds (J,) in m/s and pressures to commands (J,), fractions of full.
Inverse = Callable[[FloatArray, Pressures], FloatArray]


@dataclass(frozen=True)
class Control:
    """A way of control.

    Attributes
    ----------
    inverse : makes commands of speeds
    feedforward : whether the path's speed is fed forward
    preview : (J,) s by which it is taken early; None: not at all
    """

    inverse: Inverse
    feedforward: bool = True
    preview: FloatArray | None = None


class TrueInverse:
    """The inverse of the plant's own healthy valves: what the best identification could hand out.

    ``|y| = edge + (1 - edge) o^(1/c)`` with the opening ``o`` that lets ``|v| A`` in at the drop of the moment. A wish
    below ``quiet`` of the full speed gives 0 until it is above three times as much. With ``trusting`` a load-sensing
    pump is taken to bring its margin once the valve opens.
    """

    def __init__(self, machine: Machine, truth: ValvePlantTruth, quiet: float = 0.005, trusting: bool = True) -> None:
        cylinders = [joint.cylinder for joint in machine.joints]
        self._areas = np.array([[c.head_area, c.rod_area] for c in cylinders if c is not None]).T
        self._valves = [truth.valves[joint.name] for joint in machine.joints]
        supply = truth.supply
        self._least = supply.margin if trusting and supply.kind == "load_sensing" else 1.0e5
        self._quiet, self._moving = quiet, np.zeros(len(cylinders), dtype=bool)

    def __call__(self, speed: FloatArray, pressures: Pressures) -> FloatArray:
        """Compute commands (J,) for speeds (J,)."""
        commands = np.zeros(len(speed))
        for j, valve in enumerate(self._valves):
            name, k, sign = ("head_in", 0, 1.0) if speed[j] > 0.0 else ("rod_in", 1, -1.0)
            land, p = valve.lands[name], (pressures.head if k == 0 else pressures.rod)[j]
            wanted = abs(speed[j]) * self._areas[k, j] / land.flow
            self._moving[j] = wanted > (self._quiet if self._moving[j] else 3.0 * self._quiet)
            if not self._moving[j]:
                continue
            drop = max(pressures.supply - p, self._least)
            drop /= (1.0 + (drop / valve.compensation) ** 4) ** 0.25
            opening = min(wanted / np.sqrt(drop / valve.nominal_drop), 0.98 * land.saturation)
            opening /= (1.0 - (opening / land.saturation) ** 4) ** 0.25
            commands[j] = sign * min(land.edge + (1.0 - land.edge) * opening ** (1.0 / land.exponent), 1.0)
        return commands


def linear_inverse(guesses: Sequence[Guess]) -> Inverse:
    """Return a controller's inverse without identification: a line through 0 and speed at full command."""
    speeds = np.array([guess.speed for guess in guesses])
    return lambda speed, _: speed / speeds


def track(
    machine: Machine,
    truth: ValvePlantTruth,
    path: FloatArray,
    controls: Sequence[Control],
    *,
    power_on: float = 0.0,
    pressure_std: float = 0.0,
    rng: np.random.Generator | None = None,
) -> list[FloatArray]:
    """Follow one path by several ways of control, side by side on equal machines.

    Return the RMS error of each way, (J,) m, once it has settled.

    Parameters
    ----------
    path : (N, J) piston positions in m, a row per cycle of the machine's rate; it begins at rest
    controls : ways of control
    power_on : s for which the machine has run before
    pressure_std : Pa, noise of the pressures that inverses are given (needs ``rng``)
    """
    rate = machine.rate_hz
    per_cycle = round(1.0 / rate / STEP)
    plant = ValvePlant([(machine, truth)] * len(controls), STEP, power_on)
    plant.place(np.repeat(path[0][:, None], len(controls), axis=1))
    time = np.arange(len(path)) / rate
    speed = np.gradient(path, time, axis=0)
    errors, commands = np.empty((len(path), *plant.shape)), np.empty(plant.shape)
    for k in range(len(path)):
        state = plant.state
        errors[k] = path[k][:, None] - state.x
        noise = np.zeros((2, *plant.shape))
        if pressure_std > 0.0 and rng is not None:
            noise = pressure_std * rng.standard_normal(noise.shape)
        for p, control in enumerate(controls):
            late = np.zeros(plant.shape[0]) if control.preview is None else control.preview
            columns = range(plant.shape[0])
            shifted = np.array([np.interp(time[k] + late[j], time, speed[:, j], right=0.0) for j in columns])
            wanted = np.array([np.interp(time[k], time, path[:, j]) for j in columns])
            v = shifted * control.feedforward + GAIN * (wanted - state.x[:, p])
            head, rod = state.pressure[:, :, p] + noise[:, :, p]
            command = control.inverse(v, Pressures(head, rod, float(state.supply[p]), float(state.tank[p])))
            commands[:, p] = np.clip(np.nan_to_num(command), -1.0, 1.0)
        for _ in range(per_cycle):
            plant.step(commands)
    counted = errors[round(SETTLING * rate) :]
    rms = np.sqrt((counted**2).mean(axis=0))
    return list(rms.T)
