"""Regressor columns of what drives a joint: the cylinder's own mass, stiffness and friction.

``m x'' + K x + f_c sgn v + f_v v + f_s |v|^(1/3) sgn v``, linear in ``[m, K, f_c, f_v, f_s]`` (the known damping
``c v``, a known moving mass and a measured external force are moved to the left-hand side). A joint driven directly
has ``[J, f_c, f_v]``, and ``f_0``, the zero of its effort, where the machine file asks for it (``drive.offset``). What
belongs to a motor that turns with several joints is among the base parameters (:mod:`fitting.arm.base_parameters`).

Sign and cube root are their expectations under the speed's noise (:mod:`fitting.arm.expected`).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from daq.machine.machine_file import Joint, Machine
from fitting.arm.base_parameters import reduce_parameters
from fitting.arm.expected import expected_power, expected_sign
from fitting.arrays import FloatArray
from fitting.signals.filters import advanced

UNITS = {"m": "kg", "K": "N/m", "f_c": "N", "f_v": "N s/m", "f_s": "N (s/m)^(1/3)", "J": "kg m^2"}


def effort_unit(joint: Joint) -> str:
    """Return a drive's unit: N of a piston, the joint's own where there is none."""
    return UNITS["f_c"] if joint.cylinder is not None else joint.effort_unit


def drive_units(joint: Joint) -> dict[str, str]:
    """Return the units of a drive's parameters by name."""
    if joint.cylinder is not None:
        return UNITS
    effort, revolute = joint.effort_unit, joint.effort_unit == "N m"
    inertia, viscous = ("kg m^2", "N m s/rad") if revolute else ("kg", "N s/m")
    return {"J": inertia, "f_c": effort, "f_v": viscous, "f_0": effort}


def drive_names(machine: Machine) -> tuple[tuple[str, ...], ...]:
    """Return per joint its drive parameters' names, in the order of :func:`drive_columns`.

    A directly driven joint's inertia ``J`` is listed only where it is separable from the links' inertias.
    """
    independent: set[str] = set()
    if any(joint.cylinder is None for joint in machine.joints):
        base = reduce_parameters(machine, friction_by_stage_1=False)
        independent = {base.standard_names[i] for i in base.independent}
    names: list[tuple[str, ...]] = []
    for number, joint in enumerate(machine.joints, start=1):
        if joint.cylinder is not None:
            known = joint.cylinder.moving_mass is not None
            names.append(("K", "f_c", "f_v", "f_s") if known else ("m", "K", "f_c", "f_v", "f_s"))
        else:
            inertia = ("J",) if f"J{number}" in independent else ()
            offset = ("f_0",) if joint.drive is not None and joint.drive.offset else ()
            names.append((*inertia, "f_c", "f_v", *offset))
    return tuple(names)


#: Drive parameters whose columns turn with the speed's sign.
JUMPING = ("f_c", "f_s")


def drive_columns(
    names: tuple[str, ...], x: FloatArray, v: FloatArray, a: FloatArray, speed_noise: float, late: float = 0.0
) -> FloatArray:
    """Compute named drive parameters' columns, (N, len(names)); ``x``, ``v``, ``a`` (N,) of the driving element.

    Parameters
    ----------
    late : samples by which the effort came late and was moved. Its jumps were sampled where they arrived, somewhere
        between two samples of the motion, and keep it when it is moved; columns that jump are made in the same way
    """

    def jumping(of: Callable[[FloatArray], FloatArray]) -> FloatArray:
        return advanced(of(advanced(v, -late)), late)

    makers: dict[str, Callable[[], FloatArray]] = {
        "m": lambda: a,
        "J": lambda: a,
        "K": lambda: x,
        "f_c": lambda: jumping(lambda speed: expected_sign(speed, speed_noise)),
        "f_v": lambda: v,
        "f_s": lambda: jumping(lambda speed: expected_power(speed, speed_noise, 1 / 3)),
        "f_0": lambda: np.ones_like(v),
    }
    return np.stack([makers[name]() for name in names], axis=1)


def known_effort(joint: Joint, v: FloatArray, a: FloatArray, external: FloatArray | None = None) -> FloatArray:
    """Compute the known drive effort: ``c v``, ``m x''`` if the mass is given, a measured outside force."""
    if joint.cylinder is None:
        return np.zeros_like(v)
    known = joint.cylinder.damping * v + (joint.cylinder.moving_mass or 0.0) * a
    return known if external is None else known + external
