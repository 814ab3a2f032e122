"""`report.json`, schema `hilfit/report/1`: its only definition, its check and its published JSON schema.

Keys may be added, never renamed: every object takes further keys. Numbers that do not exist are null, never NaN, which
JSON does not have. Errors are of measured minus predicted effort, in the joint's effort unit: ``train`` and
``validate`` are standard deviations, further sizes stand beside them (:class:`ErrorPair`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from datetime import date
from typing import Any, Literal

import numpy as np
from pydantic import Field, ValidationError

from daq.errors import HilfitError
from daq.messages import Sentence
from daq.validation_words import in_words
from fitting.report.schema.loop import Loop, Part, Value

SCHEMA = "hilfit/report/1"


class ReportError(HilfitError):
    """A report is not what `hilfit/report/1` says."""


class DataEvent(Part):
    """What happened to a device or a bus while a recording was made."""

    time: float | None = None  # s since its first row; negative: before
    device: str
    what: str
    text: str
    seconds: float | None = None  # None: it lasted on when the recording ended
    count: int = Field(ge=0)


class DataFile(Part):
    """A recording that was used."""

    role: str
    file: str
    sha256: str
    samples: int = Field(ge=0)
    events: list[DataEvent] = Field(default_factory=list)


class Reduction(Part):
    """From the standard parameters of the links to those that act on the joints at all."""

    standard_parameters: int
    base_parameters: int


class CylinderResult(Part):
    """Drive parameters of one joint."""

    parameters: dict[str, Value]
    residual_std: float | None = None
    unit: str | None = None
    stage_1: dict[str, Any] | None = None


class BaseParameter(Part):
    """A base parameter: the combination of link parameters that it is."""

    name: str | None = None
    expression: str
    value: float | None
    std: float | None
    unit: str
    told_by_data: float | None = None


class RigidBody(Part):
    """Stage 2."""

    estimator: str
    condition_number: float | None
    parameters: list[BaseParameter]


class ErrorPair(Part):
    """Error on the motion that was fitted, and on the one that was not.

    The bare role is the standard deviation; ``rms`` and ``mean`` see a constant offset too; ``relative`` is the norm of
    the error over that of the measured effort (0.03 is 3 %). Reports of earlier versions have the bare roles only.
    """

    train: float | None = None
    train_rms: float | None = None
    train_mean: float | None = None
    train_relative: float | None = None
    validate_: float | None = Field(default=None, alias="validate")
    validate_rms: float | None = None
    validate_mean: float | None = None
    validate_relative: float | None = None


class JointErrors(Part):
    """Errors of one joint."""

    unit: str
    noise_floor: float | None
    noise_floor_valid: bool = True
    before: ErrorPair
    after: ErrorPair
    two_stage: ErrorPair | None = None


class OneShot(Part):
    """The regression of everything at once."""

    condition_number: float | None
    errors: dict[str, ErrorPair]
    relative: dict[str, Any] | None = None


class OverallSize(Part):
    """One size of the error of all joints, on the validation motion and (``train_``) on the one that was fitted."""

    before: float | None = None
    after: float | None = None
    train_before: float | None = None
    train_after: float | None = None


class OverallRelative(OverallSize):
    """Relative error of all joints.

    ``of`` is ``stacked`` (norm of all joints' errors over that of all joints' efforts) where all joints have one unit,
    else ``joints`` (root mean square of the joints' relative errors).
    """

    of: Literal["stacked", "joints"] = "stacked"


class Overall(Part):
    """All joints together, on the validation motion; ``rms`` and ``mean`` are in noise floors as well."""

    before: float | None
    after: float | None
    change_percent: float | None
    ci95_percent: tuple[float, float] | None
    role: Literal["train", "validate"] | None = None
    unit: str | None = None
    rms: OverallSize | None = None
    mean: OverallSize | None = None
    relative: OverallRelative | None = None


def looked(loop: Mapping[str, Any]) -> bool:
    """Return whether a report's ``loop`` looked for what the model lacks; without the key it did."""
    return bool(loop.get("looked", True))


class Way(Part):
    """One way to the base model's parameters, with its relative errors."""

    name: str
    what: str = ""
    training_error: float | None = None
    held_out_error: float | None = None


class Estimation(Part):
    """The ways to the parameters that were tried, and why one is handed out."""

    chosen: str
    tried: list[Way]
    why: str


class Violation(Part):
    """A parameter that cannot be, physically."""

    kind: str
    joint: str | None
    parameter: str
    value: float | None
    std: float | None
    unit: str
    sigmas: float | None
    text: str
    cause: str


class Plausibility(Part):
    """Parameters that cannot be, and beside them the fit that keeps to what can (``constrained``)."""

    violations: list[Violation] = Field(default_factory=list)
    constrained: dict[str, Any] | None = None


class Checked(Part):
    """What may be wrong with files or wiring, and its cure."""

    code: str
    joint: str | None = None
    channel: str | None = None
    text: str
    cure: str
    severity: Literal["mistake", "note"] = "mistake"


class Shift(Part):
    """How far a parameter moved when the effects were added."""

    name: str
    before: float | None
    after: float | None
    sigmas: float | None


class Report(Part):
    """`report.json`."""

    schema_: Literal["hilfit/report/1"] = Field(alias="schema")
    machine: str
    created: str
    software: dict[str, Any]
    data: list[DataFile]
    reduction: Reduction
    cylinders: dict[str, CylinderResult]
    rigid_body: RigidBody
    one_shot: OneShot | None = None
    errors: dict[str, JointErrors]
    overall: Overall
    loop: Loop
    estimation: Estimation | None = None
    plausibility: Plausibility | None = None
    parameter_shifts: list[Shift]
    warnings: list[str]
    checks: list[Checked] = Field(default_factory=list)
    bandwidth_hz: float | None = None
    noise_floor_method: str | None = None
    summary: Summary | None = None
    figures: FigureData | None = None
    messages: dict[str, MessageOf] = Field(default_factory=dict)  # of sentences in it


def clean(value: Any) -> Any:
    """Convert to plain JSON types: arrays to lists, NaN and infinities to null.

    Raises
    ------
    ReportError
        If something has no place in JSON.
    """
    if value is None or isinstance(value, (str, bool, int)):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, np.generic):
        return clean(value.item())
    if isinstance(value, np.ndarray):
        return clean(value.tolist())
    if isinstance(value, Mapping):
        return {str(key): clean(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [clean(entry) for entry in value]
    if isinstance(value, date):
        return value.isoformat()
    raise ReportError("fitting.report_holds_json_cannot", name=type(value).__name__)


def validate_report(report: Mapping[str, Any]) -> dict[str, Any]:
    """Check a report against `hilfit/report/1` and return it cleaned (see :func:`clean`), nothing added.

    Raises
    ------
    ReportError
        One line that names the first key that is wrong.
    """
    cleaned: dict[str, Any] = clean(report)
    try:
        Report.model_validate(cleaned)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        more = Sentence("fitting.and_more", error=error.error_count() - 1) if error.error_count() > 1 else ""
        raise ReportError("fitting.report_json", place=place, first=in_words(first), more=more, schema=SCHEMA) from None
    return cleaned


def json_schema() -> dict[str, Any]:
    """Return the JSON schema of `report.json`."""
    return Report.model_json_schema(by_alias=True)


Points = list[float | None]


class Said(Part):
    """The result in a few words and in one sentence."""

    label: str
    sentence: str


class MessageOf(Part):
    """Code and values of a sentence (:mod:`daq.messages`); a value may be another one, or a list."""

    code: str
    values: dict[str, Any]
    worded: dict[str, str] | None = None  # in other languages, where a text is of another distribution


class Summary(Said):
    """In English, and by their codes in the other languages of the report."""

    languages: dict[str, Said] = Field(default_factory=dict)


class ScatterFigure(Part):
    """Residual against the variable of what was found, and the law (:class:`fitting.report.model.Scatter`)."""

    joint: str
    variable: str
    unit: str
    effort_unit: str
    x: Points
    before: Points
    after: Points
    partial: Points | None = None
    direction: list[int] | None = None
    law_x: Points
    law_y: Points
    law_std: Points
    law_back: Points | None = None


class FrictionFigure(Part):
    """Friction over speed, before and after (:class:`fitting.report.model.FrictionCurve`)."""

    joint: str
    unit_x: str
    unit_y: str
    speed: Points
    force: Points
    std: Points
    after: Points | None = None


class DiagnosticsFigure(Part):
    """What is left of one joint over time, lag and frequency (:class:`fitting.report.model.JointDiagnostics`)."""

    joint: str
    unit: str
    fit_before: float | None
    fit_after: float | None
    bound: float | None
    time: list[float]
    measured: Points
    before: Points
    after: Points
    lag: list[float]
    auto: Points
    cross_lag: list[float]
    cross: Points
    frequency: list[float]
    density_before: Points
    density_after: Points


class FigureData(Part):
    """Values of the figures."""

    scatter: list[ScatterFigure] = Field(default_factory=list)
    friction: list[FrictionFigure] = Field(default_factory=list)
    diagnostics: list[DiagnosticsFigure] = Field(default_factory=list)
