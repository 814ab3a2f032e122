"""How far an undeclared effect stands out: what a healthy valve would have done at the pressures that there were.

The same, from what was measured of a healthy one, is the noise floor: no model can know more than the true one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
from scipy.signal import butter, sosfiltfilt

from daq.machine.machine_file import Machine
from sim_backends.valve.chambers import Chambers
from sim_backends.valve.lands import Lands
from sim_backends.valve.recording import Course, ValveCase
from sim_backends.valve.spools import Spools
from sim_backends.valve.truth import ValvePlantTruth

FloatArray = npt.NDArray[np.float64]

BAND = 3.0  # Hz
_STEP = 2.0e-3  # s
_SETTLED = 0.5  # s left out at either end


def healthy_speed(machine: Machine, truth: ValvePlantTruth, course: Course) -> FloatArray:
    """Compute speeds (N, J) in m/s by ``truth``'s meter-in edges, at a run's commands and pressures.

    ``v = (Q_in - losses - C dp/dt) / A`` of the chamber that is filled; where the spool is closed, both chambers'
    mean.
    """
    names = [joint.name for joint in machine.joints]
    valves, oils = [truth.valves[name] for name in names], [truth.cylinders[name] for name in names]
    spools = Spools([[valve.spool for valve in valves]], _STEP)
    lands = Lands([valves], [oils])
    chambers = Chambers([machine], [oils], [valves], [truth.oil], [truth.supply])
    per_cycle = round((course.time[1] - course.time[0]) / _STEP)
    rates = np.gradient(course.pressure, course.time, axis=0)
    speeds = np.empty_like(course.x)
    open_held = np.ones((2, len(names), 1))
    for k, command in enumerate(course.command):
        p = course.pressure[k][:, :, None]
        stroke = spools.stroke
        drop = np.stack([course.supply[k] - p, p - course.tank[k]])
        flow, _ = lands.flow(lands.conductance(stroke, np.ones(1)), drop, open_held)
        out, _, _ = chambers.losses(p, stroke)
        balance = flow[0] - flow[1] - out - chambers.capacity(course.x[k][:, None]) * rates[k][:, :, None]
        head, rod = balance / chambers.area
        share = np.where(stroke > 0.0, 1.0, np.where(stroke < 0.0, 0.0, 0.5))
        speeds[k] = (share * head + (1.0 - share) * rod)[:, 0]
        for _ in range(per_cycle):
            spools.step(command[:, None], np.ones(1))
    return speeds


def misfit(machine: Machine, truth: ValvePlantTruth, courses: Sequence[Course]) -> FloatArray:
    """Compute per axis (J,) :func:`healthy_speed`'s error below 3 Hz, over the speed's RMS."""
    errors, speeds = [], []
    for course in courses:
        rate = 1.0 / (course.time[1] - course.time[0])
        sections = butter(2, BAND / (0.5 * rate), output="sos")
        cut = slice(round(_SETTLED * rate), -round(_SETTLED * rate))
        error = healthy_speed(machine, truth, course) - course.v
        errors.append(sosfiltfilt(sections, error, axis=0)[cut])
        speeds.append(sosfiltfilt(sections, course.v, axis=0)[cut])
    error, speed = np.concatenate(errors), np.concatenate(speeds)
    return np.asarray(np.sqrt((error**2).mean(axis=0) / (speed**2).mean(axis=0)))


def floor(case: ValveCase, stem: str = "validate") -> FloatArray:
    """Compute per axis (J,) the true valve's error at measured pressures against measured speed, below 3 Hz.

    Over the speed's root mean square. Positions are those of the channels, speeds their differences.
    """
    machine, table, course = case.machine, case.tables[stem], case.courses[stem]
    x, pressure = course.x.copy(), course.pressure.copy()
    for j, joint in enumerate(machine.joints):
        assert joint.cylinder is not None
        piston, angle = (machine.channel(f"{kind}_position", joint.name) for kind in ("piston", "joint"))
        if piston is not None:
            x[:, j] = table[piston.name]
        elif angle is not None:
            x[:, j] = joint.cylinder.linkage.piston_position(table[angle.name])
        for k, side in enumerate(("head", "rod")):
            channel = machine.channel(f"{side}_pressure", joint.name)
            assert channel is not None
            pressure[:, k, j] = table[channel.name]
    v = np.gradient(x, course.time, axis=0)
    supply = machine.channel("supply_pressure")
    measured = course.supply if supply is None else table[supply.name]
    return misfit(machine, case.truth, [replace(course, x=x, v=v, pressure=pressure, supply=measured)])


def at_limit(machine: Machine, truth: ValvePlantTruth, courses: Sequence[Course]) -> float:
    """Compute the share of time in which the cylinders take at least 95 % of the pump's limit."""
    cylinders = [joint.cylinder for joint in machine.joints]
    head, rod = (np.array([getattr(c, f"{side}_area") for c in cylinders]) for side in ("head", "rod"))
    reached = []
    for course in courses:
        flow = np.where(course.v > 0.0, course.v * head, -course.v * rod).sum(axis=1)
        power = flow * course.supply
        reached.append((flow > 0.95 * truth.supply.flow_limit) | (power > 0.95 * truth.supply.power_limit))
    return float(np.concatenate(reached).mean())
