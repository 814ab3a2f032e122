"""Regressor columns of what drives a joint: the cylinder's own mass, stiffness and friction.

``m x'' + K x + f_c sgn v + f_v v + f_s |v|^(1/3) sgn v``, linear in ``[m, K, f_c, f_v, f_s]`` (the known damping
``c v`` and a known moving mass are moved to the left-hand side). A joint driven directly has ``[J, f_c, f_v]``.

A measured speed near zero has the wrong sign every so often, and a regressor built from it is then wrong by a
lot. So the sign and the cube root are replaced by their expectation given the measured speed and its noise
("regression calibration", Carroll et al., *Measurement Error in Nonlinear Models*, 2006, ch. 4); a few noise widths
away from zero nothing changes.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from scipy.special import erf, gamma, hyp1f1

from daq.machine_file import Joint, Machine
from fitting.base_parameters import reduce_parameters

FloatArray = npt.NDArray[np.float64]

UNITS = {"m": "kg", "K": "N/m", "f_c": "N", "f_v": "N s/m", "f_s": "N (s/m)^(1/3)", "J": "kg m^2"}
#: Noise widths from zero beyond which two terms of a series say what a speed's noise does to a power of it.
_FAR = 6.0


def expected_sign(speed: npt.ArrayLike, noise: float) -> FloatArray:
    """``E[sgn(v)]`` for a measured ``speed`` with Gaussian noise of that standard deviation."""
    speed = np.asarray(speed, dtype=float)
    return np.sign(speed) if noise <= 0 else np.asarray(erf(speed / (np.sqrt(2.0) * noise)))


def expected_power(speed: npt.ArrayLike, noise: float, exponent: float) -> FloatArray:
    """``E[|v|^p sgn(v)]`` for a measured ``speed`` with Gaussian noise of that standard deviation.

    With ``u = speed / noise``: ``noise^p 2^((p+1)/2) Gamma(1 + p/2) / sqrt(pi) u M((1-p)/2, 3/2, -u^2/2)``, ``M``
    Kummer's function (the normal distribution's signed fractional moments; Abramowitz and Stegun, ch. 13); beyond six
    noise widths its asymptotic series, which is good to 1e-4 there.
    """
    speed = np.asarray(speed, dtype=float)
    power = np.abs(speed) ** exponent * np.sign(speed)
    if noise <= 0:
        return np.asarray(power)
    p, u = exponent, speed / noise
    near = np.abs(u) < _FAR
    factor = noise**p * 2 ** ((p + 1) / 2) * gamma(1 + p / 2) / np.sqrt(np.pi)
    inverse = (noise / speed[~near]) ** 2
    power[~near] *= 1 + p * (p - 1) / 2 * inverse * (1 + (p - 2) * (p - 3) / 4 * inverse)
    power[near] = factor * u[near] * hyp1f1((1 - p) / 2, 1.5, -(u[near] ** 2) / 2)
    return np.asarray(power)


def drive_names(machine: Machine) -> tuple[tuple[str, ...], ...]:
    """Per joint the names of its drive parameters, in the order of :func:`drive_columns`.

    A directly driven joint's inertia ``J`` is listed only where it can be told from the links' inertias at all.
    """
    told: set[str] = set()
    if any(joint.cylinder is None for joint in machine.joints):
        base = reduce_parameters(machine, friction_by_stage_1=False)
        told = {base.standard_names[i] for i in base.independent}
    names: list[tuple[str, ...]] = []
    for number, joint in enumerate(machine.joints, start=1):
        if joint.cylinder is not None:
            known = joint.cylinder.moving_mass is not None
            names.append(("K", "f_c", "f_v", "f_s") if known else ("m", "K", "f_c", "f_v", "f_s"))
        else:
            names.append(("J", "f_c", "f_v") if f"J{number}" in told else ("f_c", "f_v"))
    return tuple(names)


def drive_columns(
    names: tuple[str, ...], x: FloatArray, v: FloatArray, a: FloatArray, speed_noise: float
) -> FloatArray:
    """Columns for the named drive parameters, (N, len(names)); ``x``, ``v``, ``a`` are (N,) of the driving element."""
    makers: dict[str, Callable[[], FloatArray]] = {
        "m": lambda: a,
        "J": lambda: a,
        "K": lambda: x,
        "f_c": lambda: expected_sign(v, speed_noise),
        "f_v": lambda: v,
        "f_s": lambda: expected_power(v, speed_noise, 1 / 3),
    }
    return np.stack([makers[name]() for name in names], axis=1)


def known_effort(joint: Joint, v: FloatArray, a: FloatArray) -> FloatArray:
    """The part of the drive effort that the machine file already knows: ``c v``, and ``m x''`` if the mass is given."""
    if joint.cylinder is None:
        return np.zeros_like(v)
    mass = joint.cylinder.moving_mass or 0.0
    return joint.cylinder.damping * v + mass * a
