"""``hilfit bench excitation``: six joints with all limits, how long the default search takes and how near it gets.

Both kinds of arm that the simulator draws, with limits on position, speed, acceleration and stroke, and with supply
flow and chamber pressure tight enough to bind: the flow at 70 % and the pressure at 85 % of what the best motion
without them would take (but above what the arm needs to hold itself). The yardstick is the best of twenty single runs
that are three times as long.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from benchmarks.targets import Check, figure
from daq.machine.machine_file import Machine
from fitting.arm.base_parameters import base_regressor, reduce_parameters
from fitting.excitation import Excitation, ExcitationOptions, HydraulicLimits, design_motion
from fitting.excitation.limits import chamber_pressure, supply_flow
from sim_backends.machines import folding_arm, slewing_arm
from sim_backends.plant.truth import Truth

Arm = Literal["folding", "slewing"]

SECONDS, RATIO = 20.0, 1.10
_BACK_PRESSURE = 7.0e5  # Pa: what the simulated valves keep in a chamber that empties


@dataclass(frozen=True)
class Outcome:
    """One arm.

    Attributes
    ----------
    arm, seed : which one
    seconds : processor time of the default search
    condition_number : what it reached
    best_of_long : the best of the long runs
    kept : largest share of any limit that its motion uses; it may use ``use``
    """

    arm: str
    seed: int
    seconds: float
    condition_number: float
    best_of_long: float
    kept: float

    @property
    def ratio(self) -> float:
        """Condition number over the yardstick's."""
        return self.condition_number / self.best_of_long


def run(
    arms: tuple[Arm, ...] = ("folding", "slewing"),
    seeds: tuple[int, ...] = (0,),
    long_runs: int = 20,
    show: Callable[[str], None] = lambda line: None,
) -> list[Check]:
    """Run the benchmark.

    Parameters
    ----------
    arms, seeds : machines that are drawn
    long_runs : how many long runs make the yardstick
    show : gets a line per arm as it is done
    """
    outcomes = []
    for arm in arms:
        for seed in seeds:
            outcomes.append(measure(arm, seed, long_runs))
            o = outcomes[-1]
            show(
                f"{o.arm} arm, seed {o.seed}: {o.seconds:.1f} s, cond(W) {o.condition_number:.2f}, best of {long_runs} "
                f"long runs {o.best_of_long:.2f} (ratio {o.ratio:.3f}), at most {100 * o.kept:.1f} % of any limit"
            )
    return checks(outcomes)


def checks(outcomes: list[Outcome]) -> list[Check]:
    """Targets beside the worst of what was measured."""
    slowest, farthest = max(o.seconds for o in outcomes), max(o.ratio for o in outcomes)
    most, use = max(o.kept for o in outcomes), ExcitationOptions().use
    took = "time of the default search, one core"
    return [
        figure(took, slowest, "{:.1f} s", most=SECONDS),
        Check("cond(W) over the best of the long runs", farthest, f"{farthest:.3f}", "at most", RATIO),
        Check("share of a limit that is used", most, f"{100 * most:.2f} %", "at most", use + 1e-6, f"{100 * use:g} %"),
    ]


def measure(arm: Arm, seed: int, long_runs: int) -> Outcome:
    """The default search on one arm, and its yardstick."""
    machine, truth = (folding_arm if arm == "folding" else slewing_arm)(seed)
    base = reduce_parameters(machine)
    limits = binding_limits(machine, truth)
    started = time.process_time()
    found = design_motion(machine, base, seed=seed, hydraulic=limits)
    seconds = time.process_time() - started
    long = replace(ExcitationOptions(), starts=1, iterations=3 * ExcitationOptions().iterations)
    best = min(
        design_motion(machine, base, seed=1000 + k, options=long, hydraulic=limits).condition_number
        for k in range(long_runs)
    )
    kept = max(use.used for use in found.limits if use.quantity != "stroke")
    return Outcome(arm, seed, seconds, found.condition_number, best, kept)


def binding_limits(machine: Machine, truth: Truth) -> HydraulicLimits:
    """Supply flow and chamber pressure that take something from the best motion without them."""
    base = reduce_parameters(machine)
    values = base.from_standard([link.as_list() for link in truth.links])
    friction = np.array([truth.cylinders[joint.name].f_c for joint in machine.joints])
    quick = replace(ExcitationOptions(), starts=1, iterations=60)
    free = design_motion(machine, base, options=quick)
    pressures, resting = _pressures(machine, free, values, friction)
    return HydraulicLimits(
        flow=0.7 * float(supply_flow(machine, free.motion.joint_positions(machine), free.speed)[0].max()),
        pressure=max(0.85 * pressures, 1.1 * resting),
        back_pressure=_BACK_PRESSURE,
        base_parameters=values,
        friction=friction,
    )


def _pressures(machine: Machine, free: Excitation, values: np.ndarray, friction: np.ndarray) -> tuple[float, float]:
    """Highest chamber pressure of a motion in Pa, and what the arm at mid-range needs to hold itself."""
    q = free.motion.joint_positions(machine)
    tau = base_regressor(machine, reduce_parameters(machine), q, free.speed, free.acceleration) @ values
    highest, resting = 0.0, 0.0
    for i, joint in enumerate(machine.joints):
        assert joint.cylinder is not None
        own, _, _ = chamber_pressure(joint.cylinder, q[:, i], tau[:, i], float(friction[i]), _BACK_PRESSURE)
        highest, resting = max(highest, float(own.max())), max(resting, float(own[0]))
    return highest, resting
