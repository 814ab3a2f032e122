"""The open question: rivals in the light of what is recorded, and what a motion would add to that."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from daq.motion_files import Motion
from fitting.arrays import FloatArray
from fitting.effects.base import Effect
from fitting.excitation.limits import HydraulicLimits, holding_efforts
from fitting.planning.planned import States, chamber_models, planned_segment, planned_views, segment_of_states
from fitting.planning.separation import Rival, Separation, leads, products, projected, separation
from fitting.regression.design import build_design, whitened
from fitting.regression.prior import Prior, with_prior
from fitting.residual.terms import Model, Term, extra_columns
from fitting.signals.preparation import Segment

#: Shapes of a rival's grid that are looked at.
_MOST_SHAPES = 16


def _fitted(apart: FloatArray, rival: Term, place: slice) -> FloatArray:
    """Return a rival's values fitted without the others; what was moved into signals is put back first."""
    S, target = apart[:-1, :-1], apart[:-1, -1]
    if rival.rebuilt:
        target = target + S[:, place] @ np.asarray(rival.rebuilt)
    return np.asarray(np.linalg.pinv(S[place, place], rcond=1e-8, hermitian=True) @ target[place])


def _shapes(model: Model, rival: Term) -> list[Term]:
    """Return a rival in fitted and other shapes of its grid: a wrong one adapts to a new recording."""
    effect = rival.content
    if not isinstance(effect, Effect):
        return [rival]
    chosen = {key: value for key, value in rival.shape.items() if key in ("other", "recording")}
    grid = effect.shapes(model.views[model.fitted[0]][rival.joint or 0])
    step = max(1, len(grid) // _MOST_SHAPES)
    others = [replace(rival, shape={**shape, **chosen}, rebuilt=()) for shape in grid[::step]]
    return [rival, *(term for term in others if term.shape != rival.shape)]


class Question:
    """The rivals in the light of what is recorded; weighs motions."""

    def __init__(
        self,
        model: Model,
        rivals: tuple[Term, ...],
        prior: Prior,
        hydraulic: HydraulicLimits,
        chances: tuple[float, ...] | None,
    ) -> None:
        self.model, self.rivals, self.hydraulic, self.chances = model, rivals, hydraulic, chances
        design = model.design
        families = {rival.family for rival in rivals}
        # Effects that are not in question belong to the base.
        known = [term for term in model.terms if term.family not in families]
        shapes = [_shapes(model, rival) for rival in rivals]
        self.terms = (*known, *(term for own in shapes for term in own))
        widths = [len(term.names(design.parameters.joints)) for term in self.terms]
        ends = np.cumsum([len(design.parameters), *widths]).tolist()
        self.fixed = ends[len(known)]
        places = [slice(e - w - self.fixed, e - self.fixed) for e, w in zip(ends[1:], widths, strict=True)]
        rest = iter(places[len(known) :])
        parts = [tuple(next(rest) for _ in own) for own in shapes]
        extra = extra_columns(design, model.views, self.terms)
        rows = whitened(design, model.noise, model.fitted, extra)
        expected = extra.expected_rows(len(design.parameters))
        self.recorded = products((*with_prior(rows, design.parameters, prior), *expected))
        trained = [i for i in model.fitted if design.segments[i].role in ("train", "repeat", "operation")]
        length = sum(len(design.segments[i]) for i in trained) / design.bank.rate_hz
        self.training = products(whitened(design, model.noise, trained, extra)) / length  # per second
        apart = projected(self.recorded, self.fixed)
        self.questioned = [
            Rival(tuple(terms), places, _fitted(apart, rival, places[0]))
            for rival, terms, places in zip(rivals, shapes, parts, strict=True)
        ]
        self._leads = leads(apart[:-1, :-1], self.questioned)
        self.now = self._separation(self.recorded)
        self.chambers = chamber_models(model)
        self.next_recording = 1 + max(segment.recording for segment in design.segments)

    def _separation(self, total: FloatArray) -> Separation:
        then = leads(projected(total, self.fixed)[:-1, :-1], self.questioned)
        return separation(self._leads, then, self.questioned, self.chances)

    @property
    def suspects(self) -> list[int]:
        """Joints to move: those of the rivals; for effects of the whole machine the two that feel them most."""
        named = list(dict.fromkeys(term.joint for term in self.rivals if term.joint is not None))
        if named:
            return named[:2]
        extra = extra_columns(self.model.design, self.model.views, self.terms)
        felt = []
        for rows in whitened(self.model.design, self.model.noise, self.model.fitted, extra):
            own = rows.A[:, self.fixed :]
            felt.append(max(float(np.sum((own[:, r.places[0]] @ r.values) ** 2)) for r in self.questioned))
        return [int(joint) for joint in np.argsort(felt)[::-1][:2]]

    def holding(self, q: FloatArray) -> FloatArray:
        """Compute load forces (N, n) of the fitted arm at rest."""
        design = self.model.design
        values = self.model.fit.theta[design.parameters.base_slice]
        return holding_efforts(design.machine, design.parameters.base, values, q)

    def segment(self, motion: Motion) -> Segment:
        """Make a segment of a motion as it would be recorded."""
        design = self.model.design
        return planned_segment(design.machine, design.bank, design.noise, motion, self.next_recording)

    def segment_of(self, states: States) -> Segment:
        """Make the same from exact states."""
        design = self.model.design
        return segment_of_states(design.machine, design.bank, design.noise, states, self.next_recording)

    def _products(self, segment: Segment) -> FloatArray:
        """Compute what a segment would add to the products."""
        known = self.model.design
        design = build_design(known.machine, known.parameters.base, known.bank, known.noise, [segment])
        like = self.model.views[self.model.fitted[0]][0]
        views = planned_views(design, self.model.fit.theta, self.chambers, self.model.terms, like)
        return products(whitened(design, self.model.noise, [0], extra_columns(design, views, self.terms)))

    def separations(self, segments: Sequence[Segment]) -> list[Separation]:
        """Compute the separation by all data with each of the segments added."""
        return [self._separation(self.recorded + self._products(segment)) for segment in segments]

    def again(self, seconds: float) -> Separation:
        """Compute the separation with ``seconds`` more of the training motions."""
        return self._separation(self.recorded + seconds * self.training)

    def repeated(self, motion: Motion, times: Iterable[int]) -> Iterator[Separation]:
        """Compute separations with a motion recorded so many times each."""
        more = self._products(self.segment(motion))
        return (self._separation(self.recorded + number * more) for number in times)
