"""Result of every stage: one frozen dataclass each, and the one codec that keeps them as JSON.

A stage gets a :class:`StageResults` with what was found before it and gives its own result. Between processes results
are files: :func:`to_json` writes one, :func:`from_json` reads it back, equal in every number.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Annotated, Any, TypeVar

from pydantic import Field, TypeAdapter, ValidationError

from daq.errors import HilfitError
from daq.messages import messages_in
from daq.validation_words import in_words
from fitting.checks.findings import Finding
from fitting.loop.weighting import Weights
from fitting.pipeline.cylinder_stage import CylinderEstimate
from fitting.pipeline.results.loop_results import Attributed, Kinematic
from fitting.pipeline.results.stored_types import Flags, Json, Numbers, StoredHypothesis, stored

_T = TypeVar("_T")


#: Sizes of errors by name, one of each joint; None where a role has no recording.
Errors = dict[str, list[float | None]]


@stored
class Checked:
    """The recordings fit the machine and excite it.

    Attributes
    ----------
    bandwidth_hz : of the identification filter
    self_check : largest difference of the regressor from Newton and Euler's equations, relative
    standard_parameters, base_parameters : how many there are
    repeated : whether two runs of one motion separate noise from structure
    findings : of the checks of files and wiring
    """

    bandwidth_hz: float
    self_check: float
    standard_parameters: int
    base_parameters: int
    repeated: bool
    findings: tuple[Finding, ...] = ()


@stored
class Cylinders:
    """Stage 1 of all joints."""

    cylinders: tuple[CylinderEstimate, ...]


@stored
class Stacked:
    """Parameters from one regression of joint efforts.

    Attributes
    ----------
    estimator, details : which, and what it reported
    theta, std, determined : (p,) values, deviations (0 where there is none), and whether the motion determines each
    condition_number : of the column-scaled regressor
    errors : sizes of errors on the uncorrected recordings, in each joint's effort unit
    relative : relative error of all joints by role; ``of`` states which way
    """

    estimator: str
    details: Json
    theta: Numbers
    std: Numbers
    determined: Annotated[Flags, Field(alias="told")]
    condition_number: float
    errors: Errors
    relative: Json


@stored
class RigidBody:
    """Stage 2 with friction frozen, and the one-shot regression beside it.

    Attributes
    ----------
    two_stage, one_shot : the two orders of work
    two_stage_ols : stage 2 by least squares, where ``two_stage`` is another estimator
    one_shot_with_unloaded : with the unloaded recordings, where there are any
    """

    two_stage: Stacked
    one_shot: Stacked
    two_stage_ols: Stacked | None = None
    one_shot_with_unloaded: Stacked | None = None


@stored
class Residual:
    """Noise floor, and what two position sensors state of each other.

    Attributes
    ----------
    noise_floor : (n,) per joint, in its effort unit
    floor_valid : (n,) False where what is given is the error that the fit leaves, a bound from above
    measured : whether it was measured by two runs of one motion
    kinematics : what was found between position sensors
    laws : what they disagree by without a known cause, as report.json has it
    hypotheses : explanations of what they disagree by, the most probable first
    """

    noise_floor: tuple[float, ...]
    floor_valid: tuple[bool, ...]
    measured: bool
    kinematics: tuple[Kinematic, ...] = ()
    laws: tuple[Json, ...] = ()
    hypotheses: tuple[StoredHypothesis, ...] = ()

    @property
    def steps(self) -> tuple[Json, ...]:
        """Steps of all kinematic corrections."""
        return tuple(step for finding in self.kinematics for step in finding.steps)


@stored
class Fitted:
    """Parameters of a joint fit, (p,) each; ``share`` of their information that came from the data."""

    theta: Numbers
    std: Numbers
    determined: Annotated[Flags, Field(alias="told")]
    share: Numbers


@stored
class Constrained:
    """The nearest parameters that physics allows, their errors, and by how many percent these are larger, by role."""

    theta: Numbers
    errors: Errors
    price_percent: dict[str, float | None]


@stored
class Physics:
    """Parameters that cannot be, and the fit that keeps to what can, where there are any."""

    violations: tuple[Json, ...] = ()
    constrained: Constrained | None = None


@stored
class Refitted:
    """Both stages refitted jointly with what was found.

    Attributes
    ----------
    chosen : base parameters by the estimator that was asked for; None where that is the joint fit
    comparison : hierarchical against one-shot (:func:`fitting.pipeline.comparison.compare`)
    weights : ``whitened`` or ``equal``
    estimation : the ways that were tried (:func:`fitting.pipeline.comparison.estimation`)
    joint : parameters of the joint refit with what was found
    before, after : those that are handed out, without and with what was found
    parameter_error : what uncertain parameters make of the error shown, in noise floors
    predicted_std : (n,) what uncertain parameters and what the training motions left make of each joint's error on
        ``validate``; None where there is none
    independent_rows : effective number of rows by role
    plausibility : what cannot be
    condition_number : of the fit after
    drive_residual_std : per joint; None without rows
    errors : sizes ``before`` and ``after``; of the ``joint`` refit beside an estimator that was asked for
    overall : all joints together (:func:`fitting.regression.error_sizes.overall_errors`)
    """

    chosen: Stacked | None
    comparison: Json
    weights: Weights
    estimation: Json
    joint: Fitted
    before: Fitted
    after: Fitted
    parameter_error: float
    predicted_std: tuple[float | None, ...]
    independent_rows: dict[str, float]
    plausibility: Physics
    condition_number: float
    drive_residual_std: tuple[float | None, ...]
    errors: dict[str, Errors]
    overall: Json


@stored
class Written:
    """File names of the report and its page."""

    report: str
    page: str


#: Stage to the type of its result.
RESULTS: Mapping[str, type[Any]] = {
    "check": Checked,
    "cylinder_stage": Cylinders,
    "rigid_body_stage": RigidBody,
    "residual": Residual,
    "attribution": Attributed,
    "refit": Refitted,
    "report": Written,
}


@dataclass(frozen=True)
class StageResults:
    """Results of the stages so far, by type: ``results[Residual].noise_floor``.

    Attributes
    ----------
    found : results by type
    messages : sentences of results that were read from files, with their codes and values
    """

    found: Mapping[type[Any], Any] = field(default_factory=dict)
    messages: Mapping[str, Any] = field(default_factory=dict)

    def __getitem__(self, kind: type[_T]) -> _T:
        """Return the result of that type; KeyError where its stage has not run."""
        result: _T = self.found[kind]
        return result

    def get(self, kind: type[_T]) -> _T | None:
        """Return the result of that type, if there is one."""
        return self.found.get(kind)

    def having(self, result: Any, messages: Mapping[str, Any] | None = None) -> StageResults:
        """Return these and one more."""
        return StageResults({**self.found, type(result): result}, {**self.messages, **(messages or {})})


#: Of a type, made once: it takes longer than what it is made for.
_adapter: Callable[[Any], TypeAdapter[Any]] = cache(TypeAdapter)


def to_json(result: Any) -> dict[str, Any]:
    """Return a stage's result as plain JSON content, with the ``messages`` in it."""
    content = _adapter(type(result)).dump_python(result, mode="json", by_alias=True, warnings="error")
    messages = messages_in(result)
    return {**content, "messages": messages} if messages else dict(content)


def from_json(kind: type[_T], content: Mapping[str, Any], place: str) -> _T:
    """Invert :func:`to_json`; ``place`` is named where the content is none of that kind.

    Raises
    ------
    HilfitError
        One line with the place and the first key that is wrong.
    """
    try:
        result: _T = _adapter(kind).validate_python({name: own for name, own in content.items() if name != "messages"})
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise HilfitError(
            "fitting.another_version_remove_directory", place=place, where=where, first=in_words(first)
        ) from None
    return result
