"""The residual loop on a session: kinematics, then attribution; signals are rebuilt where columns fall short."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from daq.machine.machine_file import Machine
from fitting.arrays import FloatArray
from fitting.effects import effect, effects, line_effect
from fitting.effects.base import Effect
from fitting.loop.session import Described, Options, Prepared, Session
from fitting.loop.weighting import Weighed, weighed
from fitting.regression.design import Design, full_residual
from fitting.regression.noise import difference_noise
from fitting.regression.prior import Prior
from fitting.residual.change_points import ChangePoint, change_points, joint_rows, step_at
from fitting.residual.confirmation.confirmation import Misfit, misfit, validate_gain
from fitting.residual.confirmation.cross_validation import held_out_gain
from fitting.residual.confirmation.uncertainty import with_doubts
from fitting.residual.findings import Accepted, Attribution, Family
from fitting.residual.laws import Law
from fitting.residual.levelling import residual_parts
from fitting.residual.lines import Line, machine_lines
from fitting.residual.null import Null, Replicas
from fitting.residual.scoring import Candidates, Score, score_terms
from fitting.residual.surfaces import Surface
from fitting.residual.terms import Model, Term, fit_model
from fitting.selection.draws import Draws
from fitting.selection.gains import margin
from fitting.selection.search import Search, attribute
from fitting.signals.corrections import Corrections
from fitting.signals.preparation import position_channel_noise

Progress = Callable[[float, str], None]

_REBUILDS = 4
#: Replicas of one model that are kept in memory.
KEPT_REPLICAS = 3
#: Numbers in all replicas' columns up to which they are kept for the models that follow (32 MB).
_MOST_NUMBERS = 4_000_000
#: Factors of the filter's cut-off at which a named effect has to stand as well, and how far it may move.
SCREEN = (0.7, 1.3)
SCREEN_RATIO, SCREEN_Z = 3.0, 4.0
#: Chance that a machine on which nothing changes is said to have changed.
CHANGE_ALARM = 1e-3


class SessionSignals:
    """Refits on a session's recordings: positions corrected as kinematics found, delays as accepted terms say."""

    def __init__(self, session: Session, corrections: Corrections) -> None:
        self._session = session
        self._corrections = corrections
        self._prepared: dict[tuple[tuple[tuple[str, float], ...], frozenset[str]], Prepared] = {}
        self._replicas: tuple[Model, Replicas, dict[int, Model]] | None = None
        self._moved_alike: dict[int, Prepared] = {}

    @property
    def prior(self) -> Prior:
        """What is known before any measurement."""
        return self._session.prior

    def prepared(self, terms: Sequence[Term]) -> Prepared:
        """The design on signals corrected as the terms say; the one without delays and the last one with are kept."""
        late, resampled = delays(self._session, terms)
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
        """Both stages refitted jointly with these terms."""
        return self._fitted(self.prepared(terms), terms)

    def _fitted(self, prepared: Prepared, terms: Sequence[Term]) -> Model:
        return fit_model(prepared.design, prepared.noise, prepared.fitted, terms, self.prior, passes=3 if terms else 1)

    def nulls(self, model: Model, terms: Sequence[Term], draws: int, first: int = 0) -> list[Null | None]:
        """Values of terms on replicas of the recordings in which ``model`` is the whole truth.

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
        """Scores of terms on one replica. The first replicas of the last model are kept: contenders come in rounds."""
        fitted = kept[number] if number in kept else self._fitted_replica(replicas, number, model)
        if number < KEPT_REPLICAS and not fitted.design.stored:
            kept[number] = fitted
        return Candidates(fitted, terms, [1] * len(terms)).scores(fitted)

    def _fitted_replica(self, replicas: Replicas, number: int, model: Model) -> Model:
        """The model fitted to one replica; its noise is the model's own."""
        known = [replace(term, rebuilt=()) for term in model.terms]
        replica = self._replica(replicas, number, model)
        passes = 2 if known else 1
        return fit_model(replica.design, model.noise, replica.fitted, known, self.prior.undelayed(), passes=passes)

    def _replica(self, replicas: Replicas, number: int, model: Model) -> Prepared:
        """The design of one replica. Its motion is the same under every model: only efforts are drawn for the next."""
        recordings = replicas.draw(np.random.default_rng([17, number]))
        if number in self._moved_alike:
            return self._session.with_efforts(self._moved_alike[number], recordings)
        design = model.design
        options = Options(bandwidth_hz=design.bank.bandwidth_hz)
        session = Session(design.machine, recordings, options, in_memory=not design.stored, synthetic=True)
        replica = session.prepared(Corrections(design.machine), noise=model.noise)
        if not replica.design.stored and (len(self._moved_alike) + 1) * replica.design.numbers < _MOST_NUMBERS:
            self._moved_alike[number] = replica
        return replica

    def misfit(self, model: Model, joint: int) -> Misfit:
        """What the model leaves of a joint that two runs of one motion share."""
        return misfit(model, self.prepared(model.terms).pairs, joint)

    def rebuilt(self, model: Model) -> Model:
        """Move the effort in time instead of approximating it, once a delay is the last term.

        Whether a sensor was late, or its samples were handed on late, shows where friction jumps.
        """
        if not model.terms[-1].delays_effort:
            return model
        sampled_late = self._moved(model, resampled=False), self._prepared
        handed_on_late = self._moved(model, resampled=True), self._prepared
        best, self._prepared = min(sampled_late, handed_on_late, key=lambda tried: tried[0].fit.chi_square)
        return best if best is model else self.refit(best.terms)

    def mirrored(self, model: Model, trial: Model) -> tuple[Model, Model]:
        """``model`` with its effort moved as far as the last term of ``trial`` says the other way, and as it says.

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
        """A fit whose columns are made of the forces of a model that is nearly the same: of moved efforts."""
        return fit_model(prepared.design, prepared.noise, prepared.fitted, terms, self.prior, start=near, passes=1)


def delays(session: Described, terms: Sequence[Term]) -> tuple[dict[str, float], frozenset[str]]:
    """Joint name to seconds by which accepted terms say its effort is late, and whose samples were handed on late."""
    joints = session.machine.joints
    late = [(joints[t.joint].name, t) for t in terms if t.delays_effort and t.rebuilt and t.joint is not None]
    return {name: t.rebuilt[0] for name, t in late}, frozenset(name for name, t in late if t.resampled)


def run_attribution(
    session: Session, corrections: Corrections, progress: Progress = lambda fraction, text: None
) -> Attribution:
    """Attribution of what the efforts leave, on signals with the kinematic corrections rebuilt."""
    signals = SessionSignals(session, corrections)
    lines, ripples = _ripples(signals)
    base = signals.refit([item.score.term for item in ripples])
    validate = signals.prepared(()).validate
    found = attribute(base, effects(), validate, signals, session.options.bootstrap, ripples, progress)
    found = _screened(session, corrections, signals, found)
    return replace(
        found,
        model=with_doubts(found.model),
        lines=lines,
        changes=_changes(found.model, signals.prepared(found.model.terms), session.prior),
    )


def _screened(session: Session, corrections: Corrections, signals: SessionSignals, found: Attribution) -> Attribution:
    """Refit at other cut-offs of the identification filter: a real coefficient stays, an artefact moves.

    A named effect is dropped if a refit turns its sign, or makes it several times larger or smaller, significantly.
    """
    named = [n for n, item in enumerate(found.accepted) if isinstance(item.score.term.content, Effect)]
    if not named:
        return found
    bandwidth = session.bank.bandwidth_hz
    leading = {n: _leading(found.model, n) for n in named}
    values = {n: [(bandwidth, *_value(found.model, n, leading[n]))] for n in named}
    for factor in SCREEN:
        cutoff = min(factor * bandwidth, session.machine.rate_hz / 5)
        for n, value in _at_cutoff(session, corrections, found.model.terms, cutoff, leading).items():
            values[n].append((cutoff, *value))
    accepted, table, moved = [], list(found.candidates), set[Family]()
    for n, item in enumerate(found.accepted):
        if n in values and moves(values[n]):
            family = item.score.term.family
            moved.add(family)
            shown = ", ".join(f"{value:.3g} at {cutoff:.2g} Hz" for cutoff, value, _ in values[n])
            table = [
                replace(c, status="artefact", reason=f"it changes with the filter: {shown}")
                if (c.id, c.joint) == family
                else c
                for c in table
            ]
            continue
        accepted.append(replace(item, cutoffs=tuple(values.get(n, ()))))
    model = signals.refit([item.score.term for item in accepted]) if moved else found.model
    return replace(found.refusing(moved), accepted=tuple(accepted), candidates=tuple(table), model=model)


def _at_cutoff(
    session: Session, corrections: Corrections, terms: Sequence[Term], cutoff: float, places: Mapping[int, int]
) -> dict[int, tuple[float, float]]:
    """Values and deviations of parameters (per number of a term its place) at another cut-off; all else is gone."""
    model = SessionSignals(session.at_bandwidth(cutoff), corrections).refit(terms)
    return {n: _value(model, n, place) for n, place in places.items()}


def other_bands(
    session: Session, corrections: Corrections, progress: Progress = lambda fraction, text: None
) -> tuple[tuple[float, tuple[Family, ...]], ...]:
    """What is more probable than nothing at other cut-offs of the identification filter: (Hz, families).

    Only asked where nothing was found: a name has its values at these cut-offs (:func:`_screened`).
    """
    result = []
    for number, factor in enumerate(SCREEN):
        progress(0.86 + 0.03 * number, "looking again with another bandwidth")
        cutoff = min(factor * session.bank.bandwidth_hz, session.machine.rate_hz / 5)
        result.append((cutoff, _found_at(session, corrections, cutoff)))
    return tuple(result)


def _found_at(session: Session, corrections: Corrections, cutoff: float) -> tuple[Family, ...]:
    """What is most probable at another cut-off where nothing is improbable there; all else is gone."""
    signals = SessionSignals(session.at_bandwidth(cutoff), corrections)
    validate, base = signals.prepared(()).validate, signals.refit(())
    search = Search(base, effects(), validate, signals, 0, ())
    nothing = search.rate_nothing()
    if nothing < 0.5:
        # Replicas take off what noise makes of the candidates: only asked where something stands out at all.
        search.draws = Draws(signals, session.options.bootstrap)
        nothing = search.rate_nothing()
    return () if nothing >= 0.5 else (search.open[0].term.family,)


def _leading(model: Model, number: int) -> int:
    """Place of a term's most significant parameter."""
    part = model.term_slice(number)
    return int(np.argmax(np.abs(_total(model, number)) / np.maximum(model.fit.std[part], 1e-300)))


def _value(model: Model, number: int, place: int) -> tuple[float, float]:
    """Value and standard deviation of one parameter of a term."""
    return float(_total(model, number)[place]), float(model.fit.std[model.term_slice(number)][place])


def _total(model: Model, number: int) -> FloatArray:
    """Parameters of a term, with what was moved into the signals."""
    values = model.fit.theta[model.term_slice(number)]
    return np.asarray(values + np.asarray(model.terms[number].rebuilt or np.zeros(len(values))))


def moves(values: Sequence[tuple[float, float, float]]) -> bool:
    """Whether a coefficient depends on the filter beyond its own uncertainty and a factor of :data:`SCREEN_RATIO`."""
    _, first, first_std = values[0]
    for _, value, std in values[1:]:
        apart = abs(value - first) > SCREEN_Z * float(np.hypot(std, first_std))
        ratio = abs(value) / max(abs(first), 1e-300)
        if apart and (value * first < 0 or not 1 / SCREEN_RATIO < ratio < SCREEN_RATIO):
            return True
    return False


def is_ripple(machine: Machine, line: Line) -> bool:
    """Whether a pump can have made this line: only where oil acts on the joint."""
    return line_effect().applies(machine, line.joint)


def _ripples(signals: SessionSignals) -> tuple[tuple[Line, ...], tuple[Accepted, ...]]:
    """Spectral lines of the raw residual; those inside the band are terms of the model from the start.

    Above the band a line does the fit no harm: it is named, and nothing is added. A pump's phase is of no recording but
    its own, so that of `validate` is taken from there. A joint without a cylinder has no pump: its lines are given as
    they are, and stand for no effect.
    """
    prepared, model = signals.prepared(()), signals.refit(())
    design, theta = prepared.design, model.fit.theta
    lines, _ = machine_lines(design, theta, prepared.fitted, prepared.pairs)
    accepted: list[Accepted] = []
    for line in lines:
        if line.frequency_hz > design.bank.bandwidth_hz or not is_ripple(design.machine, line):
            continue
        parts = residual_parts(design, theta, line.joint, prepared.validate) if prepared.validate else ()
        term = Term(line_effect(), line.joint, (line.on(parts) if parts else line).shape)
        before = signals.refit([item.score.term for item in accepted])
        for score in score_terms(before, [term], [1]):
            if margin(score) <= 0:
                continue
            trial = signals.refit([*(item.score.term for item in accepted), term])
            held_out = held_out_gain(trial.rows(), score.live, design.bank.reduced_rate_hz)
            gain = validate_gain(before, trial, prepared.validate) if prepared.validate else None
            accepted.append(Accepted(score, (), held_out, gain))
    return lines, tuple(accepted)


def _changes(model: Model, prepared: Prepared, prior: Prior) -> tuple[ChangePoint, ...]:
    """Moments from which on a joint behaves otherwise, with everything that was found taken into account.

    What comes back at one phase of the motion in every run of it is no change in time: not what all recordings have at
    the same moment, and not what another run of the same motion shows at that phase as well. Where the model does not
    explain the recordings down to their noise, its error has phases, too, and only a second run tells the two apart.
    """
    joints = len(model.design.machine.joints)
    explained = weighed(model, prior).weights == "whitened"
    found: list[ChangePoint] = []
    for joint in range(joints):
        rows = joint_rows(model.design, model.noise, model.fit, model.fitted, joint)
        for point in change_points(rows, looks=joints):
            if point.kind == "every" or point.p >= CHANGE_ALARM / joints:
                continue
            others = _other_runs(model.design, prepared, point)
            if others or explained:
                shown = [step_at(rows, point.column, recording, time) for recording, time in others]
                if not any(_is_the_same(point, *step) for step in shown):
                    found.append(point)
                break
    return tuple(found)


def _other_runs(design: Design, prepared: Prepared, point: ChangePoint) -> list[tuple[int, float]]:
    """Other recordings of the same motion, and the time at which it is at the same phase there, s."""
    begins: dict[int, float] = {}
    for segment in design.segments:
        begins[segment.recording] = min(begins.get(segment.recording, np.inf), float(segment.t[0]))
    result = []
    for pair in prepared.pairs:
        own, other = design.segments[pair.train], design.segments[pair.repeat]
        moments = [float(own.t[pair.train_start]), float(other.t[pair.repeat_start])]
        late = (moments[1] - begins[other.recording]) - (moments[0] - begins[own.recording])
        if point.recording == own.recording:
            result.append((other.recording, point.time + late))
        elif point.recording == other.recording:
            result.append((own.recording, point.time - late))
    return result


def _is_the_same(point: ChangePoint, change: float, std: float) -> bool:
    """Whether another run shows the same change: half of it at least, or no less than chance leaves open."""
    return change / point.change > 0.5 or abs(change - point.change) < 2.0 * std


def final_model(session: Session, corrections: Corrections, terms: Sequence[Term]) -> tuple[Prepared, Weighed]:
    """Both stages refitted jointly with everything that was found, with the weights that suit it."""
    signals = SessionSignals(session, corrections)
    return signals.prepared(terms), weighed(signals.refit(terms), session.prior)


def term_to_json(term: Term) -> dict[str, Any]:
    """A term as plain JSON; :func:`term_from_json` reads it back."""
    content = term.content
    law = None
    if isinstance(content, Law):
        law = {
            "signal": content.signal,
            "other": content.other,
            "signed": content.signed,
            "only": content.only,
            "loaded_only": content.loaded_only,
            "knots": list(content.knots),
        }
        if isinstance(content, Surface):
            law |= {"second": content.second, "second_other": content.second_other}
            law |= {"second_range": list(content.second_range), "twist": content.twist}
    return {
        "effect": None if isinstance(content, Law) else content.id,
        "law": law,
        "joint": term.joint,
        "shape": dict(term.shape),
        "rebuilt": list(term.rebuilt),
        "resampled": term.resampled,
        "held": list(term.held),
    }


def term_from_json(value: Mapping[str, Any]) -> Term:
    """Inverse of :func:`term_to_json`."""
    content: Effect | Law = effect(value["effect"]) if value["law"] is None else _law_from_json(value["law"])
    applied = tuple(value["rebuilt"]), value.get("resampled", False), tuple(value.get("held", ()))
    return Term(content, value["joint"], dict(value["shape"]), *applied)


def _law_from_json(law: Mapping[str, Any]) -> Law:
    first = (law["signal"], law["other"], law["signed"], law["loaded_only"], tuple(law["knots"]), law.get("only", ""))
    if "second" not in law:
        return Law(*first)
    return Surface(*first, law["second"], law["second_other"], tuple(law["second_range"]), law.get("twist", False))
