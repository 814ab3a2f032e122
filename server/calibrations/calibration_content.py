"""The part of a report (schema ``hilfit/report/1``) that a calibration keeps when reports are deleted."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from server.identifications.identification_results import verdict_of
from server.platform.http.bodies import Shown

#: Of what is kept of a report; the model itself (``hilfit/model/1``) is a file of the identification.
SUMMARY_SCHEMA = "hilfit/calibration/1"
#: Parts of a report that are the model, or say what it was made of; the rest is evidence.
_MODEL = ("machine", "created", "software", "bandwidth_hz", "reduction", "cylinders", "rigid_body", "errors")
#: What the loop added to the model.
_LOOP = ("effects", "unexplained")


class Parameter(Shown):
    """A parameter in the unit that it has in the report."""

    name: str
    value: float | None
    std: float | None
    unit: str | None


@dataclass(frozen=True)
class Content:
    """Of one report.

    Attributes
    ----------
    verdict, overall : the loop's verdict; errors of all joints together, before and after
    errors : per joint, of its ``errors``: unit, noise floor, and the error before and after
    parameters : of cylinders ``joint1.f_c``, of the rigid bodies their
        expression, of added effects ``effect:joint.parameter``
    model : what stays of the model when the identification's files go: parameters, effects, errors
    """

    verdict: str
    overall: dict[str, Any]
    errors: dict[str, Any]
    parameters: list[Parameter]
    model: dict[str, Any]


def content_of(report: Mapping[str, Any]) -> Content:
    """Extract the content that a report has; parts that it lacks are empty."""
    loop = report["loop"]
    model = {"schema": SUMMARY_SCHEMA} | {key: report[key] for key in _MODEL if key in report}
    model |= {key: loop[key] for key in _LOOP if key in loop}
    return Content(
        verdict=verdict_of(report),
        overall=dict(report["overall"]),
        errors=dict(report.get("errors", {})),
        parameters=list(_parameters(report)),
        model=model,
    )


def _parameters(report: Mapping[str, Any]) -> Iterator[Parameter]:
    for joint, cylinder in report.get("cylinders", {}).items():
        for name, entry in cylinder["parameters"].items():
            yield _parameter(f"{joint}.{name}", entry)
    for entry in report.get("rigid_body", {}).get("parameters", ()):
        yield _parameter(entry["expression"], entry)
    for effect in report["loop"].get("effects", ()):
        place = effect["id"] if effect["joint"] is None else f"{effect['id']}:{effect['joint']}"
        for name, entry in effect["parameters"].items():
            yield _parameter(f"{place}.{name}", entry)


def content_of_valves(report: Mapping[str, Any]) -> Content:
    """Extract the content of a report on valves (schema ``hilfit/valve/1``), of all axes."""
    axes: Mapping[str, Any] = report["axes"]
    verdicts = {own["verdict"] for own in axes.values()}
    return Content(
        verdict=next(word for word in VERDICTS if word in verdicts),
        overall={},
        errors={joint: _speed_errors(own["errors"]) for joint, own in axes.items()},
        parameters=[parameter for joint, own in axes.items() for parameter in _of_axis(joint, own)],
        model={"schema": SUMMARY_SCHEMA, "machine": report["machine"], "created": report["created"]}
        | {"software": report["software"], "axes": {joint: own["model"] for joint, own in axes.items()}},
    )


#: Of several axes the first of these counts.
VERDICTS = ("unexplained", "ambiguous", "effect_added", "nothing_missing")


def _speed_errors(errors: Mapping[str, Any]) -> dict[str, Any]:
    role = errors["role"]
    return {"unit": errors["unit"], "before": {role: errors["before"]}, "after": {role: errors["handed_out"]}}


def _of_axis(joint: str, axis: Mapping[str, Any]) -> Iterator[Parameter]:
    yield _parameter(f"{joint}.delay", axis["delay"])
    for way, own in axis["directions"].items():
        for name in ("edge_at_2_percent", "gain", "speed_at_largest") if own["moves"] else ():
            if name in own:
                yield _parameter(f"{joint}.{way}.{name}", own[name])


def _parameter(name: str, entry: Mapping[str, Any]) -> Parameter:
    return Parameter(name=name, value=entry["value"], std=entry.get("std"), unit=entry.get("unit"))
