"""How much noisier the rows that show an effect are than the noise model says.

The noise is measured where a motion was made twice, over all of it alike, and within some per cent. Where it depends on
the motion (a sign that is unsure near reversals, knocks) or hangs together for longer than was heard, chance reaches
further for an effect that acts just there. What its rows say of it is compared with what the model leaves in them::

    inflation = Var(sum_t c_t e_t) / sum_t c_t^2,

``c`` the fitted effect less what the base takes of it, ``e`` the whitened residual with the effect; the variance is
White's (rows of unequal noise) or Newey and West's (noise that hangs together), whichever is larger. A right effect and
a right noise give one.

Sources: White, Econometrica 48 (1980) 817; and those of :mod:`fitting.estimators.covariance`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from fitting.estimators.covariance import series_scores
from fitting.regression.solving import WhiteRows
from fitting.residual.confirmation.cross_validation import solve_gram, unit_columns

FloatArray = npt.NDArray[np.float64]

#: Squared share of a column's norm below which what the others leave of it is rounding.
_DEAD = 1e-8


def inflation(rows: Sequence[WhiteRows], candidate: int, residual: Sequence[FloatArray]) -> float:
    """Variance of the last ``candidate`` columns' gain over what the noise model says, at least 1.

    Parameters
    ----------
    rows : whitened rows of every joint, candidate columns last (a prior's row at the end of a joint is no time)
    candidate : number of its columns
    residual : what is left with the effect, of each joint; of a delay with the effort moved, which the columns of the
        rows only approximate
    """
    A, b = unit_columns(rows)
    first = A.shape[1] - candidate
    gram = A.T @ A
    left = A[:, first:] - A[:, :first] @ solve_gram(gram[:first, :first], gram[:first, first:])
    live = np.einsum("ij,ij->j", left, left) > _DEAD
    shown = left[:, live] @ solve_gram(gram, A.T @ b)[first:][live]
    power = float(shown @ shown)
    if not power > 0:
        return 1.0
    rng = np.random.default_rng(0)  # neither way draws
    uneven, coloured, start = 0.0, 0.0, 0
    for own, left_over in zip(rows, residual, strict=True):
        place = 0
        for _, kept in own.sections:
            part = slice(place, place := place + int(np.count_nonzero(kept)))
            c, e = shown[start:][part, None], left_over[part]
            if c.any():
                uneven += float(series_scores(c, e, 0, rng)[0, 0])
                coloured += float(series_scores(c, e, "hac", rng)[0, 0])
        start += len(own.b)
    return max(1.0, uneven / power, coloured / power)
