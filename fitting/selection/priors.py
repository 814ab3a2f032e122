"""Prior knowledge: the constants of the selection, each with where it comes from."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

#: Chances that nothing is missing, that an effect of the catalogue is, that something outside it is: as often one as
#: the other, and an effect of the catalogue four times as often as an unknown one.
NOTHING, CATALOGUE, UNKNOWN = 0.5, 0.4, 0.1
#: Smallest amplitude worth a name, standard deviations; amplitudes are averaged in steps of this ratio.
SMALLEST, RATIO = 3.0, 3.0
#: Correlation lengths of a law of nature along a signal, in sixteenths of its range.
LENGTHS = (1.0, 2.0, 4.0, 8.0)
#: From this one of them on a curve is smooth all along: what a short series of its signal represents.
SMOOTH = 2
#: Chance that a law of an unknown effect is one of a few simple formulas rather than any smooth curve: nobody knows.
SIMPLE = 0.5
#: How far nature is from a formula, as share of what is visible of the effect: of laws of physics, and of short series
#: that represent any smooth law; with their weights.
EPSILONS = (0.03, 0.1, 0.15)
PHYSICS, SERIES = (0.4, 0.4, 0.2), (0.2, 0.4, 0.4)
#: The same for whatever a joint still lacks beside an effect that was found on it, in other variables.
LEFTOVERS = (0.03, 0.07, 0.12)
LEFTOVER_WEIGHTS = (0.45, 0.45, 0.1)
#: Share of it that shows on other joints, through the rigid body they have in common.
SPILL = 0.1
#: Probability from which on something is reported; a name alone, rather than a law with the names that it may be.
CREDIBLE = 0.95
#: The same as log odds.
CREDIBLE_ODDS = float(np.log(CREDIBLE / (1 - CREDIBLE)))
#: Probability, beside unknown laws, from which on several names are reported, and down to which one is kept: a wrong
#: name sends somebody to the wrong part, which costs several times what an unnamed law does.
NAMED = 0.8
#: A machine as it usually is, for what it takes before any data: effects times joints, and the whitened effort.
USUAL_FAMILIES, USUAL_EFFORT = 120, 2000.0
#: Difference of chi-square at which one explanation is that probable beside another.
CLOSE = 2.0 * CREDIBLE_ODDS
#: Most effects that are looked for.
MOST = 4


def weights(series: bool) -> tuple[float, ...]:
    """Return weights of :data:`EPSILONS` for a short series for any smooth law, or for a law of physics."""
    return SERIES if series else PHYSICS


def amplitudes(largest: float) -> npt.NDArray[np.float64]:
    """Return the grid of amplitudes from the smallest one to ``largest``."""
    steps = max(1, int(np.ceil(np.log(max(largest, SMALLEST) / SMALLEST) / np.log(RATIO))))
    return np.asarray(SMALLEST * RATIO ** np.arange(steps + 1))
