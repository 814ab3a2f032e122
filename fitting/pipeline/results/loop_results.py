"""What the kinematic check and the residual loop hand on: frozen dataclasses that are kept as JSON."""

from __future__ import annotations

from dataclasses import dataclass

from daq.motion_files import Rods
from fitting.loop.kinematic_check import KinematicFinding, step_to_json
from fitting.pipeline.results.stored_types import Json, Numbers, StoredHypothesis, StoredTerm, stored
from fitting.residual.change_points import ChangePoint
from fitting.residual.findings import Candidate
from fitting.residual.terms import Term


@stored
@dataclass(frozen=True)
class Kinematic:
    """An effect between two position sensors of one joint (:class:`fitting.loop.kinematic_check.KinematicFinding`).

    Attributes
    ----------
    steps : what was rebuilt, as :func:`fitting.loop.kinematic_check.step_to_json` has it
    values, stds : totals of its parameters
    gain, score : chi-square that it takes, and log posterior odds against nothing
    gap_before, gap_after : root mean square of the filtered gap, m
    rivals, rival_probabilities : what explains the gap as well
    probability : that it is this
    """

    steps: tuple[Json, ...]
    values: tuple[float, ...]
    stds: tuple[float, ...]
    gain: float
    score: float
    gap_before: float
    gap_after: float
    rivals: tuple[str, ...]
    probability: float
    rival_probabilities: tuple[float, ...]

    @classmethod
    def of(cls, found: KinematicFinding) -> Kinematic:
        """A finding with its steps as JSON."""
        return cls(**{**vars(found), "steps": tuple(step_to_json(step) for step in found.steps)})


@stored
@dataclass(frozen=True)
class Cutoff:
    """An effect's leading parameter at another cut-off of the identification filter."""

    hz: float
    value: float
    std: float


@stored
@dataclass(frozen=True)
class Bias:
    """Replicas that a null distribution was drawn from, and the variance found over the theory's."""

    draws: int
    inflation: float


@stored
@dataclass(frozen=True)
class Rival:
    """What explains the same; ``joint`` is its number, None of what acts everywhere."""

    id: str
    joint: int | None
    score: float
    probability: float | None


@stored
@dataclass(frozen=True)
class AcceptedTerm:
    """A term that was added to the model, with its evidence (:class:`fitting.residual.findings.Accepted`)."""

    term: StoredTerm
    score: float
    gain: float
    surviving: float
    held_out_gain: float
    held_out_z: float
    validate_gain: float | None
    witness: str
    cutoffs: tuple[Cutoff, ...] = ()
    null: Bias | None = None
    rivals: tuple[Rival, ...] = ()
    probability: float | None = None


@stored
@dataclass(frozen=True)
class Limit:
    """The smallest size of an effect's parameter that these recordings would have shown, with the chance ``power``."""

    id: str
    joint: int | None
    smallest: float
    power: float
    parameter: str
    unit: str


@stored
@dataclass(frozen=True)
class UnconfirmedLaw:
    """Structure of a joint that no term was added for; ``law`` is its curve, ``evidence`` what speaks for it.

    What two position sensors disagree by has a probability, and effects that it could be all the same.
    """

    joint: int
    variable: str
    second_variable: str | None
    times_sign_of_speed: bool
    only_while: str | None
    unit: str
    law: Json
    evidence: Json
    probability: float | None = None
    could_be: tuple[Rival, ...] = ()


@stored
@dataclass(frozen=True)
class SpectralLine:
    """A periodic disturbance of one joint's effort; frequency (Hz) and amplitude with their deviations."""

    joint: int
    frequency: tuple[float, float]
    amplitude: tuple[float, float]
    p: float
    in_band: bool
    ripple: bool


@stored
@dataclass(frozen=True)
class OtherBand:
    """What the loop finds with another bandwidth of the filter, in words."""

    bandwidth_hz: float
    found: tuple[str, ...]


@stored
@dataclass(frozen=True)
class Program:
    """A designed motion that closes a set; ``chance`` is that of a single name after its recordings."""

    rods: Rods
    time: Numbers
    columns: dict[str, Numbers]
    text: str
    chance: float


@stored
@dataclass(frozen=True)
class Designed:
    """The experiment that best separates the members of a set: as the report has it, and its motion."""

    content: Json
    program: Program | None = None


@stored
@dataclass(frozen=True)
class Attributed:
    """What the residual was traced to.

    Attributes
    ----------
    verdict : of the loop alone
    looked : False where nobody looked
    accepted : terms of the model, in their order
    candidates, limits : what was tried, and what would have been seen
    hypotheses : explanations of the efforts, the most probable first
    nothing : probability that nothing is missing in the efforts
    unconfirmed, lines, changes, other_bands : what else was seen
    next_experiment : what would close an ambiguity
    warnings : sentences
    """

    verdict: str
    looked: bool = True
    accepted: tuple[AcceptedTerm, ...] = ()
    candidates: tuple[Candidate, ...] = ()
    limits: tuple[Limit, ...] = ()
    hypotheses: tuple[StoredHypothesis, ...] = ()
    nothing: float = 1.0
    unconfirmed: tuple[UnconfirmedLaw, ...] = ()
    lines: tuple[SpectralLine, ...] = ()
    changes: tuple[ChangePoint, ...] = ()
    other_bands: tuple[OtherBand, ...] = ()
    next_experiment: Designed | None = None
    warnings: tuple[str, ...] = ()

    @property
    def terms(self) -> list[Term]:
        """The accepted terms."""
        return [accepted.term for accepted in self.accepted]


@stored
@dataclass(frozen=True)
class ClosingStep:
    """A motion that was recorded to close an ambiguity, with the explanations before and after it."""

    before: tuple[StoredHypothesis, ...]
    motion: Json
    after: tuple[StoredHypothesis, ...]


@stored
@dataclass(frozen=True)
class Resolution:
    """Motions that were recorded to close ambiguities."""

    steps: tuple[ClosingStep, ...] = ()
