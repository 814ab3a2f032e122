"""Distance of rivals on a motion, before it is made: in chi-square, and in the odds that the loop will state.

With everything whitened, base columns ``A`` (and the effects that are not in question), and rivals ``a`` and ``b`` with
values ``eta``, a fit of base and ``b`` to data that ``a`` made leaves on average, beyond the noise,

    d^2 = eta_a' (S_aa - S_ab S_bb^-1 S_ba) eta_a,     S = C'C - (A'C)' (A'A)^-1 (A'C)

which for one column each is ``lambda^2 (1 - rho^2)``: the size of the effect times what of it is its own. Products of
whitened rows add up over recordings, so a new motion is judged together with all that is there already.

From the same products follow the scores that the loop would have if ``a`` were the truth, and from them the log odds
of ``a`` over ``b`` with the loop's own evidence: shapes and sizes averaged, values that cannot be held against a name,
differences of names shrunk as far as formulas are exact (:mod:`fitting.selection.decision`). What the recordings show
already is the start; a new motion adds what these expected odds grow by, with a standard deviation of the root of what
it adds to ``d^2``.

Source: Atkinson and Fedorov, "The design of experiments for discriminating between two rival models", Biometrika 62,
1975 (T-optimality, here with the size that was fitted).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from fitting.arrays import FloatArray
from fitting.effects.base import Effect
from fitting.effects.bounds import inside, limits
from fitting.regression.solving import WhiteRows, inverse_root
from fitting.residual.laws import Law
from fitting.residual.scoring import Score
from fitting.residual.terms import Term
from fitting.selection.decision import odds_behind
from fitting.selection.evidence import DEAD, log_mean
from fitting.selection.gains import averaged, orders
from fitting.selection.priors import CREDIBLE_ODDS, USUAL_EFFORT

#: Least standard deviation of log odds: noise moves what no motion separates as well.
_LEAST_SPREAD = 0.5
#: Standard deviations of margin beyond which more of it is worth nothing.
_ENOUGH = 4.0


def products(rows: Sequence[WhiteRows]) -> FloatArray:
    """Compute inner products of whitened rows over joints, columns first and target last, (k + 1, k + 1)."""
    total = np.zeros((rows[0].A.shape[1] + 1,) * 2)
    for each in rows:
        table = np.column_stack([each.A, each.b])
        total += table.T @ table
    return total


def projected(values: FloatArray, count: int) -> FloatArray:
    """Compute products of all but the first ``count`` columns, those projected out.

    Directions that vanish to 1e-10 of the products of unit columns count as undetermined, and are not projected out.
    """
    cross = inverse_root(values[:count, :count]).T @ values[:count, count:]
    return np.asarray(values[count:, count:] - cross.T @ cross)


@dataclass(frozen=True)
class Rival:
    """An explanation in question.

    Attributes
    ----------
    terms : it in the shape that was fitted, and in others of its grid: a wrong one adapts itself to a new recording
    places : where the columns of each are
    values : of its parameters in the fitted shape
    """

    terms: tuple[Term, ...]
    places: tuple[slice, ...]
    values: FloatArray


@dataclass(frozen=True)
class Lead:
    """Evidence for one rival and for another one in data that the first made.

    Attributes
    ----------
    size : ``lambda^2``, chi-square that the true one adds
    chi_square : ``d^2``, expected excess of the wrong one's residual sum of squares
    log_odds : of the true one over the wrong one, as the evidence has them before they are shrunk
    """

    size: float
    chi_square: float
    log_odds: float


@dataclass(frozen=True)
class Pair:
    """One rival taken for the truth, beside the one that is hardest to separate from it.

    Attributes
    ----------
    chance : that this one is the truth, as far as is known
    chi_square, size : of :class:`Lead`
    expected, spread : log odds of the true one over the other that are to be expected, and their standard deviation
    asked : log odds that it must have to be the only name
    """

    chance: float
    chi_square: float
    size: float
    expected: float
    spread: float
    asked: float

    @property
    def margin(self) -> float:
        """Standard deviations by which what is expected is beyond what is asked for."""
        return (self.expected - self.asked) / self.spread

    @property
    def share(self) -> float:
        """Share of the effect that is its own, ``1 - rho^2``, 0 to 1."""
        return self.chi_square / self.size if self.size > 0 else 0.0


@dataclass(frozen=True)
class Separation:
    """Separation of rivals: each of them taken for the truth in turn."""

    pairs: tuple[Pair, ...]

    @property
    def worst(self) -> Pair:
        """The truth that would be hardest to identify."""
        return min(self.pairs, key=lambda pair: pair.margin)

    @property
    def margin(self) -> float:
        """Criterion of a motion: mean margin over who may be right, each at most some standard deviations."""
        return sum(pair.chance * float(np.clip(pair.margin, -_ENOUGH, _ENOUGH)) for pair in self.pairs)

    @property
    def probability(self) -> float:
        """Chance that the right one alone is accepted, whichever is right."""
        return sum(pair.chance * float(scipy.special.ndtr(pair.margin)) for pair in self.pairs)


def leads(apart: FloatArray, rivals: Sequence[Rival]) -> dict[tuple[int, int], Lead]:
    """Compute each true rival's lead over each other; ``apart``: products of all columns, base projected out."""
    found = {}
    for true, rival in enumerate(rivals):
        made = apart[:, rival.places[0]] @ rival.values  # products with what the true one adds
        size = max(float(rival.values @ made[rival.places[0]]), 0.0)
        evidence = [_evidence(apart, other, made) for other in rivals]
        for false in range(len(rivals)):
            if false != true:
                left = float(np.clip(size - evidence[false][0], 0.0, size))
                found[true, false] = Lead(size, left, evidence[true][1] - evidence[false][1])
    return found


def _evidence(apart: FloatArray, rival: Rival, made: FloatArray) -> tuple[float, float]:
    """Compute a rival's chi-square of products ``made`` in its best shape, and log evidence over all."""
    gains, found = [], []
    for term, place in zip(rival.terms, rival.places, strict=True):
        information = apart[place, place]
        root = inverse_root(information, DEAD)
        inverse = root @ root.T
        free = values = inverse @ made[place]
        gain, live = float(np.sum((root.T @ made[place]) ** 2)), root.shape[1]
        content = term.content
        bounded = inside(limits(content), information, made[place], free) if isinstance(content, Effect) else None
        if bounded is not None:
            values, gain = bounded.values, bounded.gain
        stds = np.sqrt(np.maximum(np.diag(inverse), 1e-300))
        score = Score(term, gain, live, tuple(values), tuple(stds), 1.0, information, tuple(free))
        series = np.array(orders(score))
        gains.append(gain)
        largest = np.full(len(series), USUAL_EFFORT)
        found.append(float(log_mean(averaged(series[:, 0], series[:, 1], largest))) + score.log_inside)
    return max(gains), float(log_mean(found))


def separation(
    now: Mapping[tuple[int, int], Lead],
    then: Mapping[tuple[int, int], Lead],
    rivals: Sequence[Rival],
    chances: Sequence[float] | None = None,
) -> Separation:
    """Predict the rivals' odds from leads by what is recorded, and with a motion more.

    ``chances`` that each is right are as the loop states them; without, the leads by what is recorded are the start.
    """
    pairs = []
    for true in range(len(rivals)):
        own = [
            _pair(now[true, false], then[true, false], (rivals[true], rivals[false]), _stated(chances, true, false))
            for false in range(len(rivals))
            if false != true
        ]
        chance = 1.0 / len(rivals) if chances is None else chances[true]
        pairs.append(replace(min(own, key=lambda pair: pair.margin), chance=chance))
    return Separation(tuple(pairs))


def _stated(chances: Sequence[float] | None, true: int, false: int) -> float | None:
    return None if chances is None else float(np.log(chances[true] / chances[false]))


def _pair(now: Lead, then: Lead, both: tuple[Rival, Rival], stated: float | None) -> Pair:
    names = not any(isinstance(rival.terms[0].content, Law) for rival in both)  # a curve has no formula to be off

    def behind(reported: float, size: float) -> float:
        return odds_behind(reported, size) if names else reported

    start = now.log_odds if stated is None else behind(stated, now.size)
    more = max(then.chi_square - now.chi_square, 0.0)
    return Pair(
        0.0,
        then.chi_square,
        then.size,
        start + then.log_odds - now.log_odds,
        float(np.hypot(np.sqrt(then.chi_square if stated is None else more), _LEAST_SPREAD)),
        behind(CREDIBLE_ODDS, then.size),
    )
