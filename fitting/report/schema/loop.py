"""``loop`` of `report.json`: what the residual loop found; and what all objects of the report are made of."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

Verdict = Literal[
    "check_input", "implausible", "not_examined", "nothing_missing", "effect_added", "ambiguous", "unexplained"
]
Status = Literal["accepted", "rejected", "indistinguishable", "artefact"]


class Part(BaseModel):
    """An object of the report; keys of later versions are taken as they are."""

    model_config = ConfigDict(extra="allow", allow_inf_nan=False)


class Value(Part):
    """A number with its standard deviation and unit.

    ``told_by_data`` is the share of what is known of it that came from the recordings; below a half, ``std`` is None.
    """

    value: float | None = None
    std: float | None = None
    unit: str | None = None
    told_by_data: float | None = None


class Named(Part):
    """An effect by id, at a joint or (null) at the whole machine."""

    id: str
    joint: str | None = None
    title: str | None = None


class Likely(Named):
    """An effect by id, and how probable it is."""

    probability: float | None = None


class LawPlace(Part):
    """A law of no catalogue: its joint and variable; whether it turns its sign with the direction of motion, or acts
    only while the speed of the joint (of its piston) has one sign."""

    joint: str | None
    variable: str
    times_sign_of_speed: bool = False
    only_while: Literal["positive", "negative"] | None = None


class Hypothesis(Part):
    """One explanation of everything: effects and laws beside the base model; none of either is "nothing"."""

    effects: list[Named] = Field(default_factory=list)
    laws: list[LawPlace] = Field(default_factory=list)
    probability: float


class RecordedMotion(Part):
    """A designed motion that was recorded to close an ambiguity; ``chance`` is what was expected of it."""

    text: str
    rods: str
    seconds: float
    recording: str
    separates: list[str] = Field(default_factory=list)
    chance: float


class ResolutionStep(Part):
    """Explanations before a motion was recorded, and with its recording, the most probable first."""

    before: list[Hypothesis]
    motion: RecordedMotion
    after: list[Hypothesis]


class WorstPlace(Part):
    """Where on its variable an effect is largest; of one that turns with the motion, more or less friction there."""

    variable: str
    at: float
    unit: str
    friction: Literal["more", "less"] | None = None


class Amplitude(Part):
    """How large an effect is over the motions that were fitted, on the joint where it is largest."""

    largest: float
    rms: float
    unit: str
    joint: str | None = None
    worst: WorstPlace | None = None


class AddedEffect(Likely):
    """An effect that was added to the model."""

    equation: str | None = None
    look_at: str = ""
    parameters: dict[str, Value] = Field(default_factory=dict)
    amplitude: Amplitude | None = None
    indistinguishable_from: list[Likely | str] = Field(default_factory=list)
    evidence: dict[str, Any] = Field(default_factory=dict)


class SimpleFormula(Part):
    """The simple formula nearest to a law: its shape (an exponent, or in the signal's unit) and the share it explains.

    ``rising`` is false of a threshold that acts below its place, and of an exponential that falls.
    """

    kind: Literal["power", "exponential", "threshold", "sine", "step"]
    shape: float
    rising: bool
    amplitude: float
    share: float


class Law(Part):
    """A measured law: value and standard deviation over a grid of its variable, and the nearest simple formula."""

    grid: list[float] = Field(default_factory=list)
    value: list[float] = Field(default_factory=list)
    std: list[float] = Field(default_factory=list)
    formula: SimpleFormula | None = None


class Unexplained(LawPlace):
    """Structure that no known effect fits for certain; ``could_be`` has those that may be it all the same."""

    second_variable: str | None = None
    unit: str | None = None
    law: Law
    added: bool = True
    probability: float | None = None
    could_be: list[Likely] = Field(default_factory=list)
    evidence: dict[str, Any] = Field(default_factory=dict)


class Candidate(Named):
    """An effect that was tried."""

    score: float | None = None
    status: Status
    reason: str = ""


class DetectionLimit(Named):
    """The smallest size of an effect that these recordings would have shown."""

    smallest: float | None
    unit: str


class NextExperiment(Part):
    """The motion that would tell apart what these recordings cannot.

    ``motion`` and ``why`` are sentences, ``separates`` the ids; ``rods`` says whether the rods are on the arm
    (``pinned``). ``closable`` says whether that motion is expected to leave a single name, null where none was
    designed; ``motion_file`` is null where no motion is recommended; ``otherwise`` is what else tells, by hand or an
    instrument.
    """

    motion: str | None = None
    closable: bool | None = None
    why: str | None = None
    separates: list[str] = Field(default_factory=list)
    joint: str | None = None
    kind: str | None = None
    motion_file: str | None = None
    rods: Literal["pinned", "unpinned"] | None = None
    seconds: float | None = None
    otherwise: list[str] = Field(default_factory=list)


class Loop(Part):
    """What the residual loop found."""

    verdict: Verdict
    label: Literal["cannot_tell", "depends_on_band"] | None = None
    reasons: list[str] = Field(default_factory=list)
    effects: list[AddedEffect] = Field(default_factory=list)
    unexplained: list[Unexplained] = Field(default_factory=list)
    hypotheses: list[Hypothesis] = Field(default_factory=list)
    candidates: list[Candidate] = Field(default_factory=list)
    detection_limits: list[DetectionLimit] = Field(default_factory=list)
    looked: bool = True
    next_experiment: NextExperiment | str | None = None
    resolution: list[ResolutionStep] = Field(default_factory=list)
