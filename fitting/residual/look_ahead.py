"""Whether two named effects on one joint are what looks like one law of a signal.

A spline adapts itself to the sum of two effects that follow one signal, so it may leave either name behind, and neither
is tried. One step ahead shows it: two right formulas explain what the law does together with whatever comes after it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from fitting.effects.base import Effect
from fitting.residual.refinement import finer, refined
from fitting.residual.rules import ACCUSE, LAW_WINS, LAW_WINS_SHARE, OUTDONE_SHARE
from fitting.residual.scoring import Candidates, Score
from fitting.residual.terms import Model, Term

#: What a wrong formula leaves, as a share of what is there (:data:`LAW_WINS_SHARE`), has to be so many times more than
#: what is left to chance (:data:`LAW_WINS`): two names fit anything faint.
_PLAIN = 2.0
#: Candidates for the second place whose shapes are searched.
_MOST_SECOND = 2


def first_of_two(
    model: Model, law: Score, names: Sequence[Score], refit: Callable[[Term], Model], candidates: Candidates
) -> Score | None:
    """The name to begin with, where it explains as much with a second name as the law does with what follows it.

    As much as right formulas do: they may leave :data:`OUTDONE_SHARE`.

    Parameters
    ----------
    law : of one joint, about to be chosen
    names : of the same joint, that come near it
    refit : the model with a further term
    candidates : of that model, all joints
    """
    if LAW_WINS_SHARE * law.gain < _PLAIN * LAW_WINS or not names:
        return None
    law = finer(model, law)
    behind = _net(law) + _net(_next(refit(law.term), law.term.joint, candidates))
    best: tuple[float, Score] | None = None
    for name in names:
        first = refined(model, name)
        second = _next(refit(first.term), law.term.joint, candidates, named=True)
        together = _net(first) + _net(second)
        if (
            second is not None
            and together > behind - max(LAW_WINS, OUTDONE_SHARE * behind)
            and (best is None or together > best[0])
        ):
            best = together, name
    return None if best is None else best[1]


def _net(score: Score | None) -> float:
    """Chi-square less what as many parameters gain from noise."""
    return 0.0 if score is None else score.gain - score.live


def _next(model: Model, joint: int | None, candidates: Candidates, named: bool = False) -> Score | None:
    """What would be added to a joint next."""
    there = {term.family for term in model.terms}
    open_ = [
        score
        for score in candidates.scores(model).values()
        if score.term.joint == joint
        and score.plausible
        and score.score > ACCUSE
        and score.term.family not in there
        and (isinstance(score.term.content, Effect) or not named)
    ]
    best = sorted(open_, key=lambda score: -score.score)[:_MOST_SECOND]
    fine = [refined(model, s) if isinstance(s.term.content, Effect) else s for s in best]
    return max(fine, key=lambda score: score.score, default=None)
