"""How far apart rivals will be: the chi-square by which the wrong one fits worse, before it is measured.

With everything whitened, base columns ``A`` (and the effects that are not in question), and rivals ``a`` and ``b`` with
values ``eta``, a fit of base and ``b`` to data that ``a`` made leaves on average, beyond the noise,

    d^2 = eta_a' (S_aa - S_ab S_bb^-1 S_ba) eta_a,     S = C'C - (A'C)' (A'A)^-1 (A'C)

which for one column each is ``lambda^2 (1 - rho^2)``: the size of the effect times what of it is its own. The two
residual sums of squares then differ by ``d^2 +- 2 d`` (mean and standard deviation, from the normal noise along the
difference of the two fits). Products of whitened rows add up over recordings, so a new motion is judged together with
all that is there already.

Source: Atkinson and Fedorov, "The design of experiments for discriminating between two rival models", Biometrika 62,
1975 (T-optimality, here with the size that was fitted).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np
import numpy.typing as npt
from scipy import linalg
from scipy.special import ndtr

from fitting.regression.design import WhiteRows

FloatArray = npt.NDArray[np.float64]

_RANK = 1e-10  # of unit columns' products: directions below are not told


def products(rows: Sequence[WhiteRows]) -> FloatArray:
    """Inner products of whitened rows over all joints, columns first and the target last, (k + 1, k + 1)."""
    total = np.zeros((rows[0].A.shape[1] + 1,) * 2)
    for each in rows:
        table = np.column_stack([each.A, each.b])
        total += table.T @ table
    return total


def projected(values: FloatArray, count: int) -> FloatArray:
    """Products of all columns but the first ``count``, after those are projected out.

    Directions that vanish to 1e-10 of the products of unit columns count as not told, and are not projected out.
    """
    out = np.flatnonzero(np.diag(values)[:count] > 0)
    scale = np.sqrt(values[out, out])
    eigenvalues, vectors = linalg.eigh(values[np.ix_(out, out)] / np.outer(scale, scale), check_finite=False)
    told = eigenvalues > _RANK * max(float(eigenvalues[-1]), 1e-300) if len(out) else np.zeros(0, dtype=bool)
    cross = vectors[:, told].T @ (values[out, count:] / scale[:, None]) / np.sqrt(eigenvalues[told])[:, None]
    return np.asarray(values[count:, count:] - cross.T @ cross)


@dataclass(frozen=True)
class Separation:
    """How well rivals are told apart.

    Attributes
    ----------
    chi_square : ``d^2``, expected excess of the wrong rival's residual sum of squares
    size : ``lambda^2``, chi-square that the effect itself adds
    needed : lead that the right one must have to stand alone
    """

    chi_square: float
    size: float
    needed: float

    @property
    def share(self) -> float:
        """What part of the effect is its own, ``1 - rho^2``, 0 to 1."""
        return self.chi_square / self.size if self.size > 0 else 0.0

    @property
    def standard_deviations(self) -> float:
        """``d``."""
        return float(np.sqrt(self.chi_square))

    @property
    def margin(self) -> float:
        """Standard deviations by which the expected lead is beyond what is needed: ``(d^2 - needed) / (2 d)``."""
        d = self.standard_deviations
        return (self.chi_square - self.needed) / (2 * d) if d > 0 else -np.inf

    @property
    def probability(self) -> float:
        """Chance that the right one leads by what is needed."""
        return float(ndtr(self.margin))


def separation(
    apart: FloatArray, parts: Sequence[slice], sizes: Sequence[FloatArray], needed: float, needed_share: float
) -> Separation:
    """The worst pair of rivals, each taken for the truth in turn.

    Parameters
    ----------
    apart : (k, k) products of the rivals' columns, base projected out
    parts : where each rival's columns are
    sizes : its values, as fitted
    needed, needed_share : lead that the right one must have: a chi-square, and a share of the effect's own size (the
        formula of an effect is not exactly nature's); the larger counts
    """
    worst: Separation | None = None
    for true, false in permutations(range(len(parts)), 2):
        order = [*range(*parts[false].indices(len(apart))), *range(*parts[true].indices(len(apart)))]
        width = parts[false].stop - parts[false].start
        own = apart[parts[true], parts[true]]
        size = max(float(sizes[true] @ own @ sizes[true]), 0.0)
        left = float(sizes[true] @ projected(apart[np.ix_(order, order)], width) @ sizes[true])
        found = Separation(float(np.clip(left, 0.0, size)), size, max(needed, needed_share * size))
        if worst is None or found.margin < worst.margin:
            worst = found
    assert worst is not None
    return worst
