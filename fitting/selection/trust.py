"""Share of each gain that counts, by replicas: what noise in the regressors makes of gains is taken off."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from scipy.linalg import block_diag

from fitting.arrays import FloatArray
from fitting.effects.base import Effect
from fitting.residual.confirmation.robustness import Leftover
from fitting.residual.laws import Law
from fitting.residual.null import Null
from fitting.residual.scoring import Candidates, Score
from fitting.residual.terms import Model, Term
from fitting.selection import priors
from fitting.selection.confirm import Signals
from fitting.selection.decision import Rated
from fitting.selection.evidence import DEAD

#: Gain beyond which no noise in regressors makes it: 17 standard deviations.
BEYOND_BIAS = 300.0
#: Replicas that are drawn at first, and log odds from which on more would not change the decision.
LEAST_DRAWS, OPEN = 3, 12.5


class Draws:
    """Null distributions of terms. One that was drawn is kept, whatever model follows: it is noise, not structure.

    Parameters
    ----------
    signals : draws replicas
    most : most replicas for a term; 0 trusts the chi-square
    """

    def __init__(self, signals: Signals, most: int) -> None:
        self._signals, self._most = signals, most
        self._nulls: dict[tuple[object, ...], Null] = {}
        self._drawn: dict[tuple[object, ...], int] = {}

    def open(self, rated: Rated) -> bool:
        """Return whether replicas may still change an explanation's score: known ones are not taken off it, or more
        are wanted, a few at first, then all if they may decide."""
        return self._wanted(rated) or (rated.score.null is None and rated.term.label in self._nulls)

    def _wanted(self, rated: Rated) -> bool:
        drawn = self._drawn.get(rated.term.label, 0)
        return drawn < self._most and (drawn == 0 or rated.log_odds < OPEN)

    def unbiased(self, model: Model, rated: Sequence[Rated]) -> list[Score]:
        """Take the bias of noisy regressors off explanations' scores, with more replicas where they are wanted."""
        wanted: dict[int, list[Term]] = {}
        for r in filter(self._wanted, rated):
            wanted.setdefault(self._drawn.get(r.term.label, 0), []).append(r.term)
        for first, terms in wanted.items():
            draws = self._most - first if first else min(LEAST_DRAWS, self._most)
            for term, null in zip(terms, self._signals.nulls(model, terms, draws, first), strict=True):
                self._drawn[term.label] = first + draws
                if null is not None:
                    before = self._nulls.get(term.label)
                    self._nulls[term.label] = null if before is None else before.joined(null)
        known = ((r.score, self._nulls.get(r.term.label)) for r in rated)
        return [score if null is None else score.against(null) for score, null in known]


class Trust:
    """Share of the gain of each candidate, by number, that counts.

    Parameters
    ----------
    candidates : with their columns
    model : what is there
    """

    def __init__(self, candidates: Candidates, model: Model) -> None:
        self.candidates, self.model = candidates, model
        self._shares: dict[int, float] = {}

    def of(self, number: int) -> float:
        """Return the share of one candidate."""
        return self._shares.get(number, 1.0)

    def weigh(self, names: Iterable[Sequence[int]], laws: Iterable[Sequence[int]], scores: Mapping[int, Score]) -> None:
        """Compute the shares anew, of names and of the laws of each joint."""
        names, laws = tuple(names), tuple(laws)
        self._shares = {}
        for own in (*names, *laws):
            self._shares |= _shares(own, scores)
        known, others = list[Sequence[int]](), list[Sequence[int]]()
        for own in names:
            # Of these the share of a gain that noise makes is known: from replicas, or as it makes none so large.
            drawn = [n for n in own if scores[n].null is not None or scores[n].gain >= BEYOND_BIAS]
            head = max(drawn or own, key=lambda n: scores[n].gain)
            if isinstance(scores[head].term.content, Effect) and scores[head].gain > priors.SMALLEST**2:
                (known if drawn else others).append([head, *(n for n in own if n != head)])
        known.sort(key=lambda own: -scores[own[0]].gain * self._shares[own[0]])
        others += [[n] for own in laws for n in own if scores[n].gain > priors.SMALLEST**2]
        self._share_common(known, others, scores)

    def inflations(self, heads: Mapping[int, Score]) -> dict[int, float]:
        """Compute the noise inflation, by joint, of the rows that show the most probable there."""
        result = {}
        for joint, score in heads.items():
            shown = Candidates(self.model, [score.term], [1]).shown(self.model, 0, score.values)
            result[joint] = Leftover.of(self.model, shown).inflation(shown)
        return result

    def divide(self, inflations: Mapping[int, float], scores: Mapping[int, Score]) -> None:
        """Divide the shares by these factors of the joints.

        What explains the same rows is compared by what is left of them, so it is one factor for all of a joint; of what
        acts everywhere each joint's part has the joint's.
        """
        for n, score in scores.items():
            parts = dict(enumerate(score.places)) if score.term.everywhere else {score.term.joint or 0: 1.0}
            kept = sum(max(part, 0.0) / inflations.get(joint, 1.0) for joint, part in parts.items())
            self._shares[n] = self._shares.get(n, 1.0) * (
                kept / sum(max(p, 0.0) for p in parts.values()) if kept else 1.0
            )

    def _share_common(
        self, known: Sequence[Sequence[int]], others: Sequence[Sequence[int]], scores: Mapping[int, Score]
    ) -> None:
        """Let what two explanations take alike count alike: of the lesser, what is its own has its own share.

        Of two, each is known by what it takes beside the other. Replicas are few, and their scatter or bias, times
        what both take, would decide between two that the data hardly separates. ``known`` are the greatest first.
        """
        if not known:
            return
        groups = [*known, *others]
        numbers = [own[0] for own in groups]
        common = self.common(numbers[: len(known)], numbers, scores)
        # Of what each takes as it was fitted, the part that counts.
        taken = {n: _fitted_gain(scores[n]) for own in groups for n in own}
        counted = {n: self._shares[n] * scores[n].gain / whole for n, whole in taken.items()}
        for at, own in enumerate(groups[1:], start=1):
            above = common[: min(at, len(known)), at]
            most = int(np.argmax(above))
            trust, share = counted[numbers[most]], float(above[most])
            counted |= {n: share * trust + (1.0 - share) * counted[n] for n in own}
        self._shares |= {n: counted[n] * whole / max(scores[n].gain, 1e-300) for n, whole in taken.items()}

    def common(self, names: Sequence[int], others: Sequence[int], scores: Mapping[int, Score]) -> FloatArray:
        """Compute the share of each other's gain that it does not take beside a name (N, L), by what both contribute.

        What acts at different joints has in common what each makes up for by way of the base.
        """
        ends = np.cumsum([0, *(len(residual) for residual in self.model.fit.residual)])
        shares = np.zeros((len(names), len(others)))
        shown = [(place, self._shown(others, at, scores), at) for place, at in _places(others, scores).items()]
        for place, rows in _places(names, scores).items():
            x, own, base = self._shown(names, rows, scores)
            for other, (y, its, its_base), columns in shown:
                alike = -base.T @ its_base
                if place == other:
                    alike += own.T @ its
                elif place is None and other is not None:
                    alike += own[ends[other] : ends[other + 1]].T @ its
                elif other is None and place is not None:
                    alike += own.T @ its[ends[place] : ends[place + 1]]
                alike = np.clip(alike, -1.0, 1.0)
                beside = (y - alike * x[:, None]) ** 2 / np.maximum(1.0 - alike**2, DEAD)
                shares[np.ix_(rows, columns)] = np.clip(1.0 - beside / y**2, 0.0, 1.0)
        return shares

    def _shown(
        self, numbers: Sequence[int], at: Sequence[int], scores: Mapping[int, Score]
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the roots (N,) of what candidates of one place take, and their :meth:`Candidates.contributions`."""
        own = [numbers[k] for k in at]
        values, sizes = _fitted(own, scores)
        return sizes, *self.candidates.contributions(self.model, own, values)


def _places(numbers: Sequence[int], scores: Mapping[int, Score]) -> dict[int | None, list[int]]:
    """Return each joint's places in a list, and under None those acting everywhere."""
    result: dict[int | None, list[int]] = {}
    for at, n in enumerate(numbers):
        result.setdefault(scores[n].term.place, []).append(at)
    return result


def _fitted(numbers: Sequence[int], scores: Mapping[int, Score]) -> tuple[FloatArray, FloatArray]:
    """Return candidates' fitted values (P, N), of unit contribution each, and the roots (N,) of what they take."""
    own = [scores[n] for n in numbers]
    sizes = np.sqrt([_fitted_gain(score) for score in own])
    return block_diag(*((score.fitted / size)[:, None] for score, size in zip(own, sizes, strict=True))), sizes


def _shares(numbers: Sequence[int], scores: Mapping[int, Score]) -> dict[int, float]:
    """Return the share of each gain of one explanation to count; shapes without replicas as those with."""
    drawn = {n: scores[n].trusted for n in numbers if scores[n].null is not None}
    law = isinstance(scores[numbers[0]].term.content, Law)
    usual = min(drawn.values()) if drawn and not law else 1.0
    return {n: drawn.get(n, usual) for n in numbers}


def _fitted_gain(score: Score) -> float:
    """Return the chi-square of the values as they were fitted: with the bias that replicas show."""
    return max(float(score.fitted @ score.information @ score.fitted), DEAD * score.gain, 1e-300)
