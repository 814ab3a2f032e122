"""What the loop says: what was added, what was refused and why, what is there and could not be explained."""

from __future__ import annotations

from dataclasses import dataclass

from fitting.residual.change_points import ChangePoint
from fitting.residual.confirmation.cross_validation import HeldOut
from fitting.residual.laws import Law
from fitting.residual.lines import Line
from fitting.residual.scoring import Score
from fitting.residual.terms import Model, Term

#: Effect id (``law``) and joint.
Family = tuple[str, int | None]


@dataclass(frozen=True)
class Accepted:
    """One effect or law that was added.

    Attributes
    ----------
    score : as it was chosen
    rivals : the other members of its set, at most two, best first
    held_out : its gain on held-out blocks of the fitted recordings
    validate_gain : chi-square that it takes off the whitened residual of `validate`; None without one
    witness : what unloaded and loaded recordings say of it, in words; empty where only one kind is there
    cutoffs : its leading parameter at several cut-offs of the filter: (Hz, value, standard deviation)
    probability : that it is this, and neither a rival, nor a law, nor nothing
    rival_probabilities : the same of each rival
    """

    score: Score
    rivals: tuple[Score, ...]
    held_out: HeldOut
    validate_gain: float | None
    witness: str = ""
    cutoffs: tuple[tuple[float, float, float], ...] = ()
    probability: float = 1.0
    rival_probabilities: tuple[float, ...] = ()

    @property
    def doubtful(self) -> bool:
        """Whether what is in no catalogue is more probable than this name and its rivals together."""
        named = not isinstance(self.score.term.content, Law)
        return named and self.probability + sum(self.rival_probabilities) < 0.5


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


@dataclass(frozen=True)
class Attribution:
    """Result of the loop.

    Attributes
    ----------
    base, model : the base model and the final one
    accepted : what was added
    candidates : every family with what was said of it
    limits : the first round's scores, for detection limits
    warnings : lines for people
    unconfirmed : laws of what is there but does not hold on another motion
    lines : spectral lines of the residual (those inside the band are in ``accepted`` as well)
    changes : moments from which on a joint behaves otherwise
    hypotheses : explanations, the most probable first
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
    hypotheses: tuple[Hypothesis, ...] = ()

    @property
    def verdict(self) -> str:
        """Verdict of the report."""
        if not self.accepted:
            return "unexplained" if self.unconfirmed else "effect_added" if self.lines else "nothing_missing"
        if any(isinstance(a.score.term.content, Law) or a.doubtful for a in self.accepted):
            return "unexplained"
        return "ambiguous" if any(a.rivals for a in self.accepted) else "effect_added"
