"""What a controller in front of a valve already does about its dead band, read out of the commands that it sent.

A controller that compensates a dead band jumps over it: between rest and the compensated edge it sends nothing. One
that does not, and an operator's lever, pass through these commands whenever the axis sets off. So of each run of
commands to one side the smallest one counts, runs being independent of one another: where ``n`` of them lie between
an edge and twice the edge and none below it, an even spread between both is ``2^n`` times less likely.
"""

from __future__ import annotations

import numpy as np

from fitting.arrays import FloatArray, IntArray

#: Share of full command: less is no dead band, and an axis that is never told more stays where it is.
REST = 0.01
#: Natural logarithm of the odds of 95 %.
_SURE = float(np.log(19.0))


def compensated_edge(u: FloatArray, first: IntArray) -> float | None:
    """The edge that a controller jumps to, as share of full command; None where it does not, or nobody can tell.

    Parameters
    ----------
    u : (N,) commands, positive to the side that is asked for, as share of full
    first : (N,) place of the first sample of the stretch that each sample is in
    """
    told = u > 0.0
    starts = np.flatnonzero(told & ~(np.r_[False, told[:-1]] & (first == np.r_[-1, first[:-1]])))
    if not len(starts):
        return None
    runs = np.minimum.reduceat(np.where(told, u, np.inf), starts)
    least = np.sort(runs[np.maximum.reduceat(u, starts) > REST])
    if not len(least):
        return None
    below = np.searchsorted(least, least, side="left")
    above = np.searchsorted(least, 2.0 * least, side="right") - below
    both = np.maximum(below + above, 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        odds = np.where(below > 0, below * np.log(2.0 * below / both), 0.0) + above * np.log(2.0 * above / both)
    odds = np.where((above > below) & (least > REST), odds, 0.0)
    best = int(np.argmax(odds))
    return float(least[best]) if odds[best] > _SURE else None
