"""The fit's side of the benchmark: machine file and recordings in, findings out. It sees nothing else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from daq.machine.machine_file import Machine
from daq.recordings.recording import Recording
from fitting.arrays import FloatArray
from fitting.loop.closing import Asked, asked_of, next_experiment
from fitting.loop.kinematic_check import KinematicFinding, Kinematics, kinematics
from fitting.loop.residual_loop import attributed, other_bands
from fitting.loop.session import Options, Session
from fitting.pipeline.verdict import NAMED_FROM
from fitting.residual.findings import Attribution, Hypothesis
from fitting.residual.laws import Law
from fitting.residual.terms import Term
from fitting.selection.decision import together

Place = tuple[str, str | None]
Stated = tuple[str, str | None, float]


@dataclass(frozen=True)
class Findings:
    """Findings of an identification.

    Attributes
    ----------
    sets : per finding the effects that it may be, as (effect id, joint; None: the whole machine), the best first
    laws : (variable, joint) of each law of an unknown effect
    values : parameter name to (value, standard deviation); ``joint1.f_c`` and base-parameter names
    stated : per finding every candidate with its probability, the best first: (effect id, or variable of a law; joint;
        probability)
    unknown : joint to the probability that it has an effect of no catalogue, where that is more than nothing
    nothing : probability that nothing is missing, where nothing was found; else None
    depends : whether the report makes it depend on the bandwidth
    """

    sets: tuple[tuple[Place, ...], ...]
    laws: tuple[tuple[str, str | None], ...]
    values: Mapping[str, tuple[float, float]]
    stated: tuple[tuple[Stated, ...], ...] = ()
    unknown: Mapping[str, float] = field(default_factory=dict)
    nothing: float | None = None
    depends: bool = False

    @property
    def verdict(self) -> str:
        """The report's word for what is missing."""
        if any(len(members) > 1 for members in self.sets):
            return "ambiguous"
        return "unexplained" if self.laws else "effect_added" if self.sets else "nothing_missing"


@dataclass(frozen=True)
class Examined:
    """A session with what the residual loop finds in it: position sensors first, then efforts."""

    session: Session
    kinematics: Kinematics
    attribution: Attribution

    @classmethod
    def of(cls, session: Session) -> Self:
        """Run the loop."""
        found = kinematics(session.search.session)
        return cls(session, found, attributed(session, found.corrections))

    @property
    def hypotheses(self) -> tuple[Hypothesis, ...]:
        """Explanations of positions and efforts."""
        return together(self.kinematics.hypotheses, self.attribution.hypotheses)

    @property
    def found(self) -> bool:
        """True where anything was added."""
        return bool(self.attribution.accepted)

    def question(self) -> Asked | None:
        """Return the motion to record."""
        designed = next_experiment(self.session, self.attribution)
        return None if designed is None else asked_of(designed, self.session)

    def with_recording(self, recording: Recording) -> Self:
        """Run the loop on one recording more."""
        return type(self).of(self.session.with_recording(recording))


def recordings_of(machine: Machine, tables: Mapping[str, Mapping[str, FloatArray]]) -> list[Recording]:
    """Make recordings of tables in SI by file stem; the role precedes the hyphen."""
    result = []
    for stem, table in tables.items():
        values = {name: np.asarray(column) for name, column in table.items() if name != "time"}
        role = stem.partition("-")[0]
        result.append(Recording(machine.name, role, stem, stem, machine.rate_hz, np.asarray(table["time"]), values))
    return result


def judge(machine: Machine, recordings: Sequence[Recording], bootstrap: int, bands: Sequence[float]) -> list[Findings]:
    """Run the loop on recordings, with at most so many replicas, and put what it found into plain names.

    Parameters
    ----------
    bands : of the identification's own bandwidth, one answer for each
    """
    own = Session(machine, recordings, Options(bootstrap=bootstrap))
    hz = [min(band * own.bank.bandwidth_hz, machine.rate_hz / 5) for band in bands]
    others = {band: Options(bootstrap=bootstrap, bandwidth_hz=at) for band, at in zip(bands, hz, strict=True)}
    examined = [Examined.of(own if band == 1.0 else Session(machine, recordings, others[band])) for band in bands]
    found = [findings_of(one) for one in examined]
    return found if len(bands) == 1 else [replace(f, depends=_depends(e)) for f, e in zip(found, examined, strict=True)]


def _depends(examined: Examined) -> bool:
    """Test whether the report makes its verdict depend on the bandwidth (:func:`fitting.pipeline.verdict.label`)."""
    found, moved = examined.attribution, examined.kinematics
    if any(abs(value) < NAMED_FROM * std for item in found.accepted for _, value, std in item.cutoffs[1:]):
        return True
    if found.verdict != "nothing_missing" or moved.findings or moved.laws:
        return False
    return any(families for _, families in other_bands(examined.session.search.session, moved.corrections))


def findings_of(examined: Examined) -> Findings:
    """Return what the loop found, in plain names."""
    findings, found = examined.kinematics.findings, examined.attribution
    names = tuple(joint.name for joint in examined.session.machine.joints)

    def place(joint: int | None) -> str | None:
        return None if joint is None else names[joint]

    sets: list[tuple[Place, ...]] = [tuple((e, names[f.joint]) for e in (f.effect.id, *f.rivals)) for f in findings]
    laws: list[Place] = [(law.law.law.variable(names), names[law.joint]) for law in examined.kinematics.laws]
    for item in found.accepted:
        term = item.score.term
        if isinstance(term.content, Law):
            laws.append((term.content.variable(names), place(term.joint)))
        else:
            rivals = ((r.term.id, place(r.term.joint)) for r in item.rivals)
            members = tuple(dict.fromkeys([(term.id, place(term.joint)), *rivals]))
            sets = [own for own in sets if own[0] != members[0]]  # a name is listed once
            sets.append(members)
    added = {item.score.term.family for item in found.accepted}
    sets += [
        (("supply_ripple", names[line.joint]),)
        for line in {line.joint: line for line in found.ripples}.values()
        if ("supply_ripple", line.joint) not in added
    ]
    laws += [
        (item.score.term.content.variable(names), place(item.score.term.joint))
        for item in found.unconfirmed
        if isinstance(item.score.term.content, Law)
    ]
    parameters, fit = found.model.design.parameters, found.model.fit
    base = dict(zip(parameters.base.expressions, parameters.base.names, strict=True))
    values = {
        base.get(name, name): (float(value), float(std))
        for name, value, std, determined in zip(parameters.names, fit.theta, fit.std, fit.determined, strict=False)
        if determined
    }
    return Findings(tuple(sets), tuple(laws), values, _stated(found, findings, names), *_beyond(found, names))


def _stated(
    found: Attribution, findings: Sequence[KinematicFinding], names: Sequence[str]
) -> tuple[tuple[Stated, ...], ...]:
    """Collect findings of kinematics and efforts, with probabilities; spectral lines have none."""

    def shown(term: Term, probability: float) -> Stated:
        content, joint = term.content, None if term.joint is None else names[term.joint]
        return (content.variable(tuple(names)) if isinstance(content, Law) else term.id), joint, probability

    moved = [
        tuple(
            (effect, names[f.joint], p)
            for effect, p in zip((f.effect.id, *f.rivals), (f.probability, *f.rival_probabilities), strict=True)
        )
        for f in findings
    ]
    efforts = [
        tuple(
            shown(score.term, p)
            for score, p in zip((item.score, *item.rivals), (item.probability, *item.rival_probabilities), strict=False)
        )
        for item in found.accepted
        if item.score.term.id != "supply_ripple"
    ]
    return (*moved, *efforts)


def _beyond(found: Attribution, names: Sequence[str]) -> tuple[dict[str, float], float | None]:
    """Return per joint the probability of an effect of no catalogue; and of nothing, without findings."""
    unknown: dict[str, float] = {}
    total = sum(h.probability for h in found.hypotheses)
    for hypothesis in found.hypotheses:
        for joint in {t.joint for t in hypothesis.terms if isinstance(t.content, Law) and t.joint is not None}:
            unknown[names[joint]] = unknown.get(names[joint], 0.0) + hypothesis.probability / total
    empty = [h.probability for h in found.hypotheses if not h.terms]
    return unknown, None if found.accepted or not empty else empty[0]
