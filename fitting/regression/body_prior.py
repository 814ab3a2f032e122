"""Prior of the links: from drawings (CAD), or from an earlier calibration.

Two kinds of file are read. A *drawing* (YAML or JSON)::

    schema: hilfit/body-prior/1
    relative_std: 0.3            # how far the drawing may be off, as a share; 0.3 if absent
    links:                       # base to tip, each in its own frame of the machine file's table
      - {mass: 98.0, centre: [-0.51, 0.02, -0.03], inertia: [0.4, 0.0, 0.0, 6.9, 0.0, 6.9]}
                                 # kg; m; kg m^2 about the centre of mass: XX XY XZ YY YZ ZZ (matrix entries)

or the `report.json` of an earlier identification of the same machine, whose base parameters are taken with their
standard deviations, widened by a tenth of the parameter's size: the arm may have changed since.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt
import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from daq import safe_yaml
from daq.errors import InputError
from daq.validation_words import in_words
from fitting.arm.base_parameters import BaseParameters
from fitting.arm.dynamics import standard_of_link
from fitting.arrays import FloatArray

#: How far an arm may have moved from its last calibration, as a share of each parameter's size.
REPORT_DRIFT = 0.1
_DRAWING = "hilfit/body-prior/1"
_REPORT = "hilfit/report/1"


@dataclass(frozen=True)
class BodyPrior:
    """Expected base parameters.

    Attributes
    ----------
    mean, std : (nb,) expectation and standard deviation, in the order and units of the base parameters; a deviation
        is infinite where nothing is expected
    standard : (10 n,) inertial parameters of the links as in :mod:`fitting.arm.dynamics`, None where only the base
        parameters are known
    source : name of the file
    """

    mean: FloatArray
    std: FloatArray
    standard: FloatArray | None
    source: str

    @property
    def bodies(self) -> FloatArray | None:
        """Pseudo-inertias (n, 4, 4) of the links; None where only base parameters are known."""
        return (
            None if self.standard is None else np.array([pseudo_inertia(row) for row in self.standard.reshape(-1, 10)])
        )


class _Link(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)
    mass: float = Field(gt=0)
    centre: tuple[float, float, float]
    inertia: tuple[float, float, float, float, float, float]


class Drawing(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)
    schema_: Literal["hilfit/body-prior/1"] = Field(alias="schema")
    relative_std: float = Field(default=0.3, gt=0)
    links: list[_Link]


class _Value(BaseModel):
    model_config = ConfigDict(allow_inf_nan=False)
    value: float | None = None
    std: float | None = Field(default=None, ge=0)


class BaseParameter(_Value):
    expression: str


class RigidBody(BaseModel):
    parameters: list[BaseParameter] = []


class _Drive(BaseModel):
    model_config = ConfigDict(allow_inf_nan=False)
    parameters: dict[str, _Value] = {}
    residual_std: float | None = None


class Report(BaseModel):
    """The part of a ``report.json`` that is read."""

    schema_: Literal["hilfit/report/1"] = Field(alias="schema")
    rigid_body: RigidBody | None = None
    cylinders: dict[str, _Drive] | None = None

    def drive(self, joint: str) -> _Drive:
        """Return parameters and noise of a joint's drive; none of either if unidentified."""
        return (self.cylinders or {}).get(joint) or _Drive()


def read_expected(path: Path) -> Drawing | Report:
    """Read either kind of file, for whatever machine.

    Raises
    ------
    InputError
        One line naming file and key: unreadable, of another schema, or not as its schema asks.
    """
    try:
        text = path.read_text(encoding="utf-8")
        content = json.loads(text) if text.startswith("{") else safe_yaml.read(text)[1]
    except (OSError, ValueError, RecursionError, yaml.YAMLError) as error:
        what = " ".join(str(error).split())[:120]
        raise InputError("fitting.cannot_read_yaml_json", path=path, what=what) from None
    schema = content.get("schema") if isinstance(content, dict) else None
    if schema not in (_REPORT, _DRAWING):
        raise InputError("fitting.prior_schema", path=path, schema=json.dumps(schema), drawing=_DRAWING, report=_REPORT)
    try:
        return (Report if schema == _REPORT else Drawing).model_validate(content)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise InputError("fitting.prior_value_wrong", path=path, key=key, what=in_words(first)) from None


def read_body_prior(path: Path, base: BaseParameters) -> BodyPrior:
    """Read either kind of file for a machine with these base parameters.

    Raises
    ------
    InputError
        One line naming file and key: unreadable, of another schema, or of another machine.
    """
    found = read_expected(path)
    return _from_report(path, found, base) if isinstance(found, Report) else _from_drawing(path, found, base)


def _from_drawing(path: Path, drawing: Drawing, base: BaseParameters) -> BodyPrior:
    links = base.inertial_columns // 10
    if len(drawing.links) != links:
        raise InputError("fitting.links_given_machine", path=path, count=len(drawing.links), links=links)
    rows, spreads = [], []
    for number, link in enumerate(drawing.links):
        central = np.zeros((3, 3))
        central[np.triu_indices(3)] = link.inertia
        row = standard_of_link(link.mass, link.centre, central)
        if np.linalg.eigvalsh(pseudo_inertia(row)).min() < -1e-9 * np.trace(pseudo_inertia(row)):
            raise InputError("fitting.links_inertia_no_body", path=path, number=number)
        rows.append(row)
        # Each kind of parameter is as uncertain in every direction as it is large: a drawing's zero is no promise.
        sizes = [row[0], *[np.linalg.norm(row[1:4])] * 3, *[(row[4] + row[7] + row[9]) / 3] * 6]
        spreads.append(drawing.relative_std * np.array(sizes))
    standard, spread = np.concatenate(rows), np.concatenate(spreads)
    of_links, of_motors = np.split(base.regrouping, [base.inertial_columns], axis=1)
    std = np.maximum(np.sqrt(of_links**2 @ spread**2), 1e-12)
    std[np.any(of_motors != 0, axis=1)] = np.inf  # a drawing of the links determines nothing of a motor's friction
    return BodyPrior(of_links @ standard, std, standard, path.name)


def _from_report(path: Path, report: Report, base: BaseParameters) -> BodyPrior:
    entries = report.rigid_body.parameters if report.rigid_body is not None else []
    if len(entries) != len(base):
        raise InputError("fitting.parameters_given", path=path, given=len(entries), known=len(base))
    mean, own = np.zeros(len(base)), np.full(len(base), np.inf)
    for number, (entry, expression) in enumerate(zip(entries, base.expressions, strict=True)):
        if entry.expression != expression:
            raise InputError(
                "fitting.parameter_of_another_machine",
                path=path,
                number=number,
                expression=entry.expression,
                own=expression,
            )
        if entry.value is not None and entry.std is not None:
            mean[number], own[number] = entry.value, entry.std
    return BodyPrior(mean, np.sqrt(own**2 + (REPORT_DRIFT * _sizes(mean, base)) ** 2), None, path.name)


def _sizes(mean: FloatArray, base: BaseParameters) -> FloatArray:
    """Compute parameters' sizes: RMS of those of its link with its unit (``MX`` and ``MY`` together)."""
    link = base.independent // 10
    sizes = np.zeros(len(mean))
    for i, unit in enumerate(base.units):
        same = [k for k in range(len(mean)) if link[k] == link[i] and base.units[k] == unit]
        sizes[i] = np.sqrt(np.mean(mean[same] ** 2))
    return np.asarray(np.maximum(sizes, 1e-12))


def pseudo_inertia(link: npt.ArrayLike) -> FloatArray:
    """Compute the pseudo-inertia (4, 4) of a link's ten parameters: ``[[Sigma, h], [h', m]]``.

    ``Sigma = tr(I) / 2 E - I`` is the second moment of mass about the origin. Ten numbers are those of a body that can
    exist just if this matrix is positive definite (Wensing, Kim and Slotine, IEEE RA-L 3 (2018) 60).
    """
    m, h, moments = np.split(np.asarray(link, dtype=float), [1, 4])
    inertia = np.zeros((3, 3))
    inertia[np.triu_indices(3)] = moments
    inertia = inertia + np.triu(inertia, 1).T
    out = np.zeros((4, 4))
    out[:3, :3] = np.trace(inertia) / 2 * np.eye(3) - inertia
    out[:3, 3] = out[3, :3] = h
    out[3, 3] = m[0]
    return out
