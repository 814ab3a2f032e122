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
from fitting.selection.evidence import DEAD, least_gain

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
        common = self._common(numbers[: len(known)], numbers, scores)
        for at, own in enumerate(groups[1:], start=1):
            above = common[: min(at, len(known)), at]
            most = int(np.argmax(above))
            head, share = numbers[most], float(above[most])
            trust = scores[head].gain * self._shares[head] / _biased_gain(scores[head])
            self._shares |= {n: share * trust + (1.0 - share) * self._shares[n] for n in own}

    def _common(self, names: Sequence[int], others: Sequence[int], scores: Mapping[int, Score]) -> FloatArray:
        """Compute the share of each other's gain that it does not take beside a name (N, L), by what both contribute.

        Those of different joints have none in common.
        """
        shares = np.zeros((len(names), len(others)))
        for place, rows in _places(names, scores).items():
            for other, columns in _places(others, scores).items():
                if place == other or None in (place, other):
                    one, two = [names[k] for k in rows], [others[k] for k in columns]
                    (V, x), (W, y) = _fitted(one, scores), _fitted(two, scores)
                    alike = np.clip(V.T @ self.candidates.cross_products(self.model, one, two) @ W, -1.0, 1.0)
                    beside = (y - alike * x[:, None]) ** 2 / np.maximum(1.0 - alike**2, DEAD)
                    shares[np.ix_(rows, columns)] = np.clip(1.0 - beside / y**2, 0.0, 1.0)
        return shares


def _places(numbers: Sequence[int], scores: Mapping[int, Score]) -> dict[int | None, list[int]]:
    """Return each joint's places in a list, and under None those acting everywhere."""
    result: dict[int | None, list[int]] = {}
    for at, n in enumerate(numbers):
        result.setdefault(scores[n].term.place, []).append(at)
    return result


def _fitted(numbers: Sequence[int], scores: Mapping[int, Score]) -> tuple[FloatArray, FloatArray]:
    """Return candidates' fitted values (P, N), of unit contribution each, and the roots (N,) of what they take."""
    own = [scores[n] for n in numbers]
    taken = [max(float(score.fitted @ score.information @ score.fitted), DEAD * score.gain) for score in own]
    sizes = np.sqrt(taken)
    return block_diag(*((score.fitted / size)[:, None] for score, size in zip(own, sizes, strict=True))), sizes


def _shares(numbers: Sequence[int], scores: Mapping[int, Score]) -> dict[int, float]:
    """Return the share of each gain of one explanation to count; shapes without replicas as those with."""
    drawn = {n: scores[n].trusted for n in numbers if scores[n].null is not None}
    law = isinstance(scores[numbers[0]].term.content, Law)
    usual = min(drawn.values()) if drawn and not law else 1.0
    return {n: drawn.get(n, usual) for n in numbers}


def _biased_gain(score: Score) -> float:
    """Return the gain before the replicas' bias was taken off, or as it is where none was."""
    if score.null is None:
        return score.gain
    return max(score.gain, float(score.fitted @ score.information @ score.fitted))
