"""Which share of each gain is believed, and what was computed with it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from fitting.arrays import FloatArray
from fitting.effects.base import Effect
from fitting.residual.confirmation.robustness import Leftover
from fitting.residual.scoring import Candidates, Score
from fitting.residual.terms import Model
from fitting.selection import priors
from fitting.selection.evidence import whitened_parts
from fitting.selection.gains import biased_gain, known_bias, scatter, shares


class Trust:
    """Share of the gain of each candidate, by number, that is believed; and what was computed with that share.

    Parameters
    ----------
    candidates : with their columns
    model : what is there
    laws : joint to the numbers of its laws of one signal
    """

    def __init__(self, candidates: Candidates, model: Model, laws: Mapping[int, Sequence[int]]) -> None:
        self._candidates, self._model, self._laws = candidates, model, laws
        self._shares: dict[int, float] = {}
        self._memo: dict[tuple[str, int], tuple[Score, float, Any]] = {}

    def of(self, number: int) -> float:
        """The share of one candidate."""
        return self._shares.get(number, 1.0)

    def weigh(self, names: Iterable[Sequence[int]], laws: Iterable[Sequence[int]], scores: Mapping[int, Score]) -> None:
        """Work the shares out anew, of names and of the laws of each joint."""
        names = tuple(names)
        self._shares = {}
        for own in (*names, *laws):
            self._shares |= shares(own, scores)
        self._share_scatter(names, scores)
        self._share_bias(names, scores)

    def inflations(self, heads: Mapping[int, tuple[int, Score]]) -> dict[int, float]:
        """How much noisier the rows are, joint by joint, that show what is most probable there: number and score."""
        result = {}
        for joint, (number, score) in heads.items():
            shown = self._candidates.shown(self._model, number, score.values)
            result[joint] = Leftover.of(self._model, shown).inflation(shown)
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

    def known(self, kind: str, number: int, score: Score) -> Any:
        """What was computed for this score with the trust that it has now; None otherwise.

        Replicas change the scores of contenders only, and all others are asked again with them.
        """
        known = self._memo.get((kind, number))
        same = known is not None and known[0] is score and known[1] == self.of(number)
        return known[2] if same and known is not None else None

    def keep(self, kind: str, number: int, score: Score, value: Any) -> Any:
        """Keep a value for as long as score and share are these, and give it back."""
        self._memo[kind, number] = score, self.of(number), value
        return value

    def _share_scatter(self, names: Sequence[Sequence[int]], scores: Mapping[int, Score]) -> None:
        """Names that tell the same have the same scatter in replicas, whatever the few that were drawn show of each.

        Each name's inflation is the mean of those of all names of its place, weighted by how alike they are: times a
        large gain, a tenth more or less would decide between two that the data hardly tells apart.
        """
        places: dict[int | None, list[tuple[int, Sequence[int]]]] = {}
        for own in names:
            best = max(own, key=lambda n: scores[n].gain)
            term = scores[best].term
            if isinstance(term.content, Effect) and known_bias(scores[best]) and scores[best].gain > priors.SMALLEST**2:
                places.setdefault(None if term.everywhere else term.joint, []).append((best, own))
        for place, families in places.items():
            numbers = [best for best, _ in families]
            inflation = np.array([scatter(scores[n]) for n in numbers])
            drawn = np.array([scores[n].null is not None for n in numbers])
            if len(numbers) < 2 or not drawn.any():
                continue
            alike = self._overlap(numbers, numbers, scores, place) * drawn
            total = alike.sum(axis=1)
            pooled = (alike @ inflation + np.maximum(1.0 - total, 0.0)) / np.maximum(total, 1.0)
            for (_, own), factor in zip(families, inflation / pooled, strict=True):
                self._shares |= {n: float(self._shares[n] * factor) for n in own}

    def _share_bias(self, names: Sequence[Sequence[int]], scores: Mapping[int, Score]) -> None:
        """What noise in the regressors makes of a name it makes of the laws of its joint, as far as they are alike.

        Replicas are few, and their scatter, times a large gain, would decide between two that tell the same. So a
        law's own replicas count for that part of it only which the most similar name does not share.
        """
        joints: dict[int, list[int]] = {}
        for own in names:
            drawn = [n for n in own if known_bias(scores[n]) and isinstance(scores[n].term.content, Effect)]
            if drawn and not scores[drawn[0]].term.everywhere:
                best = max(drawn, key=lambda n: scores[n].gain)
                joints.setdefault(scores[best].term.joint or 0, []).append(best)
        for joint, drawn in joints.items():
            near = [n for n in self._laws.get(joint, ()) if n in scores]
            near = [n for n in near if scores[n].gain > priors.SMALLEST**2]
            drawn = [n for n in drawn if scores[n].gain > priors.SMALLEST**2]
            if not near or not drawn:
                continue
            alike = self._overlap(drawn, near, scores, joint)
            trust = np.array([scores[n].gain * self._shares[n] / biased_gain(scores[n]) for n in drawn])
            for law, most, share in zip(near, np.argmax(alike, axis=0), np.max(alike, axis=0), strict=True):
                self._shares[law] = float(share * trust[most] + (1.0 - share) * self._shares.get(law, 1.0))

    def _overlap(
        self, names: Sequence[int], laws: Sequence[int], scores: Mapping[int, Score], place: int | None
    ) -> FloatArray:
        """How alike names and others are (N, L): the share of either's contribution that the other could make."""
        cross = self._candidates.cross_products(self._model, place, names, laws)
        own, others = [scores[n] for n in names], [scores[n] for n in laws]
        return _explained(own, others, cross.T) * _explained(others, own, cross).T


def _explained(own: Sequence[Score], others: Sequence[Score], cross: FloatArray) -> FloatArray:
    """Share of what each candidate contributes that each other could (N, M), by the products of columns of the others,
    one after the other, with the candidates' own.
    """
    made = cross @ block_diag(*(np.reshape(score.values, (-1, 1)) for score in own))
    whole = [float(np.asarray(score.values) @ score.information @ score.values) for score in own]
    ends = np.cumsum([len(score.values) for score in others])
    could = [
        np.sum((whitened_parts(score.information).T @ part) ** 2, axis=0)
        for score, part in zip(others, np.split(made, ends[:-1]), strict=True)
    ]
    return np.minimum(1.0, np.transpose(could) / np.maximum(whole, 1e-300)[:, None])
