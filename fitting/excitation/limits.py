"""Limits that a motion must keep, and how much of each it uses."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from daq.errors import InputError
from daq.machine.machine_file import Cylinder, Machine
from fitting.arm.base_parameters import BaseParameters, base_regressor, reduce_parameters
from fitting.arm.linkage import lever_arm, lever_arm_slope, lever_arms, piston_motion
from fitting.arrays import FloatArray


@dataclass(frozen=True)
class LimitUse:
    """Share of one limit that a motion uses.

    Attributes
    ----------
    joint : joint name; None for the supply, which all cylinders share
    quantity : ``position``, ``velocity``, ``acceleration``, ``stroke``, ``pressure`` or ``flow``
    used : share of the limit, 0 to 1. Of positions and strokes: of the way from mid-range to the nearer end
    reached, limit : the extreme value and the limit that it is nearest to, in ``unit``
    unit : SI unit of both
    """

    joint: str | None
    quantity: str
    used: float
    reached: float
    limit: float
    unit: str


@dataclass(frozen=True)
class HydraulicLimits:
    """Limits of the supply; any of them may be None.

    Attributes
    ----------
    flow : flow that the pump delivers to all cylinders together, m^3/s. Demand is ``sum A |x'|`` with the area of the
        chamber that is being filled
    pressure : highest chamber pressure, Pa. It needs a guess of the arm's parameters
    back_pressure : pressure in the chamber that is being emptied, Pa
    base_parameters : guess of the base parameters (nb,), from an earlier identification or from drawings, for the
        efforts
    friction : guess of each cylinder's friction force (n,) in N, added to the load; zero if None
    """

    flow: float | None = None
    pressure: float | None = None
    back_pressure: float = 0.0
    base_parameters: FloatArray | None = None
    friction: FloatArray | None = None

    def __post_init__(self) -> None:
        if self.pressure is not None and self.base_parameters is None:
            raise ValueError("a pressure limit needs base_parameters to compute efforts from")


def limits_of_machine(
    machine: Machine,
    base_parameters: FloatArray,
    friction: FloatArray | None = None,
    *,
    flow: float | None = None,
    pressure: float | None = None,
) -> HydraulicLimits:
    """Return the machine file's supply limits, for planning.

    Parameters
    ----------
    machine : ``hydraulics.pump_flow``, ``supply_pressure`` and ``tank_pressure`` are looked at; a machine without
        cylinders has no such limits
    base_parameters, friction : as in :class:`HydraulicLimits`
    flow, pressure : in place of the file's, m^3/s and Pa
    """
    if all(joint.cylinder is None for joint in machine.joints):
        return HydraulicLimits()
    supply = machine.hydraulics
    if supply is not None:
        flow = supply.pump_flow if flow is None else flow
        pressure = supply.supply_pressure if pressure is None else pressure
    if pressure is None:
        return HydraulicLimits(flow=flow)
    back = 0.0 if supply is None else supply.tank_pressure
    return HydraulicLimits(flow, pressure, back, base_parameters, friction)


def supply_flow(machine: Machine, q: FloatArray, qd: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Compute the flow that all cylinders take, and its derivatives.

    A cylinder that extends fills its head side (area A1), one that retracts its rod side (A2): ``A |r(q)
    q'|``.

    Returns
    -------
    tuple of ndarray
        Flow (N,) in m^3/s; derivatives with respect to ``q`` and ``q'``, each (N, n).
    """
    flow = np.zeros(q.shape[0])
    by_q, by_qd = np.zeros(q.shape), np.zeros(q.shape)
    for i, joint in enumerate(machine.joints):
        if joint.cylinder is None:
            continue
        r, slope = lever_arm(joint.cylinder.linkage, q[:, i]), lever_arm_slope(joint.cylinder.linkage, q[:, i])
        speed = r * qd[:, i]
        signed_area = np.where(speed > 0, joint.cylinder.head_area, -joint.cylinder.rod_area)
        flow += signed_area * speed
        by_q[:, i] = signed_area * slope * qd[:, i]
        by_qd[:, i] = signed_area * r
    return flow, by_q, by_qd


def chamber_pressure(
    cylinder: Cylinder, q: FloatArray, tau: FloatArray, friction: float, back_pressure: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Compute the working chamber's pressure for the effort ``tau``, and its derivatives.

    With ``F = tau / r``: pushing, ``p1 = (F + f + p_back A2) / A1``; pulling, ``p2 = (-F + f + p_back A1) / A2``; the
    larger of the two. Friction ``f`` is taken at its worst, against the load's help.

    Returns
    -------
    tuple of ndarray
        Pressure in Pa and its derivatives with respect to ``q`` and ``tau``, each (N,).
    """
    r, slope = lever_arm(cylinder.linkage, q), lever_arm_slope(cylinder.linkage, q)
    force = tau / r
    push = (force + friction + back_pressure * cylinder.rod_area) / cylinder.head_area
    pull = (-force + friction + back_pressure * cylinder.head_area) / cylinder.rod_area
    per_force = np.where(push >= pull, 1 / cylinder.head_area, -1 / cylinder.rod_area)
    return np.maximum(push, pull), -per_force * force * slope / r, per_force / r


def chamber_pressures(
    machine: Machine, limits: HydraulicLimits, q: FloatArray, tau: FloatArray
) -> Iterator[tuple[int, FloatArray, FloatArray, FloatArray]]:
    """Compute :func:`chamber_pressure` of each cylinder, by its joint's number; ``q``, ``tau`` (N, n)."""
    for i, joint in enumerate(machine.joints):
        if joint.cylinder is not None:
            friction = 0.0 if limits.friction is None else float(limits.friction[i])
            yield i, *chamber_pressure(joint.cylinder, q[:, i], tau[:, i], friction, limits.back_pressure)


def joint_numbers(machine: Machine, names: Sequence[str] | None) -> list[int]:
    """Return the numbers of the joints with these names, all for None.

    Raises
    ------
    InputError
        For a name that no joint has.
    """
    known = [joint.name for joint in machine.joints]
    for name in names or ():
        if name not in known:
            raise InputError("fitting.no_such_joint", name=name, machine=machine.name, known=", ".join(known))
    return [number for number, name in enumerate(known) if names is None or name in names]


def holding_efforts(machine: Machine, base: BaseParameters, values: FloatArray, q: FloatArray) -> FloatArray:
    """Compute drive efforts (N, n) that hold an arm with these base parameters (nb,) in poses (N, n)."""
    still = np.zeros_like(q)
    return np.asarray(base_regressor(machine, base, q, still, still) @ values / lever_arms(machine, q))


def limits_used(
    machine: Machine,
    limits: HydraulicLimits,
    q: FloatArray,
    qd: FloatArray,
    qdd: FloatArray,
    base: BaseParameters | None = None,
) -> tuple[LimitUse, ...]:
    """Compute a motion's use of every limit, arrays (N, n); ``base`` belongs to the guess in ``limits``."""
    tau = None
    if limits.pressure is not None and limits.base_parameters is not None:
        tau = base_regressor(machine, base or reduce_parameters(machine), q, qd, qdd) @ limits.base_parameters
    return joint_limits_used(machine, q, qd, qdd) + hydraulic_limits_used(machine, limits, q, qd, tau)


def joint_limits_used(machine: Machine, q: FloatArray, qd: FloatArray, qdd: FloatArray) -> tuple[LimitUse, ...]:
    """Compute every moving joint's use of position, velocity, acceleration and stroke; arrays (N, n)."""
    uses: list[LimitUse] = []
    for i, joint in enumerate(machine.joints):
        if np.abs(qd[:, i]).max() <= 1e-9 * joint.limits.velocity:
            continue
        unit = "rad" if joint.type == "revolute" else "m"
        uses.append(interval_use(joint.name, "position", q[:, i], joint.limits.position, unit))
        uses.append(size_use(joint.name, "velocity", qd[:, i], joint.limits.velocity, f"{unit}/s"))
        uses.append(size_use(joint.name, "acceleration", qdd[:, i], joint.limits.acceleration, f"{unit}/s^2"))
        if joint.cylinder is not None:
            x, _, _ = piston_motion(joint.cylinder.linkage, q[:, i], qd[:, i], qdd[:, i])
            uses.append(interval_use(joint.name, "stroke", x, (0.0, joint.cylinder.stroke), "m"))
    return tuple(uses)


def interval_use(joint: str, quantity: str, values: FloatArray, interval: tuple[float, float], unit: str) -> LimitUse:
    """Compute the use of an interval by values (N,), of the way from middle to the nearer end."""
    middle, half = sum(interval) / 2, (interval[1] - interval[0]) / 2
    extreme = float(values[np.argmax(np.abs(values - middle))])
    limit = interval[1] if extreme >= middle else interval[0]
    return LimitUse(joint, quantity, abs(extreme - middle) / half, extreme, limit, unit)


def size_use(joint: str | None, quantity: str, values: FloatArray, limit: float, unit: str) -> LimitUse:
    """Compute the use of a limit by the largest size of values (N,)."""
    largest = float(np.abs(values).max())
    return LimitUse(joint, quantity, largest / limit, largest, limit, unit)


def hydraulic_limits_used(
    machine: Machine, limits: HydraulicLimits, q: FloatArray, qd: FloatArray, tau: FloatArray | None
) -> tuple[LimitUse, ...]:
    """Compute the use of supply flow and chamber pressures; ``tau`` (N, n) in N m (N) for pressures only."""
    uses: list[LimitUse] = []
    if limits.flow is not None:
        flow, _, _ = supply_flow(machine, q, qd)
        uses.append(size_use(None, "flow", flow, limits.flow, "m^3/s"))
    if limits.pressure is not None and tau is not None:
        for i, pressure, _, _ in chamber_pressures(machine, limits, q, tau):
            high = np.maximum(pressure, 0.0)
            uses.append(size_use(machine.joints[i].name, "pressure", high, limits.pressure, "Pa"))
    return tuple(uses)
