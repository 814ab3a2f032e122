"""Findings of the loop: what was added, what was rejected and why, what is there and could not be explained."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from fitting.residual.change_points import ChangePoint
from fitting.residual.confirmation.cross_validation import HeldOut
from fitting.residual.laws import Law
from fitting.residual.lines import Line, ripples
from fitting.residual.scoring import Score
from fitting.residual.terms import Model, Term

#: Effect id (``law``) and joint.
Family = tuple[str, int | None]
#: What may be in one place of the model with its probability; None: nothing. What is missing to one was refused.
Place = tuple[tuple[Term | None, float], ...]

#: Explanations that are listed, and alternatives of one place that these are made of.
MOST_LISTED, MOST_COMBINED = 8, 5
#: Probability below which an explanation is not listed.
LEAST = 0.005


@dataclass(frozen=True)
class Accepted:
    """One effect or law that was added.

    Attributes
    ----------
    score : as it was chosen
    rivals : the other members of its set, at most two, best first
    held_out : its gain on held-out blocks of the fitted recordings
    validate_gain : chi-square that it takes off the whitened residual of `validate`; None without one
    witness : what unloaded and loaded recordings show of it, in words; empty where only one kind is there
    cutoffs : its leading parameter at several cut-offs of the filter: (Hz, value, standard deviation)
    probability : that it is this, and neither a rival, nor a law, nor nothing
    rival_probabilities : the same of each rival
    silence : why the validation motion confirms nothing of it, if it does not
    """

    score: Score
    rivals: tuple[Score, ...]
    held_out: HeldOut
    validate_gain: float | None
    witness: str = ""
    cutoffs: tuple[tuple[float, float, float], ...] = ()
    probability: float = 1.0
    rival_probabilities: tuple[float, ...] = ()
    silence: str = ""


@dataclass(frozen=True)
class Unconfirmed:
    """A law of what is certainly there in the fitted motions, but does not hold on others: it is not added.

    Attributes
    ----------
    score : as it was chosen
    held_out : its gain on held-out blocks of the fitted recordings
    validate_gain : what it would have done to the chi-square of `validate`: nothing good
    """

    score: Score
    held_out: HeldOut
    validate_gain: float


@dataclass(frozen=True)
class Candidate:
    """One line of the report's table of candidates."""

    id: str
    joint: int | None
    score: float
    status: str
    reason: str


@dataclass(frozen=True)
class Hypothesis:
    """One explanation of all that was measured: terms beside the base, and how probable it is."""

    terms: tuple[Term, ...]
    probability: float


def combined(choices: Sequence[Sequence[tuple[tuple[Term, ...], float]]]) -> tuple[Hypothesis, ...]:
    """Combine explanations of independent questions, each with its answers: terms and probability."""
    return most_probable(
        Hypothesis(tuple(t for terms, _ in answers for t in terms), float(np.prod([p for _, p in answers])))
        for answers in product(*choices)
    )


def most_probable(hypotheses: Iterable[Hypothesis]) -> tuple[Hypothesis, ...]:
    """List explanations, the most probable first."""
    listed = (h for h in hypotheses if h.probability > LEAST)
    return tuple(sorted(listed, key=lambda h: -h.probability)[:MOST_LISTED])


@dataclass(frozen=True)
class Attribution:
    """Result of the loop.

    Attributes
    ----------
    base, model : the base model and the final one
    accepted : what was added
    candidates : every family with its status
    limits : the first round's scores, for detection limits
    warnings : lines for people
    unconfirmed : laws of what is there but does not hold on another motion
    lines : spectral lines of the residual (those inside the band are in ``accepted`` as well)
    changes : moments from which on a joint behaves otherwise
    places : questions that were asked of the data, each with its answers
    """

    base: Model
    model: Model
    accepted: tuple[Accepted, ...]
    candidates: tuple[Candidate, ...]
    limits: tuple[Score, ...]
    warnings: tuple[str, ...]
    unconfirmed: tuple[Unconfirmed, ...] = ()
    lines: tuple[Line, ...] = ()
    changes: tuple[ChangePoint, ...] = ()
    places: tuple[Place, ...] = ()
    nothing_more: float = 1.0
    """Probability that nothing is missing beside as many as are looked for; 1 where the search ended by itself."""

    @property
    def hypotheses(self) -> tuple[Hypothesis, ...]:
        """Whole explanations, the most probable first; places are taken for independent."""
        choices = [sorted(place, key=lambda own: -own[1])[:MOST_COMBINED] for place in self.places]
        return combined([[(() if t is None else (t,), p) for t, p in place] for place in choices])

    @property
    def nothing(self) -> float:
        """Probability that nothing is missing in any place."""
        return float(np.prod([sum(p for term, p in place if term is None) for place in self.places]))

    def refusing(self, reasons: Mapping[Family, str], status: str = "rejected") -> Attribution:
        """Remove terms rejected after they had been chosen, with a reason for each in the table.

        What speaks for it is there, and is none of the rest.
        """
        places = tuple(
            tuple((term, p) for term, p in place if term is None or term.family not in reasons) for place in self.places
        )
        accepted = tuple(item for item in self.accepted if item.score.term.family not in reasons)
        return replace(self, accepted=accepted, places=places).with_status({f: (status, r) for f, r in reasons.items()})

    def narrowed(self, reasons: Mapping[Family, str]) -> Attribution:
        """Remove explanations that another one of their place fits better than, on everything: it has their part."""
        places = list[Place]()
        for place in self.places:
            kept = tuple((term, p) for term, p in place if term is None or term.family not in reasons)
            whole, left = (sum(p for _, p in own) for own in (place, kept))
            places.append(tuple((term, p * whole / left) for term, p in kept) if left > 0 else kept)
        return replace(self, places=tuple(places)).with_status({f: ("rejected", r) for f, r in reasons.items()})

    def with_status(self, changed: Mapping[Family, tuple[str, str]]) -> Attribution:
        """Set another status and reason in some lines of the table."""
        lines = ((c, *changed.get((c.id, c.joint), (c.status, c.reason))) for c in self.candidates)
        return replace(self, candidates=tuple(replace(c, status=s, reason=r) for c, s, r in lines))

    @property
    def ripples(self) -> list[Line]:
        """Lines that are named although nothing is added."""
        design = self.base.design
        return ripples(design.machine, self.lines, design.bank.bandwidth_hz)

    @property
    def verdict(self) -> str:
        """Verdict of the report by the probabilities that are shown."""
        if all(item.score.term.is_line for item in self.accepted):
            if self.unconfirmed or self.nothing < 0.5:
                return "unexplained"
            return "effect_added" if self.accepted or (self.lines and self.ripples) else "nothing_missing"
        if any(isinstance(a.score.term.content, Law) for a in self.accepted) or self.nothing_more < 0.5:
            return "unexplained"
        return "ambiguous" if any(a.rivals for a in self.accepted) else "effect_added"
