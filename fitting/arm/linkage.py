"""Lever arms of linkages, their inverses, and what a wrong linkage parameter does.

A linkage maps the joint position ``q`` (rad, or m for a prismatic joint) to the piston position ``x`` (m).
The mapping itself is :meth:`daq.machine.linkages.ThreePin.piston_position` and its siblings; here are its
derivatives.

The lever arm ``r(q) = dx/dq`` (m/rad, or 1) is signed. By virtual work (``tau dq = F_l dx``) the joint effort
of a cylinder that delivers the force ``F_l`` in the direction of extension is ``tau = r(q) F_l``.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from daq.errors import InputError
from daq.machine.linkages import Direct, FourBar, Linkage, Polynomial, Rack, ThreePin, reduced
from daq.machine.machine_file import Cylinder, Joint, Machine
from fitting.arrays import FloatArray

_polynomial = np.polynomial.polynomial
#: Parameters of a four-bar linkage that a wrong length shows in, m; its points only move what these do.
_FOUR_BAR = ("rod_arm", "coupler_arm", "coupler", "retracted")
#: Sine of the opening angle that a stretched chain counts with: machine files keep away from it, noise may not.
_LEAST_SINE = 1e-6
_STEP = 1e-5  # m: differences of a closed form over twice this are right to 1e-9


def lever_arm(linkage: Linkage, q: npt.ArrayLike) -> FloatArray:
    """Compute the lever arm ``r = dx/dq``.

    Parameters
    ----------
    linkage : linkage of the machine file
    q : joint positions in rad (m), any shape; or expressions in their place, here and in all that follows

    Returns
    -------
    ndarray
        ``r`` in m/rad (m/m), shape of ``q``. For three pins ``r = a b sin(q + offset) / length``; for a four-bar
        linkage that of its rocker times the rocker's speed per unit of the joint's.
    """
    linkage, q = reduced(linkage), np.asanyarray(q) * 1.0
    if isinstance(linkage, FourBar):
        turned, ratio, _ = _rocker_motion(linkage, q)
        return lever_arm(linkage.at_rocker, turned) * ratio
    if isinstance(linkage, ThreePin):
        return np.asarray(linkage.a * linkage.b * np.sin(q + linkage.offset) / linkage.length(q))
    if isinstance(linkage, Rack):
        return np.full(q.shape, linkage.radius)
    if isinstance(linkage, Direct):
        return np.ones(q.shape)
    return np.asarray(_polynomial.polyval(q, _polynomial.polyder(np.asarray(linkage.coefficients))))


def lever_arms(machine: Machine, q: FloatArray) -> FloatArray:
    """Compute lever arms (N, n) at positions (N, n); 1 of a joint without a cylinder."""
    columns = [
        np.ones(len(q)) if joint.cylinder is None else lever_arm(joint.cylinder.linkage, q[:, j])
        for j, joint in enumerate(machine.joints)
    ]
    return np.stack(columns, axis=1)


def lever_arm_slope(linkage: Linkage, q: npt.ArrayLike) -> FloatArray:
    """Compute ``dr/dq`` in m/rad^2, shape of ``q``; ``x'' = r q'' + (dr/dq) q'^2``.

    For three pins ``r' = (a b cos(q + offset) - r^2) / length``.
    """
    linkage, q = reduced(linkage), np.asanyarray(q) * 1.0
    if isinstance(linkage, FourBar):
        turned, ratio, bend = _rocker_motion(linkage, q)
        return lever_arm_slope(linkage.at_rocker, turned) * ratio**2 + lever_arm(linkage.at_rocker, turned) * bend
    if isinstance(linkage, ThreePin):
        r = lever_arm(linkage, q)
        return np.asarray((linkage.a * linkage.b * np.cos(q + linkage.offset) - r**2) / linkage.length(q))
    if isinstance(linkage, Polynomial):
        return np.asarray(_polynomial.polyval(q, _polynomial.polyder(np.asarray(linkage.coefficients), 2)))
    return np.zeros(q.shape)


def _rocker_motion(linkage: FourBar, q: npt.ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Compute a four-bar's coupler arm direction (rad) and its first two derivatives by ``q`` (1, 1/rad).

    With ``w`` from the rocker's pivot to the coupler's pin on the link (length ``g``, bearing ``gamma``), ``u`` from
    the joint's axis to that pin, ``k`` the coupler arm and ``c`` the coupler, the arm is at ``phi = gamma +- beta``
    with ``cos beta = (k^2 + g^2 - c^2) / (2 k g)``. The pin moves on a circle, ``w' = z x u`` and ``w'' = -u`` per unit
    of ``q``, so ``g' = w . w' / g``, ``gamma' = w . u / g^2`` and so on; ``beta`` depends on ``g`` alone.
    """
    w, u = linkage.link_pin(q)
    k, c = linkage.coupler_arm, linkage.coupler
    g = np.maximum(np.linalg.norm(w, axis=-1), 1e-12)
    moved = np.stack([-u[..., 1], u[..., 0]], axis=-1)
    along = np.sum(w * u, axis=-1)
    g1 = np.sum(w * moved, axis=-1) / g
    g2 = (np.sum(u * u, axis=-1) - along - g1**2) / g
    gamma1 = along / g**2
    gamma2 = g1 / g - 2 * gamma1 * g1 / g
    cosine = linkage.closing_cosine(q)
    sine = np.sqrt(np.maximum(1.0 - cosine**2, _LEAST_SINE**2))
    slope, bend = (g**2 - k**2 + c**2) / (2 * k * g**2), (k**2 - c**2) / (k * g**3)  # of the cosine, by g
    beta1 = -slope / sine
    beta2 = -bend / sine - slope**2 * cosine / sine**3
    side = 1.0 if linkage.side == "left" else -1.0
    first = gamma1 + side * beta1 * g1
    second = gamma2 + side * (beta2 * g1**2 + beta1 * g2)
    return linkage.rocker(q), np.asarray(first), np.asarray(second)


def piston_motion(
    linkage: Linkage, q: npt.ArrayLike, qd: npt.ArrayLike, qdd: npt.ArrayLike
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Compute piston position (m), speed (m/s), acceleration (m/s^2) of a joint's motion."""
    qd, qdd = np.asanyarray(qd), np.asanyarray(qdd)
    r = lever_arm(linkage, q)
    return linkage.piston_position(q), r * qd, r * qdd + lever_arm_slope(linkage, q) * qd**2


def joint_motion(
    joint: Joint, x: npt.ArrayLike, xd: npt.ArrayLike, xdd: npt.ArrayLike
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Compute joint position, speed and acceleration of a piston's motion; inverts :func:`piston_motion`."""
    linkage = cylinder_of(joint).linkage
    xd, xdd = np.asarray(xd, dtype=float), np.asarray(xdd, dtype=float)
    q = joint_position(joint, x)
    r = lever_arm(linkage, q)
    qd = xd / r
    return q, qd, (xdd - lever_arm_slope(linkage, q) * qd**2) / r


def joint_position(joint: Joint, x: npt.ArrayLike) -> FloatArray:
    """Compute the joint position ``q(x)`` on the branch of the joint's limits.

    The machine file guarantees that ``x(q)`` is monotone within ``limits.position``, so the inverse is
    unique. Three pins are inverted in closed form with the law of cosines: ``q + offset = +-arccos((a^2 + b^2
    - length^2) / (2 a b)) + 2 pi k``. Polynomials and four-bar linkages are inverted by Newton's method from a
    table, kept inside the limits widened by 2 % of their width.

    Parameters
    ----------
    joint : joint with a cylinder
    x : piston positions in m, any shape. Positions that the linkage cannot reach (as by measurement noise beyond a
        stretched linkage) give the nearest joint position that it can; NaN remains NaN

    Returns
    -------
    ndarray
        ``q`` in rad (m), shape of ``x``.

    Raises
    ------
    InputError
        If the joint has no cylinder.
    """
    linkage = reduced(cylinder_of(joint).linkage)
    x = np.asarray(x, dtype=float)
    if isinstance(linkage, Direct):
        return x.copy()
    if isinstance(linkage, Rack):
        return x / linkage.radius + linkage.zero
    if isinstance(linkage, ThreePin):
        return _three_pin_position(linkage, sum(joint.limits.position) / 2, x)
    return _tabled_position(linkage, joint.limits.position, x)


def _three_pin_position(linkage: ThreePin, q_inside: float, x: FloatArray) -> FloatArray:
    a, b = linkage.a, linkage.b
    length = x + linkage.retracted
    # From the half angle: tan^2(phi/2) = (length^2 - (a-b)^2) / ((a+b)^2 - length^2) keeps its digits where
    # arccos loses them (a linkage near its dead centres).
    over = np.maximum(length**2 - (a - b) ** 2, 0.0)
    under = np.maximum((a + b) ** 2 - length**2, 0.0)
    magnitude = 2 * np.arctan2(np.sqrt(over), np.sqrt(under))  # 0 to pi
    phi_inside = q_inside + linkage.offset
    turns = np.round(phi_inside / (2 * np.pi))
    side = 1.0 if phi_inside - 2 * np.pi * turns >= 0 else -1.0
    return np.asarray(side * magnitude + 2 * np.pi * turns - linkage.offset)


def _tabled_position(linkage: Polynomial | FourBar, limits: tuple[float, float], x: FloatArray) -> FloatArray:
    margin = 0.02 * (limits[1] - limits[0])
    low, high = limits[0] - margin, limits[1] + margin
    table_q = np.linspace(*limits, 257)
    table_x = linkage.piston_position(table_q)
    order = np.argsort(table_x)
    q = np.interp(x, table_x[order], table_q[order])
    for _ in range(8):  # quadratic from a table's accuracy of 1e-5: two or three steps are enough
        slope = lever_arm(linkage, q)
        step = np.divide(linkage.piston_position(q) - x, slope, out=np.zeros_like(q), where=slope != 0)
        q = np.clip(q - step, low, high)
    return np.asarray(q)


def stroke_limits(joint: Joint) -> tuple[float, float]:
    """Return joint positions within both ``limits.position`` and the cylinder's stroke, rad (m).

    ``limits.position`` itself for a joint without a cylinder.
    """
    low, high = joint.limits.position
    if joint.cylinder is None:
        return low, high
    x = joint.cylinder.linkage.piston_position(np.array([low, high]))
    ends = joint_position(joint, np.clip(x, 0.0, joint.cylinder.stroke))
    return max(low, float(ends.min())), min(high, float(ends.max()))


def parameter_names(linkage: Linkage) -> tuple[str, ...]:
    """Name the linkage's parameters, in the order of :func:`parameter_derivatives`.

    Pins given by coordinates have those of the three-pin linkage that they are.
    """
    linkage = reduced(linkage)
    if isinstance(linkage, FourBar):
        return _FOUR_BAR
    if isinstance(linkage, ThreePin):
        return ("a", "b", "offset", "retracted")
    if isinstance(linkage, Rack):
        return ("radius", "zero")
    if isinstance(linkage, Polynomial):
        return tuple(f"c{k}" for k in range(len(linkage.coefficients)))
    return ()


def parameter_derivatives(linkage: Linkage, q: npt.ArrayLike) -> FloatArray:
    """Differentiate the piston position by the linkage's parameters, at fixed ``q``.

    Three pins, with ``phi = q + offset`` and ``L`` the pin distance: ``dx/da = (a - b cos phi) / L``,
    ``dx/db = (b - a cos phi) / L``, ``dx/doffset = a b sin phi / L``, ``dx/dretracted = -1``.

    Returns
    -------
    ndarray
        Shape ``q.shape + (number of parameters,)``, m per unit of the parameter, order of
        :func:`parameter_names`.
    """
    linkage, q = reduced(linkage), np.asarray(q, dtype=float)
    columns: list[FloatArray] = []
    if isinstance(linkage, FourBar):
        columns = [(up.piston_position(q) - down.piston_position(q)) / (2 * _STEP) for up, down in _varied(linkage)]
    if isinstance(linkage, ThreePin):
        a, b, length, cosine = linkage.a, linkage.b, linkage.length(q), np.cos(q + linkage.offset)
        columns = [
            (a - b * cosine) / length,
            (b - a * cosine) / length,
            lever_arm(linkage, q),
            -np.ones(q.shape),
        ]
    elif isinstance(linkage, Rack):
        columns = [q - linkage.zero, np.full(q.shape, -linkage.radius)]
    elif isinstance(linkage, Polynomial):
        columns = [q**k for k in range(len(linkage.coefficients))]
    return np.stack(columns, axis=-1) if columns else np.zeros((*q.shape, 0))


def lever_arm_derivatives(linkage: Linkage, q: npt.ArrayLike) -> FloatArray:
    """Differentiate the lever arm ``r`` by the linkage's parameters, at fixed ``q``.

    The derivative of :func:`parameter_derivatives` along ``q``, because mixed derivatives commute:
    ``dr/dp = d(dx/dp)/dq``. Three pins: with ``c = a - b cos phi`` and ``s = a b sin phi``,
    ``dr/da = (b sin phi - r c / L) / L`` and so on.
    """
    linkage, q = reduced(linkage), np.asarray(q, dtype=float)
    columns: list[FloatArray] = []
    if isinstance(linkage, FourBar):
        columns = [(lever_arm(up, q) - lever_arm(down, q)) / (2 * _STEP) for up, down in _varied(linkage)]
    if isinstance(linkage, ThreePin):
        a, b, length, r = linkage.a, linkage.b, linkage.length(q), lever_arm(linkage, q)
        sine, cosine = np.sin(q + linkage.offset), np.cos(q + linkage.offset)
        columns = [
            (b * sine - r * (a - b * cosine) / length) / length,
            (a * sine - r * (b - a * cosine) / length) / length,
            lever_arm_slope(linkage, q),
            np.zeros(q.shape),
        ]
    elif isinstance(linkage, Rack):
        columns = [np.ones(q.shape), np.zeros(q.shape)]
    elif isinstance(linkage, Polynomial):
        columns = [k * q ** (k - 1) if k else np.zeros(q.shape) for k in range(len(linkage.coefficients))]
    return np.stack(columns, axis=-1) if columns else np.zeros((*q.shape, 0))


def _varied(linkage: FourBar) -> Iterator[tuple[Linkage, Linkage]]:
    """Vary each of the linkage's parameters, a step longer and a step shorter."""
    for name in _FOUR_BAR:
        value = getattr(linkage, name)
        yield with_parameter(linkage, name, value + _STEP), with_parameter(linkage, name, value - _STEP)


def with_parameter(linkage: Linkage, name: str, value: float) -> Linkage:
    """Set one of the linkage's parameters (without what was computed from the old one)."""
    return linkage.model_validate({**linkage.model_dump(), name: value})


def cylinder_of(joint: Joint) -> Cylinder:
    """Return the cylinder of a joint that has to have one (InputError)."""
    if joint.cylinder is None:
        raise InputError("fitting.joints_no_cylinder_no", joint=joint.name)
    return joint.cylinder
