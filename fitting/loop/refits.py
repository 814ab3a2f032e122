"""Fits on a session's recordings: signals are rebuilt where columns fall short, and replicas drawn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from fitting.loop.session import Options, Prepared, Session
from fitting.loop.weighting import Weighed, weighed
from fitting.regression.design import full_residual
from fitting.regression.noise import difference_noise
from fitting.regression.prior import Prior
from fitting.residual.confirmation.confirmation import Misfit, misfit
from fitting.residual.null import Null, Replicas
from fitting.residual.scoring import Candidates, Score
from fitting.residual.terms import Model, Term, delays, fit_model
from fitting.signals.corrections import Corrections
from fitting.signals.preparation import position_channel_noise

_REBUILDS = 4
#: Replicas of one model that are kept in memory.
KEPT_REPLICAS = 3
#: Numbers in all replicas' columns up to which they are kept for the models that follow (32 MB).
_MOST_NUMBERS = 4_000_000


class SessionSignals:
    """Refits on a session's recordings: positions corrected as kinematics found, delays as accepted terms have them."""

    def __init__(self, session: Session, corrections: Corrections) -> None:
        self._session = session
        self._corrections = corrections
        self._prepared: dict[tuple[tuple[tuple[str, float], ...], frozenset[str]], Prepared] = {}
        self._replicas: tuple[Model, Replicas, dict[int, Model]] | None = None
        self._moved_alike: dict[int, Prepared] = {}

    @property
    def prior(self) -> Prior:
        """Prior knowledge, before any measurement."""
        return self._session.prior

    def prepared(self, terms: Sequence[Term]) -> Prepared:
        """Return the design on signals corrected by the terms; the last one and that without delays are cached."""
        late, resampled = delays(self._session.machine, terms)
        if not late:
            return self._undelayed
        key = (tuple(sorted(late.items())), resampled)
        if key not in self._prepared:
            undelayed = self._undelayed
            if undelayed.design.stored:
                design = self._session.prepared(self._corrections, late, resampled)
            else:
                design = self._session.delayed(undelayed, late, resampled)
            self._prepared = {key: design}
        return self._prepared[key]

    @cached_property
    def _undelayed(self) -> Prepared:
        untouched = self._corrections == Corrections(self._session.machine)
        return self._session.plain if untouched else self._session.prepared(self._corrections)

    def refit(self, terms: Sequence[Term]) -> Model:
        """Refit both stages jointly with these terms."""
        prepared = self.prepared(terms)
        return fit_model(prepared.design, prepared.noise, prepared.fitted, terms, self.prior, passes=3 if terms else 1)

    def nulls(self, model: Model, terms: Sequence[Term], draws: int, first: int = 0) -> list[Null | None]:
        """Fit terms on replicas of the recordings in which ``model`` is the whole truth.

        Replica number ``k`` is the same whenever it is drawn (for one model), so more can be drawn later. None for a
        term that has no live direction there.
        """
        if self._replicas is None or self._replicas[0] is not model:
            self._replicas = model, self._replicas_of(model), {}
        if not self._replicas[1].usable:
            return [None for _ in terms]
        found: list[list[Score]] = [[] for _ in terms]
        for number in range(draws):
            for place, score in self._on_replica(*self._replicas, first + number, terms).items():
                found[place].append(score)
        return [
            Null(np.array([s.free for s in own]), own[0].information, own[0].live) if own else None for own in found
        ]

    def _replicas_of(self, model: Model) -> Replicas:
        session, design = self._session, model.design
        prepared = self.prepared(model.terms)
        joints = range(len(design.machine.joints))
        if prepared.pairs:
            noise = [difference_noise(design, model.fit.theta, prepared.pairs, j, model.extra) for j in joints]
        else:
            noise = [[full_residual(design, model.fit.theta, j, i, model.extra) for i in model.fitted] for j in joints]
        return Replicas(model, position_channel_noise(design.machine, session.recordings), noise)

    def _on_replica(
        self, model: Model, replicas: Replicas, kept: dict[int, Model], number: int, terms: Sequence[Term]
    ) -> dict[int, Score]:
        """Score terms on one replica. The first replicas of the last model are kept: contenders come in rounds."""
        fitted = kept[number] if number in kept else self._fitted_replica(replicas, number, model)
        if number < KEPT_REPLICAS and not fitted.design.stored:
            kept[number] = fitted
        return Candidates(fitted, terms, [1] * len(terms)).scores(fitted)

    def _fitted_replica(self, replicas: Replicas, number: int, model: Model) -> Model:
        """Fit the model to one replica; its noise is the model's own."""
        known = [replace(term, rebuilt=()) for term in model.terms]
        replica = self._replica(replicas, number, model)
        passes = 2 if known else 1
        return fit_model(replica.design, model.noise, replica.fitted, known, self.prior.undelayed(), passes=passes)

    def _replica(self, replicas: Replicas, number: int, model: Model) -> Prepared:
        """Return a replica's design. Its motion is the same under every model: only efforts are drawn for the next."""
        recordings = replicas.draw(np.random.default_rng([17, number]))
        if number in self._moved_alike:
            return self._session.with_efforts(self._moved_alike[number], recordings)
        design = model.design
        options = Options(bandwidth_hz=design.bank.bandwidth_hz)
        session = Session(design.machine, recordings, options, in_memory=not design.stored, synthetic=True)
        replica = session.prepared(Corrections(design.machine), known=model)
        if not replica.design.stored and (len(self._moved_alike) + 1) * replica.design.numbers < _MOST_NUMBERS:
            self._moved_alike[number] = replica
        return replica

    def misfit(self, model: Model, joint: int) -> Misfit:
        """Compute what the model leaves of a joint that two runs of one motion share."""
        return misfit(model, self.prepared(model.terms).pairs, joint)

    def rebuilt(self, model: Model) -> Model:
        """Move the effort in time instead of approximating it, once a delay is the last term.

        Whether a sensor was late, or its samples were passed on late, shows where friction jumps.
        """
        if not model.terms[-1].delays_effort:
            return model
        sampled_late = self._moved(model, resampled=False), self._prepared
        passed_late = self._moved(model, resampled=True), self._prepared
        best, self._prepared = min(sampled_late, passed_late, key=lambda tried: tried[0].fit.chi_square)
        return best if best is model else self.refit(best.terms)

    def mirrored(self, model: Model, trial: Model) -> tuple[Model, Model]:
        """Return ``model`` with its effort moved against the delay of the last term of ``trial``, and with that delay.

        Samples between samples have less noise, whichever way the effort is moved, and another noise model. Both have
        that here, and the same noise model.
        """
        term, kept = trial.terms[-1], self._prepared
        late = sum(term.rebuilt)
        moved = self.prepared((*model.terms, replace(term, rebuilt=(late,))))
        other_way = replace(self.prepared((*model.terms, replace(term, rebuilt=(-late,)))), noise=moved.noise)
        self._prepared = kept
        return self._refitted(other_way, model.terms, model), self._refitted(moved, model.terms, model)

    def _moved(self, model: Model, resampled: bool) -> Model:
        for _ in range(_REBUILDS):
            part = model.term_slice(len(model.terms) - 1)
            late = float(model.fit.theta[part][0])
            if abs(late) < 0.05 * float(model.fit.std[part][0]):
                break
            already = sum(model.terms[-1].rebuilt)
            terms = (*model.terms[:-1], replace(model.terms[-1], rebuilt=(already + late,), resampled=resampled))
            model = self._refitted(self.prepared(terms), terms, model)
        return model

    def _refitted(self, prepared: Prepared, terms: Sequence[Term], near: Model) -> Model:
        """Fit with columns of the forces of a nearly equal model: of moved efforts."""
        return fit_model(prepared.design, prepared.noise, prepared.fitted, terms, self.prior, start=near, passes=1)


def final_model(session: Session, corrections: Corrections, terms: Sequence[Term]) -> tuple[Prepared, Weighed]:
    """Refit both stages jointly with all findings, with suitable weights."""
    signals = SessionSignals(session, corrections)
    return signals.prepared(terms), weighed(signals.refit(terms), session.prior)
