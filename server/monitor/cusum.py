"""Two-sided cumulative sums on standard normal numbers, with the false-alarm rate that theory states.

Page (1954)::

    S+ <- max(0, S+ + z - k)        S- <- max(0, S- - z - k)        alarm when S+ or S- reaches h

Siegmund (1985, *Sequential Analysis*, section 2.6): with no change the one-sided sum's average run length is about
``(exp(2 k b) - 2 k b - 1) / (2 k^2)``, ``b = h + 1.166``: 1.166 is twice the mean overshoot 0.583 of a normal random
walk. Two sides: ``1 / ARL = 1 / ARL+ + 1 / ARL-``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import scipy

OVERSHOOT = 1.166
#: The allowance: half of the shift (in standard deviations) that is to be found soonest.
ALLOWANCE = 0.5
#: A number beyond so many standard deviations counts as that many: one wild block is no drift.
CLIP = 4.0


@dataclass(frozen=True)
class Sums:
    """Both sums; they are kept below twice the threshold, so that a cause that went is forgotten in finite time."""

    up: float = 0.0
    down: float = 0.0

    @property
    def larger(self) -> float:
        """The larger of the two."""
        return max(self.up, self.down)


def step(sums: Sums, z: float, threshold: float, allowance: float = ALLOWANCE) -> Sums:
    """Return the sums after one more number."""
    z = min(max(z, -CLIP), CLIP)
    most = 2.0 * threshold
    return Sums(
        up=min(most, max(0.0, sums.up + z - allowance)),
        down=min(most, max(0.0, sums.down - z - allowance)),
    )


def run_length(threshold: float, allowance: float = ALLOWANCE) -> float:
    """Compute the mean number of standard normals until a false alarm of both sides together (Siegmund)."""
    x = 2.0 * allowance * (threshold + OVERSHOOT)
    return (math.expm1(x) - x) / (2.0 * allowance**2) / 2.0


def threshold_for(numbers: float, allowance: float = ALLOWANCE) -> float:
    """Compute the threshold at which a false alarm comes once in so many numbers.

    Raises
    ------
    ValueError
        If ``numbers`` is below what a threshold of 0 gives.
    """
    low = run_length(0.0, allowance)
    if numbers < low:
        raise ValueError(f"an average run of {numbers:g} is below {low:.3g}, that of a threshold of zero")
    high = math.log(4.0 * allowance**2 * numbers + 2.0) / (2.0 * allowance) + 10.0
    return float(scipy.optimize.brentq(lambda h: run_length(h, allowance) - numbers, 0.0, high))
