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
from fitting.residual.terms import Model
from fitting.selection import priors
from fitting.selection.confirm import Signals
from fitting.selection.evidence import least_gain, whitened_parts

#: Gain beyond which no noise in regressors makes it: 17 standard deviations.
BEYOND_BIAS = 300.0
#: Replicas that are drawn before the decision is looked at again, and how far the gain may be from the least that is
#: reported if more are to change it.
LEAST_DRAWS, OPEN = 3, (-10.0, 25.0)


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

    @property
    def wanted(self) -> bool:
        """True where any replicas may be drawn."""
        return self._most > 0

    def unbiased(self, model: Model, scores: Sequence[Score]) -> list[Score]:
        """Take the bias of noisy regressors off the scores."""
        fresh = [s for s in scores if s.term.label not in self._nulls]
        drawn = 0
        while fresh and drawn < self._most:
            draws = min(LEAST_DRAWS, self._most - drawn)
            more = self._signals.nulls(model, [s.term for s in fresh], draws, drawn)
            for score, null in zip(fresh, more, strict=True):
                known = self._nulls.get(score.term.label)
                if null is not None:
                    self._nulls[score.term.label] = null if known is None else known.joined(null)
            drawn += draws
            known_now = [own for own in map(self._against, scores) if own.plausible]
            best = max((own.gain * own.trusted - least_gain(own.live, own.grid) for own in known_now), default=-np.inf)
            if not OPEN[0] < best < OPEN[1]:
                break  # more draws would not change the decision
        return [self._against(s) for s in scores]

    def _against(self, score: Score) -> Score:
        null = self._nulls.get(score.term.label)
        return score if null is None else score.against(null)


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
        others += [[n] for own in laws for n in own if scores[n].gain > priors.SMALLEST**2]
        self._share_scatter(known, scores)
        self._share_bias(known, others, scores)

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

    def _share_scatter(self, names: Sequence[Sequence[int]], scores: Mapping[int, Score]) -> None:
        """Share scatter among alike names in replicas, whatever the few that were drawn show of each.

        Each name's inflation is the mean of those of all names, weighted by how alike they are: times a large gain, a
        tenth more or less would decide between two that the data hardly separates.
        """
        numbers = [own[0] for own in names]
        inflation = np.array([_scatter(scores[n]) for n in numbers])
        drawn = np.array([scores[n].null is not None for n in numbers])
        if len(numbers) < 2 or not drawn.any():
            return
        alike = self._overlap(numbers, numbers, scores) * drawn
        total = alike.sum(axis=1)
        pooled = (alike @ inflation + np.maximum(1.0 - total, 0.0)) / np.maximum(total, 1.0)
        for own, factor in zip(names, inflation / pooled, strict=True):
            self._shares |= {n: float(self._shares[n] * factor) for n in own}

    def _share_bias(
        self, names: Sequence[Sequence[int]], others: Sequence[Sequence[int]], scores: Mapping[int, Score]
    ) -> None:
        """Share the regressor noise's bias of a name with whatever is like it.

        Replicas are few, and their scatter, times a large gain, would decide between two alike. So a
        law's own replicas count for that part of it only which the most similar name does not share; and a name of
        which none were drawn has, as far as it is alike, the share of one of which some were.
        """
        if not names or not others:
            return
        heads = [own[0] for own in names]
        alike = self._overlap(heads, [own[0] for own in others], scores)
        trust = np.array([scores[n].gain * self._shares[n] / _biased_gain(scores[n]) for n in heads])
        for own, most, share in zip(others, np.argmax(alike, axis=0), np.max(alike, axis=0), strict=True):
            self._shares |= {n: float(share * trust[most] + (1.0 - share) * self._shares[n]) for n in own}

    def _overlap(self, names: Sequence[int], others: Sequence[int], scores: Mapping[int, Score]) -> FloatArray:
        """Compute the overlap of names and others (N, L): either's contribution that the other could make.

        Those of different joints are not.
        """
        alike = np.zeros((len(names), len(others)))
        for place, rows in _places(names, scores).items():
            for other, columns in _places(others, scores).items():
                if place == other or None in (place, other):
                    one, two = [names[k] for k in rows], [others[k] for k in columns]
                    cross = self.candidates.cross_products(self.model, one, two)
                    first, second = [scores[n] for n in one], [scores[n] for n in two]
                    mutual = _explained(first, second, cross.T) * _explained(second, first, cross).T
                    alike[np.ix_(rows, columns)] = mutual
        return alike


def _places(numbers: Sequence[int], scores: Mapping[int, Score]) -> dict[int | None, list[int]]:
    """Return each joint's places in a list, and under None those acting everywhere."""
    result: dict[int | None, list[int]] = {}
    for at, n in enumerate(numbers):
        result.setdefault(scores[n].term.place, []).append(at)
    return result


def _explained(own: Sequence[Score], others: Sequence[Score], cross: FloatArray) -> FloatArray:
    """Compute the share of each candidate's contribution that each other could make (N, M), by products of the others'
    columns in turn with the candidates' own.
    """
    made = cross @ block_diag(*(np.reshape(score.values, (-1, 1)) for score in own))
    whole = [float(np.asarray(score.values) @ score.information @ score.values) for score in own]
    ends = np.cumsum([len(score.values) for score in others])
    could = [
        np.sum((whitened_parts(score.information).T @ part) ** 2, axis=0)
        for score, part in zip(others, np.split(made, ends[:-1]), strict=True)
    ]
    return np.minimum(1.0, np.transpose(could) / np.maximum(whole, 1e-300)[:, None])


def _shares(numbers: Sequence[int], scores: Mapping[int, Score]) -> dict[int, float]:
    """Return the share of each gain of one explanation to count; shapes without replicas as those with."""
    drawn = {n: scores[n].trusted for n in numbers if scores[n].null is not None}
    law = isinstance(scores[numbers[0]].term.content, Law)
    usual = min(drawn.values()) if drawn and not law else 1.0
    return {n: drawn.get(n, usual) for n in numbers}


def _scatter(score: Score) -> float:
    """Return the fitted variance over the theory's by replicas; 1 where none were drawn."""
    return 1.0 if score.null is None else score.null.inflation_along(score.fitted)


def _biased_gain(score: Score) -> float:
    """Return the gain before the replicas' bias was taken off, or as it is where none was."""
    if score.null is None:
        return score.gain
    return max(score.gain, float(score.fitted @ score.information @ score.fitted))
