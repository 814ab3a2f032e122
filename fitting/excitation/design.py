"""Optimal excitation: the motion of all joints that determines the base parameters best within their limits.

Each joint follows a truncated Fourier series that starts and ends at rest (:mod:`fitting.excitation.fourier`), found by
L-BFGS from random series that compete (:mod:`fitting.excitation.search`); the smooth criterion is brought towards the
condition number itself (:mod:`fitting.excitation.objective`). At the end every joint is scaled to its limits by its
true extremes on a fine grid, and the whole motion shrunk by the last per cent until supply flow and pressures hold.

What is gathered already, of motions and of recordings, new motions then complement.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import scipy

from daq.errors import InputError
from daq.machine.machine_file import Machine
from daq.motion_files import Motion
from daq.recordings.recording import Recording
from fitting.arm.base_parameters import BaseParameters, base_regressor, unidentifiable
from fitting.arm.dynamics import stacked
from fitting.arm.joint_side import at_joints
from fitting.arrays import FloatArray
from fitting.excitation.fourier import fourier_basis, limit_share
from fitting.excitation.limits import HydraulicLimits, LimitUse, hydraulic_limits_used, joint_limits_used
from fitting.excitation.objective import condition_of_information, information
from fitting.excitation.problem import ExcitationOptions, Problem, pose_problem
from fitting.excitation.search import search
from fitting.signals.filters import filter_bank
from fitting.signals.preparation import position_noise, segments_of

Progress = Callable[[float, float], None]

_BANDWIDTH = 3.0  # Hz, at most an eighth of the rate: smooth enough for accelerations of slow motions
_FINER = 5  # than the machine's rate: the grid that extremes are looked for on
_PEAKS = 0.999  # of flow and pressure: what may be missed between samples of slow motions


@dataclass(frozen=True)
class Excitation:
    """A designed motion and what it is good for.

    Attributes
    ----------
    motion : the motion program, at the machine's rate
    speed, acceleration : shape (N, n), of all joints at the samples of the motion
    condition_number : of the column-scaled observation matrix of this motion together with what was gathered before
    own_condition_number : of this motion alone (infinite if it cannot determine all parameters)
    information : ``W'W`` of this motion at the machine's rate, shape (nb, nb); sum these to pass on what is gathered
    limits : how much of each limit is used
    undetermined : names of base parameters that neither this motion nor what was gathered before determines
    """

    motion: Motion
    speed: FloatArray
    acceleration: FloatArray
    condition_number: float
    own_condition_number: float
    information: FloatArray
    limits: tuple[LimitUse, ...]
    undetermined: tuple[str, ...]


def design_motion(
    machine: Machine,
    base: BaseParameters,
    *,
    seed: int = 0,
    options: ExcitationOptions | None = None,
    joints: Sequence[str] | None = None,
    gathered: FloatArray | None = None,
    hydraulic: HydraulicLimits | None = None,
    progress: Progress | None = None,
) -> Excitation:
    """Design one motion.

    Parameters
    ----------
    machine : the arm, with its limits
    base : its inertial base parameters (``friction_by_stage_1=True``)
    seed : random seed of the starts
    options : how to search
    joints : names of the joints that move; all if None. The others hold mid-range
    gathered : information ``W'W`` (nb, nb) of the motions already recorded or designed: the new one complements them
    hydraulic : supply flow and chamber pressure, where they count
    progress : called with the share done (0 to 1) and the best condition number so far

    Raises
    ------
    InputError
        If a joint does not exist or the limits leave no motion.
    """
    options = options or ExcitationOptions()
    rng = np.random.default_rng(seed)
    problem = pose_problem(machine, base, options, joints, gathered, hydraulic or HydraulicLimits(), rng)
    finish = partial(_finish, problem, gathered=gathered)

    def condition(coefficients: FloatArray) -> float:
        try:
            return finish(coefficients).condition_number
        except InputError:  # that start has found no motion inside the limits
            return float("inf")

    found = finish(search(problem, rng, progress or (lambda share, reached: None), condition))
    if progress is not None:
        progress(1.0, found.condition_number)
    return found


def design_sequence(
    machine: Machine,
    base: BaseParameters,
    count: int,
    *,
    seed: int = 0,
    options: ExcitationOptions | None = None,
    gathered: FloatArray | None = None,
    joints: Sequence[str] | None = None,
    hydraulic: HydraulicLimits | None = None,
    progress: Progress | None = None,
) -> tuple[Excitation, ...]:
    """Design ``count`` motions, each complementing those before it. Arguments as in :func:`design_motion`."""
    motions: list[Excitation] = []
    for k in range(count):

        def report(share: float, condition: float, k: int = k) -> None:
            if progress is not None:
                progress((k + share) / count, condition)

        motion = design_motion(
            machine,
            base,
            seed=seed + k,
            options=options,
            joints=joints,
            gathered=gathered,
            hydraulic=hydraulic,
            progress=report,
        )
        motions.append(motion)
        gathered = motion.information if gathered is None else gathered + motion.information
    return tuple(motions)


def _finish(problem: Problem, coefficients: FloatArray, gathered: FloatArray | None) -> Excitation:
    """Make the motion at the machine's rate; limits hold on a finer grid, flow and pressures with a reserve."""
    machine, options = problem.machine, problem.options
    count = round(options.seconds * machine.rate_hz)
    fine: FloatArray = np.arange(_FINER * count + 1, dtype=float) * (options.seconds / (_FINER * count))
    series, amplitude, home = problem.split(coefficients)
    moving = np.zeros((3, fine.size, len(machine.joints)))
    for place, (i, c) in enumerate(zip(problem.joints, series, strict=True)):
        basis = fourier_basis(problem.harmonics[place], options.seconds, fine)
        u = np.stack([basis.position @ c, basis.speed @ c, basis.acceleration @ c])
        aside = home[i] - problem.middle[i]
        ways = problem.half[i] - aside, problem.half[i] + aside
        share = limit_share(u, *ways, problem.top_speed[i], problem.top_acceleration[i])
        moving[:, :, i] = amplitude[place] * u / share
    home, factor = _shrink(problem, home, moving[:, ::_FINER])
    moving *= factor
    q, qd, qdd = home + moving[0], moving[1], moving[2]
    limits = joint_limits_used(machine, q, qd, qdd)
    q, qd, qdd = q[::_FINER], qd[::_FINER], qdd[::_FINER]
    limits += hydraulic_limits_used(machine, problem.hydraulic, q, qd, _efforts(problem, q, qd, qdd))
    Y = base_regressor(machine, problem.base, q, qd, qdd)
    own = information(Y) * q.shape[0]
    total = own if gathered is None else own + gathered
    chosen = np.ix_(problem.columns, problem.columns)
    # Joints that hold elsewhere than mid-range have their position given.
    written = np.arange(len(machine.joints)) if problem.seeks_home else problem.joints
    return Excitation(
        motion=Motion(
            machine.name,
            "pinned",
            fine[::_FINER],
            {machine.joints[i].name: q[:, i].copy() for i in written},
        ),
        speed=qd,
        acceleration=qdd,
        condition_number=condition_of_information(total[chosen]),
        own_condition_number=condition_of_information(own),
        information=own,
        limits=limits,
        undetermined=_undetermined(problem, Y, gathered),
    )


def _undetermined(problem: Problem, Y: FloatArray, gathered: FloatArray | None) -> tuple[str, ...]:
    W = stacked(Y)
    if gathered is not None:
        values, vectors = np.linalg.eigh(gathered)
        W = np.vstack([W, np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T])
    return tuple(unidentifiable(W, problem.base, rtol=1e-6))


def _efforts(problem: Problem, q: FloatArray, qd: FloatArray, qdd: FloatArray) -> FloatArray | None:
    guess = problem.hydraulic.base_parameters
    if guess is None:
        return None
    Y = base_regressor(problem.machine, problem.base, q, qd, qdd)
    return np.asarray(Y @ guess)


def _shrink(problem: Problem, home: FloatArray, moving: FloatArray) -> tuple[FloatArray, float]:
    """Find the place (n,) to move about and the motion's factor, at most 1, that keep flow and pressures.

    Within 1 % of the largest factor. Where holding at ``home`` alone takes all of the pressure, that goes to mid-range
    with the motion.
    """
    if not problem.coupled:
        return home, 1.0
    limits, use = problem.hydraulic, problem.options.use
    for aside in (0.0, 1.0):
        factor = 1.0
        while factor > 0.02:
            place = home - aside * (1.0 - factor) * (home - problem.middle)
            q, qd, qdd = place + factor * moving[0], factor * moving[1], factor * moving[2]
            uses = hydraulic_limits_used(problem.machine, limits, q, qd, _efforts(problem, q, qd, qdd))
            worst = max(uses, key=lambda each: each.used)
            if worst.used <= _PEAKS * use:
                return place, factor
            factor *= float(np.clip(use / worst.used, 0.8, 0.995))
    where = f"{worst.joint} " if worst.joint else ""
    raise InputError(
        "fitting.excitation_stays_limit_however",
        where=where,
        quantity=worst.quantity,
        used=worst.used,
        limit=worst.limit,
        unit=worst.unit,
    )


def information_of(machine: Machine, base: BaseParameters, motion: Motion) -> FloatArray:
    """Compute the information ``W'W`` (nb, nb) of a motion file, gained once it is recorded.

    Speeds and accelerations are those of a quintic spline through the positions, at rest at both ends, sampled at
    the machine's rate.

    Raises
    ------
    InputError
        If it is a motion of free cylinders.
    """
    if motion.rods != "pinned":
        raise InputError("fitting.motion_rods_unpinned_tells", machine=machine.name)
    rest: Any = [(order, np.zeros(len(machine.joints))) for order in (1, 2)]
    law = scipy.interpolate.make_interp_spline(motion.time, motion.joint_positions(machine), k=5, bc_type=(rest, rest))
    count = round(motion.seconds * machine.rate_hz)
    time = np.linspace(0.0, motion.seconds, count + 1)
    Y = base_regressor(machine, base, law(time), law.derivative(1)(time), law.derivative(2)(time))
    return information(Y) * len(time)


def information_of_recording(machine: Machine, base: BaseParameters, recording: Recording) -> FloatArray:
    """Compute the information ``W'W`` (nb, nb) of a recording with pinned rods, by its measured motion.

    A joint that rests has noise for a speed and an acceleration, which would pass for excitation: zero is taken there.

    Raises
    ------
    InputError
        If it was recorded with unpinned rods; RecordingError if no stretch of it is longer than the filters.
    """
    if recording.role == "unloaded":
        raise InputError("fitting.recorded_rods_unpinned_tells", file=recording.file)
    machine, (recording,) = at_joints(machine, (recording,))
    bank = filter_bank(machine.rate_hz, min(_BANDWIDTH, machine.rate_hz / 8))
    noise = position_noise(machine, (recording,), bank)
    total = np.zeros((len(base), len(base)))
    for segment in segments_of(machine, (recording,), bank, noise=noise):
        qd, qdd = (np.where(segment.rest, 0.0, values) for values in (segment.qd, segment.qdd))
        total += information(base_regressor(machine, base, segment.q, qd, qdd)) * len(segment)
    return total
