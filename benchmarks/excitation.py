"""``hilfit bench excitation``: six joints with all limits, how long the default search takes and how near it gets.

Both kinds of arm that the simulator draws, with limits on position, speed, acceleration and stroke, and with supply
flow and chamber pressure tight enough to bind: the flow at 70 % and the pressure at 85 % of what the best motion
without them would take (but above what the arm needs to hold itself). The yardstick is the best of twenty single runs
that are three times as long.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from benchmarks.targets import Arm, Check, Outcome, Show, figure
from daq.machine.machine_file import Machine
from fitting.arm.base_parameters import base_regressor, reduce_parameters
from fitting.excitation.design import Excitation, design_motion
from fitting.excitation.limits import HydraulicLimits, chamber_pressure, supply_flow
from fitting.excitation.problem import ExcitationOptions
from sim_backends.machines import ARMS as MACHINES
from sim_backends.plant.truth import Truth

SECONDS, RATIO = 20.0, 1.10
_BACK_PRESSURE = 7.0e5  # Pa: what the simulated valves keep in a chamber that empties


def run(arms: tuple[Arm, ...], seed: int, long_runs: int, show: Show) -> Outcome:
    """Design a motion for one arm of each kind, and its yardstick."""
    found = []
    for arm in arms:
        seconds, condition, best, kept = _measure(arm, seed, long_runs)
        found.append((seconds, condition / best, kept))
        show(
            f"{arm} arm, seed {seed}: {seconds:.1f} s, cond(W) {condition:.2f}, best of {long_runs} long runs "
            f"{best:.2f} (ratio {condition / best:.3f}), at most {100 * kept:.1f} % of any limit"
        )
    slowest, farthest, most = (max(own) for own in zip(*found, strict=True))
    use = ExcitationOptions().use
    return Outcome(
        (
            figure("time of the default search, one core", slowest, "{:.1f} s", most=SECONDS),
            figure("cond(W) over the best of the long runs", farthest, "{:.3f}", most=RATIO),
            Check(
                "share of a limit that is used", most, f"{100 * most:.2f} %", "at most", use + 1e-6, f"{100 * use:g} %"
            ),
        )
    )


def _measure(arm: Arm, seed: int, long_runs: int) -> tuple[float, float, float, float]:
    """Measure processor s of the default search, its condition number, the best long run's, the largest share.

    The latter is of any limit that the motion uses; it may use ``use`` of each.
    """
    machine, truth = MACHINES[arm](seed)
    base = reduce_parameters(machine)
    limits = _binding_limits(machine, truth)
    started = time.process_time()
    found = design_motion(machine, base, seed=seed, hydraulic=limits)
    seconds = time.process_time() - started
    long = replace(ExcitationOptions(), starts=1, iterations=3 * ExcitationOptions().iterations)
    best = min(
        design_motion(machine, base, seed=1000 + k, options=long, hydraulic=limits).condition_number
        for k in range(long_runs)
    )
    kept = max(use.used for use in found.limits if use.quantity != "stroke")
    return seconds, found.condition_number, best, kept


def _binding_limits(machine: Machine, truth: Truth) -> HydraulicLimits:
    """Choose supply flow and chamber pressure that take something from the best motion without them."""
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
    """Compute the highest chamber pressure of a motion in Pa, and what holds the arm at mid-range."""
    q = free.motion.joint_positions(machine)
    tau = base_regressor(machine, reduce_parameters(machine), q, free.speed, free.acceleration) @ values
    highest, resting = 0.0, 0.0
    for i, joint in enumerate(machine.joints):
        assert joint.cylinder is not None
        own, _, _ = chamber_pressure(joint.cylinder, q[:, i], tau[:, i], float(friction[i]), _BACK_PRESSURE)
        highest, resting = max(highest, float(own.max())), max(resting, float(own[0]))
    return highest, resting
