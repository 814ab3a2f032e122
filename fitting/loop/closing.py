"""Closing an ambiguity: the designed motion is recorded, joins the data, and everything is identified again.

:func:`close` does that until one hypothesis has 95 %, as long as a motion of this arm is expected to get there. It
knows neither a plant nor a bus: whoever can record a motion is a :class:`Recorder`. What is identified again is an
:class:`Identified`: the whole program with its stages (:mod:`fitting.pipeline.resolving`), or its loop alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, Self, TypeVar

from daq.motion_files import Motion
from daq.recordings.recording import Recording
from fitting.effects.base import Effect
from fitting.loop.session import Session
from fitting.planning.next_experiment import MOST_RECORDINGS, NextExperiment, design_next, term_label
from fitting.residual.findings import Accepted, Attribution, Hypothesis
from fitting.residual.laws import Law
from fitting.residual.terms import Term
from fitting.selection import priors
from fitting.selection.decision import MOST_NAMED

#: Seconds of a designed motion, and generations of its search: one that a machine makes by itself may be long.
SECONDS, GENERATIONS = 60.0, 6


@dataclass(frozen=True)
class Asked:
    """A motion that somebody is asked to record.

    Attributes
    ----------
    motion : the motion program; it starts and ends at rest
    text : what it is, in plain words
    separates : labels of what it is to separate
    chance : that one of them is left alone afterwards, as it was predicted
    """

    motion: Motion
    text: str
    separates: tuple[str, ...]
    chance: float

    @property
    def role(self) -> str:
        """Role of its recording: ``unloaded`` with the rods off their pins, else ``train``."""
        return "unloaded" if self.motion.rods == "unpinned" else "train"


class Recorder(Protocol):
    """Somebody who can record a motion: an operator at an arm, a simulated machine, a plant in memory."""

    def __call__(self, asked: Asked, number: int) -> Recording:
        """Let the machine follow ``asked.motion`` and return its recording in the role ``asked.role``.

        Parameters
        ----------
        asked : the motion, whose columns are joint positions in rad (m), or piston positions in m with rods unpinned
        number : of the motion, from 1

        Raises
        ------
        HilfitError
            If it cannot be recorded; nothing is identified then.
        """


class Identified(Protocol):
    """Recordings and what was found in them, which can be identified again with one more recording."""

    @property
    def hypotheses(self) -> tuple[Hypothesis, ...]:
        """Explanations, the most probable first."""

    @property
    def found(self) -> bool:
        """True where anything was found at all: where nothing is missing there is nothing to close."""

    def question(self) -> Asked | None:
        """Return the motion most informative beside these recordings; None if there is none, or nothing is open."""

    def with_recording(self, recording: Recording) -> Self:
        """Identify again with all recordings and this one."""


Kind = TypeVar("Kind", bound=Identified)


@dataclass(frozen=True)
class Step:
    """One motion that was recorded: explanations before it and after it, the most probable first."""

    before: tuple[Hypothesis, ...]
    asked: Asked
    recording: str
    after: tuple[Hypothesis, ...]


def settled(hypotheses: Sequence[Hypothesis]) -> bool:
    """Return whether one explanation has the probability from which it is reported."""
    return bool(hypotheses) and hypotheses[0].probability >= priors.CREDIBLE


def close(first: Kind, record: Recorder, most: int = MOST_RECORDINGS) -> tuple[Kind, tuple[Step, ...]]:
    """Record at most so many designed motions until one hypothesis has 95 %.

    Returns
    -------
    The last identification, and what was done: no step where nothing was ambiguous, or no motion of this arm is
    expected to help.
    """
    steps: list[Step] = []
    last = first
    while len(steps) < most and last.found and not settled(last.hypotheses):
        asked = last.question()
        if asked is None:
            break
        recording = record(asked, len(steps) + 1)
        after = last.with_recording(recording)
        steps.append(Step(last.hypotheses, asked, recording.file, after.hypotheses))
        last = after
    return last, tuple(steps)


def next_experiment(session: Session, found: Attribution) -> NextExperiment | None:
    """Design the experiment that best separates the members of the first set; None without any."""
    for item in found.accepted:
        rivals, chances = rivals_of(item, found)
        if len(rivals) > 1:
            return design_next(
                found.model, rivals, session.prior, chances=chances, seconds=SECONDS, generations=GENERATIONS
            )
    return None


def asked_of(designed: NextExperiment, session: Session) -> Asked | None:
    """Build the request for a recording; None if no motion is expected to close the set."""
    best = designed.best
    if best is None or best.motion is None:
        return None
    names = tuple(joint.name for joint in session.machine.joints)
    labels = tuple(term_label(term, names) for term in designed.rivals)
    return Asked(best.motion, best.text, labels, designed.chance)


def rivals_of(item: Accepted, found: Attribution) -> tuple[tuple[Term, ...], tuple[float, ...]]:
    """List the alternatives of a finding, itself first, and each one's probability.

    The names of its set; where it is short of 95 % without one, the laws that are missing to that as well.
    """
    term = item.score.term
    if term.confined:
        return (term,), (item.probability,)
    terms, chances = [term], [item.probability]
    if isinstance(term.content, Effect):
        pairs = zip(item.rivals, item.rival_probabilities, strict=False)
        terms += [rival.term for rival, _ in pairs]
        chances += item.rival_probabilities[: len(terms) - 1]
    for other, chance in _alternatives(item, found):
        if sum(chances) >= priors.CREDIBLE or len(terms) >= MOST_NAMED:
            break
        if other.family not in {t.family for t in terms} or isinstance(other.content, Law):
            terms.append(other)
            chances.append(chance)
    return tuple(terms), tuple(chances)


def _alternatives(item: Accepted, found: Attribution) -> list[tuple[Term, float]]:
    """List hypotheses' terms in place of a finding, with probabilities, the best first, without its own term."""
    own = item.score.term
    places = [n for h in found.hypotheses[:1] for n, t in enumerate(h.terms) if t.family == own.family]
    if not places:
        return []
    chances: dict[tuple[object, ...], tuple[Term, float]] = {}
    for hypothesis in found.hypotheses:
        if len(hypothesis.terms) != len(found.hypotheses[0].terms):
            continue
        term = hypothesis.terms[places[0]]
        if term.family == own.family and not isinstance(own.content, Law):
            continue
        key = term.label if isinstance(term.content, Law) else term.family
        _, known = chances.get(key, (term, 0.0))
        chances[key] = (term, known + hypothesis.probability)
    if isinstance(own.content, Law):  # the law as it was added has another resolution than the one that was compared
        chances = {k: v for k, v in chances.items() if not _same_law(v[0], own)}
    return sorted(chances.values(), key=lambda pair: -pair[1])


def _same_law(one: Term, other: Term) -> bool:
    a, b = one.content, other.content
    return isinstance(a, Law) and isinstance(b, Law) and (a.signals, a.parity) == (b.signals, b.parity)
