"""Recipes of cases, visibility of their effects, and cases on disk: apart from what a fit may see, the truth.

Every number of a run is a machine; it is recorded twice with the same motions, healthy (``null``) and with one
undeclared effect (``large``). The three kinds of machines take turns. An effect is visible by what a healthy valve
would have done at the pressures that there were. The same, from what was measured of a healthy one, is the noise floor:
no model can know more than the true one.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
import yaml
from scipy.signal import butter, sosfiltfilt

from benchmarks.attribution.recipe import draw_transducers
from daq.machine.machine_file import Machine
from daq.whole_files import write_whole
from fitting.arrays import FloatArray
from sim_backends.valve.chambers import Chambers
from sim_backends.valve.effects import VALVE_EFFECTS, ValveEffectSpec, valve_obstacle
from sim_backends.valve.lands import Lands
from sim_backends.valve.machines import VALVE_MACHINES, Kind
from sim_backends.valve.motion import Phase, joint_motion, valve_motion, working_motion
from sim_backends.valve.recording import Course, Order, ValveCase, guesses_of, simulate_valve_cases, write_valve_case
from sim_backends.valve.spools import Spools
from sim_backends.valve.truth import ValvePlantTruth

KINDS: tuple[Kind, ...] = ("bench", "crane", "excavator")
CLASSES: tuple[Literal["null", "large"], ...] = ("null", "large")
FULL_SCALE = 40.0e6  # Pa of the pressure transducers
WORK = 60.0  # s of the motion that is judged on
SIDE_BY_SIDE = 16  # cases that are simulated together


@dataclass(frozen=True)
class ValveKey:
    """Key of a case: its number, its class and the run's seed."""

    number: int
    made: Literal["null", "large"]
    seed: int = 0

    @property
    def kind(self) -> Kind:
        """The kind of machine."""
        return KINDS[self.number % len(KINDS)]

    @property
    def text(self) -> str:
        """Name of the case, and of its folder."""
        return f"seed{self.seed}-{self.number:03d}-{self.kind}-{self.made}"


def order_of(key: ValveKey) -> Order:
    """Draw machine, truth, programmes, guesses, effects, sensors and seed of the noise."""
    rng = np.random.default_rng([78, key.seed, key.number])
    machine, truth = VALVE_MACHINES[key.kind](int(rng.integers(2**31)))
    guesses = guesses_of(machine, truth, rng)
    count = len(machine.joints)
    level = float(rng.uniform(0.65, 0.8))
    programmes: dict[str, Sequence[Phase]] = {}
    for axis, joint in enumerate(machine.joints):
        poses = [(0.5,) * count, tuple(0.5 if j == axis else float(rng.uniform(0.15, 0.3)) for j in range(count))]
        programmes[f"train-{joint.name}"] = valve_motion(axis, guesses, poses, level)
    programmes["train-all"] = joint_motion(guesses, rng, 0.8)
    programmes["repeat"] = programmes["train-all"]
    programmes["validate"] = working_motion(guesses, rng, WORK)
    quality = draw_transducers(rng, FULL_SCALE)
    effects: tuple[ValveEffectSpec, ...] = ()
    if key.made == "large":
        pool: dict[str, list[tuple[str, str | None]]] = {}
        for (effect, form), known in VALVE_EFFECTS.items():
            # The excavator's pump has its limit in every case.
            if known.earlier or (known.whole and np.isfinite(truth.supply.flow_limit)):
                continue
            for joint_name in [None] if known.whole else [joint.name for joint in machine.joints]:
                if valve_obstacle(known, machine, truth, joint_name) is None:
                    pool.setdefault(effect, []).append((form, joint_name))
        own = np.random.default_rng([79, key.seed, key.number])
        effect = list(pool)[int(own.integers(len(pool)))]
        form, place = pool[effect][int(own.integers(len(pool[effect])))]
        low, high = VALVE_EFFECTS[effect, form].large
        effects = (ValveEffectSpec(effect, form, place, float(np.exp(own.uniform(np.log(low), np.log(high))))),)
    return machine, truth, programmes, guesses, effects, quality, key.seed * 1000 + key.number


def stored_cases(folder: Path, keys: Sequence[ValveKey], show: Callable[[str], None]) -> list[Path]:
    """Return folders of the cases in the order of ``keys``; make those not there yet, many at a time."""
    folder.mkdir(parents=True, exist_ok=True)
    missing = [key for key in keys if not (folder / key.text / "case.yaml").is_file()]
    for kind in KINDS:
        own = [key for key in missing if key.kind == kind]
        for first in range(0, len(own), SIDE_BY_SIDE):
            part = own[first : first + SIDE_BY_SIDE]
            show(f"simulating {len(part)} cases of kind {kind}")
            for key, case in zip(part, simulate_valve_cases([order_of(key) for key in part]), strict=True):
                _write(folder / key.text, key, case)
    return [folder / key.text for key in keys]


def _write(place: Path, key: ValveKey, case: ValveCase) -> None:
    shutil.rmtree(place, ignore_errors=True)
    write_valve_case(place, case)
    courses = [case.courses[stem] for stem in case.courses if stem != "repeat"]
    names = [joint.name for joint in case.machine.joints]
    seen = misfit(case.machine, case.healthy, courses)
    content = {
        "kind": key.kind,
        "made": key.made,
        "seen": dict(zip(names, map(float, seen), strict=True)),
        "at_limit": at_limit(case.machine, case.truth, [case.courses["train-all"]]),
        "floor": dict(zip(names, map(float, floor(case)), strict=True)),
        "healthy": case.healthy.to_dict(),
    }
    # Written last and in one step: a folder with it is complete.
    write_whole(place / "case.yaml", yaml.safe_dump(content, sort_keys=False).encode())


BAND = 3.0  # Hz
_STEP = 2.0e-3  # s
_SETTLED = 0.5  # s left out at either end


def _healthy_speed(machine: Machine, truth: ValvePlantTruth, course: Course) -> FloatArray:
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
    """Compute per axis (J,) :func:`_healthy_speed`'s error below 3 Hz, over the speed's RMS."""
    errors, speeds = [], []
    for course in courses:
        rate = 1.0 / (course.time[1] - course.time[0])
        sections = butter(2, BAND / (0.5 * rate), output="sos")
        cut = slice(round(_SETTLED * rate), -round(_SETTLED * rate))
        error = _healthy_speed(machine, truth, course) - course.v
        errors.append(sosfiltfilt(sections, error, axis=0)[cut])
        speeds.append(sosfiltfilt(sections, course.v, axis=0)[cut])
    error, speed = np.concatenate(errors), np.concatenate(speeds)
    return np.asarray(np.sqrt((error**2).mean(axis=0) / (speed**2).mean(axis=0)))


def floor(case: ValveCase) -> FloatArray:
    """Compute per axis (J,) the true valve's error at measured pressures against measured speed, below 3 Hz.

    Over the speed's root mean square. Positions are those of the channels, speeds their differences.
    """
    machine, table, course = case.machine, case.tables["validate"], case.courses["validate"]
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
