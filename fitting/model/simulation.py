"""Motion from efforts: the model integrated by scipy.

A sign of speed is no right-hand side for an integrator. Here it is the expectation of the sign under the noise of the
measured speed, as the fit had it: smooth, and as wide as that noise. What holds an arm still by dry friction therefore
creeps, slower than that width; :attr:`Simulated.friction_speed` is that width.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import scipy
from scipy.linalg.lapack import dpotrf, dpotrs

from daq.errors import HilfitError, InputError
from fitting.arm.expected import FAR
from fitting.arrays import FloatArray
from fitting.model import motion
from fitting.model.arm_model import ArmModel
from fitting.model.export.functions import indexed, moving_functions
from fitting.model.export.printing import PYTHON
from fitting.model.export.tracing.graph import BINARY, UNARY
from fitting.model.export.tracing.tracing import Tracer

#: Joint efforts (n,) at a time, position and speed.
Efforts = Callable[[float, FloatArray, FloatArray], npt.ArrayLike]
#: Integrators of scipy.
Method = Literal["RK23", "RK45", "DOP853", "Radau", "BDF", "LSODA"]

_RELATIVE, _ABSOLUTE = 1e-6, 1e-8


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
    method: Method = "BDF",
    temperature: float | None = None,
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
    temperature : of the oil, K, for laws of it
    possible : take the nearest model whose drives have no inertia below zero
    within_s : s of ``clock`` after which it gives up
    clock : seconds that pass, from any beginning

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
        raise InputError("fitting.simulate_other_state", joints=n)
    if not seconds > 0:
        raise InputError("fitting.simulate_no_time", seconds=seconds)
    plant, ends = _plant(model, friction_speed or 0.0, possible), clock() + within_s
    if plant.heated and temperature is None:
        raise InputError("fitting.simulate_needs_temperature")
    oil = (temperature,) if plant.heated and temperature is not None else ()

    def slope(t: float, state: FloatArray) -> FloatArray:
        if clock() > ends:
            raise HilfitError("fitting.simulate_too_long", time=t, within=within_s)
        position, speed = state[:n], state[n:]
        return np.concatenate(
            [speed, plant.acceleration(t, position, speed, np.asarray(effort(t, position, speed)), oil)]
        )

    rate = rate_hz or model.machine.rate_hz
    times = np.arange(round(seconds * rate) + 1) / rate
    found = scipy.integrate.solve_ivp(
        slope, (0.0, times[-1]), np.concatenate(start), method, times, rtol=_RELATIVE, atol=_ABSOLUTE
    )
    if not found.success or not np.isfinite(found.y).all():
        raise HilfitError("fitting.simulate_gave_up", reason=found.message)
    positions, speeds = found.y[:n].T, found.y[n:].T
    efforts = np.array([np.asarray(effort(t, a, b)) for t, a, b in zip(times, positions, speeds, strict=True)])
    return Simulated(
        t=times,
        q=positions,
        qd=speeds,
        qdd=np.array([plant.acceleration(*row, oil) for row in zip(times, positions, speeds, efforts, strict=True)]),
        effort=efforts,
        friction_speed=np.array([own.sign for own in plant.model.noise]),
        left_out=plant.left_out,
    )


@dataclass(frozen=True)
class _Plant:
    """The model as an equation of motion.

    Attributes
    ----------
    model : with signs of speed that can be integrated
    functions : ``effort`` and ``inertia`` of a moment
    holds_force, heated : whether effects depend on the drives' forces, or on the oil's temperature
    """

    model: ArmModel
    functions: Mapping[str, Callable[..., list[float]]]
    holds_force: bool
    heated: bool
    left_out: tuple[str, ...]

    def acceleration(
        self, t: float, q: FloatArray, qd: FloatArray, effort: FloatArray, oil: tuple[float, ...]
    ) -> FloatArray:
        """Compute joint accelerations (n,) under joint efforts (n,), with the oil's temperature if needed."""
        position, speed = q.tolist(), qd.tolist()
        inertia = np.array(self.functions["inertia"](position, t, *oil)).reshape(len(q), len(q))
        factor, failed = dpotrf(inertia)
        if failed or np.any(np.diagonal(factor) ** 2 < motion.DEFINITE * np.diagonal(inertia)):
            wrong = motion.worst_pose(self.model, q[None], inertia[None])  # beyond the limits of the joints
            raise InputError("fitting.simulate_not_definite", reason="" if wrong is None else wrong.text)

        def needed(found: FloatArray) -> FloatArray:
            return np.array(self.functions["effort"](position, speed, found.tolist(), t, *oil))

        return motion.settled(lambda own: dpotrs(factor, own)[0], needed, effort, once=not self.holds_force)


@lru_cache(maxsize=8)  # tracing and the look at all poses cost as much as a second of motion
def _plant(model: ArmModel, friction_speed: float, possible: bool) -> _Plant:
    model = motion.nearest_possible(model) if possible else model
    wrong = motion.indefinite(model)
    if wrong is not None:
        raise InputError("fitting.simulate_plant_not_definite", reason=wrong.text)
    tracer = Tracer(motion.integrable(model, friction_speed))
    holds_force = any(term.uses_model for term in motion.at_rest(tracer.carried).terms)
    return _Plant(tracer.model, _compiled(tracer), holds_force, bool(tracer.oil), tuple(tracer.left_out))


def tracking(
    model: ArmModel, t: npt.ArrayLike, q: npt.ArrayLike, *, bandwidth_hz: float = 2.0, temperature: float | None = None
) -> Efforts:
    """Make a controller that follows a motion: the model's efforts, and feedback to the motion.

    ``effort(q_r, q_r', q_r'') + M(q_r) (w^2 (q_r - q) + 2 w (q_r' - q'))``, ``w`` the bandwidth: critically damped.

    Parameters
    ----------
    t, q : (N,) s from 0, (N, n) positions; between them a cubic spline, at rest at both ends
    bandwidth_hz : of the feedback
    temperature : of the oil, K, for laws of it
    """
    times, path = np.asarray(t, dtype=float), np.asarray(q, dtype=float)
    if times.ndim != 1 or path.shape != (len(times), len(model.joints)) or np.any(np.diff(times) <= 0):
        raise InputError("fitting.tracking_other_shape", count=len(model.joints))
    spline = scipy.interpolate.CubicSpline(times, path, bc_type="clamped")
    grid = np.linspace(times[0], times[-1], max(round((times[-1] - times[0]) * model.machine.rate_hz), 1) + 1)
    moved = motion.on_motion(
        model, spline(grid), spline(grid, 1), spline(grid, 2), grid - grid[0], temperature=temperature
    )
    first = moved.joint_effort(0)
    forward = scipy.interpolate.CubicSpline(grid, first)
    inertia = scipy.interpolate.CubicSpline(times, motion.inertia_matrix(model, path))
    w = 2 * np.pi * bandwidth_hz

    def effort(now: float, position: FloatArray, speed: FloatArray) -> FloatArray:
        moment = min(max(now, times[0]), times[-1])
        pull = w**2 * (spline(moment) - position) + 2 * w * (spline(moment, 1) - speed)
        return np.asarray(forward(moment) + inertia(moment) @ pull)

    return effort


def _compiled(tracer: Tracer) -> dict[str, Callable[..., list[float]]]:
    """Make :func:`~fitting.model.export.functions.moving_functions` functions of Python, by name."""
    namespace: dict[str, Any] = {
        **(UNARY | BINARY),
        "np": np,
        "maximum": max,
        "minimum": min,
        "signed_power": _scalar_power,
        "curve": lambda x, own: own.at(x),
        "CURVES": {k: (own,) for k, own in enumerate(tracer.graph.curves)},
    }
    functions = moving_functions(tracer)
    for own in functions:
        lines, words = own.body(PYTHON, indexed)
        (result,) = words.values()
        text = [f"def {own.name}({', '.join(own.arguments)}):", *lines, f"return [{', '.join(result)}]"]
        exec("\n    ".join(text), namespace)  # our own text, from numbers
    return {own.name: namespace[own.name] for own in functions}


def _scalar_power(v: float, noise: float, p: float, factor: float) -> float:
    if noise > 0 and abs(v) < FAR * noise:
        u = v / noise
        return factor * u * float(scipy.special.hyp1f1((1.0 - p) / 2.0, 1.5, -0.5 * u * u))
    inverse = (noise / v) ** 2 if v else 0.0
    series = 1.0 + p * (p - 1.0) / 2.0 * inverse * (1.0 + (p - 2.0) * (p - 3.0) / 4.0 * inverse)
    return math.copysign(abs(v) ** p * series, v)
