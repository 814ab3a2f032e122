"""Motion from efforts: the model integrated by scipy.

A sign of speed is no right-hand side for an integrator. Here it is the expectation of the sign under the noise of the
measured speed, as the fit had it: smooth, and as wide as that noise. What holds an arm still by dry friction therefore
creeps, slower than that width; :attr:`Simulated.friction_speed` says how slow.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from daq.errors import HilfitError, InputError
from fitting.arrays import FloatArray
from fitting.model import motion
from fitting.model.arm_model import ArmModel
from fitting.model.export.python import Compiled, compiled
from fitting.model.export.tracing.tracing import Tracer

#: Joint efforts (n,) at a time, position and speed.
Efforts = Callable[[float, FloatArray, FloatArray], npt.ArrayLike]
#: Integrators of scipy.
Method = Literal["RK23", "RK45", "DOP853", "Radau", "BDF", "LSODA"]

#: Share of the largest speed that was recorded below which a sign of speed is always smooth.
_LEAST_WIDTH = 1e-4
_RELATIVE, _ABSOLUTE = 1e-7, 1e-9
_STEPS, _CLOSE = 60, 1e-10


@dataclass(frozen=True)
class Simulated:
    """A simulated motion: arrays (N, n).

    Attributes
    ----------
    t : (N,) s
    q, qd, qdd : positions, speeds, accelerations
    effort : joint efforts that acted, N m or N
    friction_speed : (n,) standard deviation of the speed, m/s of a piston, that signs of speed are smooth over
    left_out : a line for each term of the model that took no part
    """

    t: FloatArray
    q: FloatArray
    qd: FloatArray
    qdd: FloatArray
    effort: FloatArray
    friction_speed: FloatArray
    left_out: tuple[str, ...]


def simulate(
    model: ArmModel,
    effort: Efforts,
    q: npt.ArrayLike,
    qd: npt.ArrayLike | None = None,
    *,
    seconds: float,
    rate_hz: float | None = None,
    friction_speed: float | None = None,
    method: Method = "LSODA",
    possible: bool = False,
    within_s: float = 60.0,
    clock: Callable[[], float] = time.monotonic,
) -> Simulated:
    """Integrate the model from a state.

    Parameters
    ----------
    effort : gives joint efforts (n,) at ``(t, q, qd)``: a controller (:func:`tracking` makes one), or any function
    q, qd : (n,) where it starts; at rest if no speed is given
    seconds : how long
    rate_hz : of the result; the model's if None
    friction_speed : least width, m/s of a piston, over which signs of speed are smooth; the noise of the measured speed
        if None, and never less than 1e-4 of the largest speed that was recorded
    method : one of :func:`scipy.integrate.solve_ivp`'s
    possible : take the nearest model whose drives have no inertia below zero
    within_s : s of ``clock`` after which it gives up

    Raises
    ------
    InputError
        If the state does not fit the arm, or the mass matrix has no inverse somewhere within the limits.
    HilfitError
        If the integrator gives up, or takes too long.
    """
    n = len(model.joints)
    start = [np.asarray(values, dtype=float).ravel() for values in (q, np.zeros(n) if qd is None else qd)]
    if any(values.shape != (n,) or not np.isfinite(values).all() for values in start):
        raise InputError(f"simulate: q and qd must be {n} finite numbers each, one per joint")
    if not seconds > 0:
        raise InputError(f"simulate: {seconds:g} s is no time; give seconds above 0")
    model = motion.nearest_possible(model) if possible else model
    wrong = motion.indefinite(model)
    if wrong is not None:
        raise InputError(f"simulate: {wrong.text}; possible=True takes the nearest model that has none below zero")
    ends = clock() + within_s
    least = [max(friction_speed or 0.0, _LEAST_WIDTH * own.v) for own in model.passes[-1].ranges]
    noise = tuple(replace(own, speed=max(own.speed, width)) for own, width in zip(model.noise, least, strict=True))
    tracer = Tracer(replace(model, noise=noise))
    plant = _Plant(model, compiled(tracer), n, any(term.uses_model for term in motion.at_rest(tracer.carried).terms))

    def slope(t: float, state: FloatArray) -> FloatArray:
        if clock() > ends:
            raise HilfitError(
                f"simulate: at {t:.3g} s after {within_s:g} s of calculating; give within_s=, or smaller efforts"
            )
        position, speed = state[:n], state[n:]
        return np.concatenate([speed, plant.acceleration(t, position, speed, np.asarray(effort(t, position, speed)))])

    rate = rate_hz or model.machine.rate_hz
    times = np.arange(round(seconds * rate) + 1) / rate
    found = solve_ivp(slope, (0.0, times[-1]), np.concatenate(start), method, times, rtol=_RELATIVE, atol=_ABSOLUTE)
    if not found.success or not np.isfinite(found.y).all():
        raise HilfitError(f"simulate: the integrator gave up ({found.message}); try method='Radau' or smaller efforts")
    positions, speeds = found.y[:n].T, found.y[n:].T
    efforts = np.array([np.asarray(effort(t, a, b)) for t, a, b in zip(times, positions, speeds, strict=True)])
    return Simulated(
        t=times,
        q=positions,
        qd=speeds,
        qdd=np.array([plant.acceleration(*row) for row in zip(times, positions, speeds, efforts, strict=True)]),
        effort=efforts,
        friction_speed=np.array([own.speed for own in noise]),
        left_out=tuple(tracer.left_out),
    )


@dataclass(frozen=True)
class _Plant:
    """The model as an equation of motion; ``holds_force`` where effects depend on the drives' forces."""

    model: ArmModel
    functions: Compiled
    joints: int
    holds_force: bool

    def acceleration(self, t: float, q: FloatArray, qd: FloatArray, effort: FloatArray) -> FloatArray:
        """Joint accelerations (n,) under joint efforts (n,)."""
        position, speed = q.tolist(), qd.tolist()
        inertia = np.array(self.functions.inertia(position)).reshape(self.joints, self.joints).T
        wrong = motion.worst_pose(self.model, q[None], inertia[None])
        if wrong is not None:  # beyond the limits of the joints
            raise InputError(f"simulate: {wrong.text}; no motion follows from efforts there")
        found = np.zeros(self.joints)
        for _ in range(_STEPS if self.holds_force else 1):
            missing = effort - np.array(self.functions.effort(position, speed, found.tolist(), t))
            step = np.linalg.solve(inertia, missing)
            found = found + step
            if np.max(np.abs(step)) <= _CLOSE * max(float(np.max(np.abs(found))), 1e-6):
                break
        return found


def tracking(model: ArmModel, t: npt.ArrayLike, q: npt.ArrayLike, *, bandwidth_hz: float = 2.0) -> Efforts:
    """A controller that follows a motion: the model's own efforts, and what pulls back to the motion.

    ``effort(q_r, q_r', q_r'') + M(q_r) (w^2 (q_r - q) + 2 w (q_r' - q'))``, ``w`` the bandwidth: critically damped.

    Parameters
    ----------
    t, q : (N,) s from 0, (N, n) positions; between them a cubic spline, at rest at both ends
    """
    times, path = np.asarray(t, dtype=float), np.asarray(q, dtype=float)
    if times.ndim != 1 or path.shape != (len(times), len(model.joints)) or np.any(np.diff(times) <= 0):
        raise InputError(
            f"tracking: t must rise and q have a row for each time and a column for each of {len(model.joints)} joints"
        )
    spline = CubicSpline(times, path, bc_type="clamped")
    grid = np.linspace(times[0], times[-1], max(round((times[-1] - times[0]) * model.machine.rate_hz), 1) + 1)
    first = motion.on_motion(model, spline(grid), spline(grid, 1), spline(grid, 2), grid - grid[0]).joint_effort(0)
    forward, inertia = CubicSpline(grid, first), CubicSpline(times, motion.inertia_matrix(model, path))
    w = 2 * np.pi * bandwidth_hz

    def effort(now: float, position: FloatArray, speed: FloatArray) -> FloatArray:
        moment = min(max(now, times[0]), times[-1])
        pull = w**2 * (spline(moment) - position) + 2 * w * (spline(moment, 1) - speed)
        return np.asarray(forward(moment) + inertia(moment) @ pull)

    return effort
