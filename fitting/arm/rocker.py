"""How a four-bar linkage's rocker turns with the joint: direction and two derivatives, in closed form.

With ``w`` from the rocker's pivot to the coupler's pin on the link (length ``g``, bearing ``gamma``), ``u`` from the
joint's axis to that pin, ``k`` the rocker's coupler arm and ``c`` the coupler, the arm stands at ``phi = gamma +-
beta`` with ``cos beta = (k^2 + g^2 - c^2) / (2 k g)``. The pin moves on a circle, ``w' = z x u`` and ``w'' = -u`` per
unit of ``q``, so ``g' = w . w' / g``, ``gamma' = w . u / g^2`` and so on; ``beta`` depends on ``g`` alone.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from daq.machine.linkages import FourBar
from fitting.arrays import FloatArray

#: Sine of the opening angle that a stretched chain counts with: machine files keep away from it, noise may not.
_LEAST_SINE = 1e-6


def rocker_motion(linkage: FourBar, q: npt.ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Direction of the rocker's coupler arm (rad) and its first and second derivative by ``q`` (1, 1/rad)."""
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
