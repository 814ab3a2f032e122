"""Sign and powers of a measured speed, as their expectations under its noise.

A measured speed near zero has the wrong sign every so often, and a regressor built from it is then wrong by a
lot. So the sign and the cube root are replaced by their expectation given the measured speed and its noise
("regression calibration", Carroll et al., *Measurement Error in Nonlinear Models*, 2006, ch. 4); a few noise widths
away from zero nothing changes.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import scipy

from fitting.arrays import FloatArray

#: Noise widths from zero beyond which two terms of a series state what a speed's noise does to a power of it.
FAR = 6.0


def expected_sign(speed: npt.ArrayLike, noise: float) -> FloatArray:
    """Compute ``E[sgn(v)]`` for a measured ``speed`` with Gaussian noise of that standard deviation."""
    speed = np.asanyarray(speed)
    return np.asanyarray(np.sign(speed) if noise <= 0 else scipy.special.erf(speed / (np.sqrt(2.0) * noise)))


def expected_power(speed: npt.ArrayLike, noise: float, exponent: float) -> FloatArray:
    """Compute ``E[|v|^p sgn(v)]`` for a measured ``speed`` with Gaussian noise of that standard deviation.

    With ``u = speed / noise``: ``noise^p 2^((p+1)/2) Gamma(1 + p/2) / sqrt(pi) u M((1-p)/2, 3/2, -u^2/2)``, ``M``
    Kummer's function (the normal distribution's signed fractional moments; Abramowitz and Stegun, ch. 13); beyond six
    noise widths its asymptotic series, which is good to 1e-4 there.
    """
    if hasattr(speed, "expected_power"):  # expressions have a word of their own for it
        return np.asanyarray(speed.expected_power(noise, exponent))
    speed = np.asarray(speed, dtype=float)
    power = np.abs(speed) ** exponent * np.sign(speed)
    if noise <= 0:
        return np.asarray(power)
    p, u = exponent, speed / noise
    near = np.abs(u) < FAR
    factor = noise**p * 2 ** ((p + 1) / 2) * scipy.special.gamma(1 + p / 2) / np.sqrt(np.pi)
    inverse = (noise / speed[~near]) ** 2
    power[~near] *= 1 + p * (p - 1) / 2 * inverse * (1 + (p - 2) * (p - 3) / 4 * inverse)
    power[near] = factor * u[near] * scipy.special.hyp1f1((1 - p) / 2, 1.5, -(u[near] ** 2) / 2)
    return np.asarray(power)
