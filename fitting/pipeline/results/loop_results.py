"""What the kinematic check and the residual loop hand on: frozen dataclasses that are kept as JSON."""

from __future__ import annotations

from dataclasses import field

from daq.motion_files import Rods
from fitting.pipeline.results.stored_types import Json, Numbers, StoredHypothesis, StoredTerm, stored
from fitting.residual.change_points import ChangePoint
from fitting.residual.findings import Candidate
from fitting.residual.lines import Line
from fitting.residual.terms import Term


@stored
class Kinematic:
    """An effect between two position sensors of one joint (:class:`fitting.loop.kinematic_check.KinematicFinding`).

    Attributes
    ----------
    steps : what was rebuilt, as :func:`fitting.residual.stored_terms.step_to_json` has it
    effect, candidate : its entries of ``loop`` in report.json
    """

    steps: tuple[Json, ...]
    effect: Json
    candidate: Json


@stored
class AcceptedTerm:
    """A term that was added to the model (:class:`fitting.residual.findings.Accepted`).

    Attributes
    ----------
    term : the effect or law
    rivals, evidence, probability : what report.json states of it, however large the final fit finds it
    """

    term: StoredTerm
    rivals: tuple[Json, ...] = ()
    evidence: Json = field(default_factory=dict)
    probability: float | None = None


@stored
class OtherBand:
    """Findings of the loop with another bandwidth of the filter, in words."""

    bandwidth_hz: float
    found: tuple[str, ...]


@stored
class Program:
    """A designed motion that closes a set; ``chance`` is that of a single name after its recordings."""

    rods: Rods
    time: Numbers
    columns: dict[str, Numbers]
    text: str
    chance: float


@stored
class Designed:
    """The experiment that best separates the members of a set: as the report has it, and its motion."""

    content: Json
    program: Program | None = None


@stored
class Attributed:
    """Attribution of the residual.

    Attributes
    ----------
    verdict : of the loop alone
    looked : False where nobody looked
    accepted : terms of the model, in their order
    candidates : what was tried
    limits, unconfirmed : what would have been seen, and laws that were not added: entries of report.json
    hypotheses : explanations of the efforts, the most probable first
    nothing : probability that nothing is missing in the efforts
    nothing_more : the same beside as many findings as are looked for
    lines, changes, other_bands : what else was seen
    next_experiment : what would close an ambiguity
    warnings : sentences
    """

    verdict: str
    looked: bool = True
    accepted: tuple[AcceptedTerm, ...] = ()
    candidates: tuple[Candidate, ...] = ()
    limits: tuple[Json, ...] = ()
    hypotheses: tuple[StoredHypothesis, ...] = ()
    nothing: float = 1.0
    nothing_more: float = 1.0
    unconfirmed: tuple[Json, ...] = ()
    lines: tuple[Line, ...] = ()
    changes: tuple[ChangePoint, ...] = ()
    other_bands: tuple[OtherBand, ...] = ()
    next_experiment: Designed | None = None
    warnings: tuple[str, ...] = ()

    @property
    def terms(self) -> list[Term]:
        """The accepted terms."""
        return [accepted.term for accepted in self.accepted]


@stored
class ClosingStep:
    """A motion that was recorded to close an ambiguity, with the explanations before and after it."""

    before: tuple[StoredHypothesis, ...]
    motion: Json
    after: tuple[StoredHypothesis, ...]


@stored
class Resolution:
    """Motions that were recorded to close ambiguities."""

    steps: tuple[ClosingStep, ...] = ()
