"""``model.json`` (schema ``hilfit/model/1``): a model on disk.

Numbers are written with all their digits: a model that was read back predicts the same numbers. Keys are added in later
versions, never renamed.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from daq.errors import InputError
from daq.machine.machine_file import Machine
from daq.recordings.recording_files import replacing
from daq.validation_words import in_words
from fitting.arm.base_parameters import BaseParameters
from fitting.effects.base import Ranges
from fitting.loop.residual_loop import term_from_json, term_to_json
from fitting.model.arm_model import ArmModel, Pass, Provenance, Source
from fitting.model.tails import Tail
from fitting.residual.views import RodLaw
from fitting.signals.preparation import PositionNoise

FloatArray = npt.NDArray[np.float64]

SCHEMA = "hilfit/model/1"
#: Its name beside a report.
MODEL_FILE = "model.json"


class _Part(BaseModel):
    """A part of the file; keys of later versions are passed over."""

    model_config = ConfigDict(extra="ignore", allow_inf_nan=False)


class _Filter(_Part):
    bandwidth_hz: float = Field(gt=0)


class _Noise(_Part):
    position: float
    speed: float
    acceleration: float


class _Base(_Part):
    independent: list[int]
    regrouping: list[list[float]]
    names: list[str]
    expressions: list[str]
    units: list[str]
    standard_names: list[str]
    standard_count: int
    vanished: list[str]
    gap: tuple[float, float]


class _Ranges(_Part):
    x: tuple[float, float]
    v: float
    force: float
    time: tuple[float, float]


class _Rod(_Part):
    knots: list[list[float]]
    coefficients: list[float]
    speed_noise: float


class _Pass(_Part):
    theta: list[float]
    ranges: list[_Ranges]
    rods: list[_Rod | None]


class _Source(_Part):
    role: str
    file: str
    sha256: str
    samples: int


class _Provenance(_Part):
    created: str
    software: dict[str, str]
    data: list[_Source]
    verdict: str
    calibration: str | None = None


class _Tail(_Part):
    level: float = Field(ge=0)
    rate: float = Field(gt=0)
    scale: float = Field(ge=0)
    shape: float = Field(ge=0)


class _File(_Part):
    schema_: Literal["hilfit/model/1"] = Field(alias="schema")
    machine: dict[str, Any]
    corrections: list[dict[str, Any]]
    filter: _Filter
    position_noise: list[_Noise]
    base: _Base
    terms: list[dict[str, Any]]
    passes: list[_Pass] = Field(min_length=1)
    covariance: list[list[float | None]]
    told: list[bool]
    residual_std: list[float]
    provenance: _Provenance
    tails: list[_Tail] | None = None


def model_to_json(model: ArmModel) -> dict[str, Any]:
    """A model as plain JSON; :func:`model_from_json` reads it back."""
    base = asdict(model.base)
    std = np.where(np.isfinite(model.std), model.std, np.nan)
    return {
        "schema": SCHEMA,
        "provenance": asdict(model.provenance),
        "parameters": [
            {"name": name, "value": float(value), "std": None if np.isnan(own) else float(own), "unit": unit}
            for name, value, own, unit in zip(
                model.parameter_names, model.theta, std, model.parameter_units, strict=True
            )
        ],
        "machine": model.machine.model_dump(mode="json", by_alias=True, exclude_none=True),
        "corrections": [dict(step) for step in model.steps],
        "filter": {"bandwidth_hz": model.bandwidth_hz},
        "position_noise": [asdict(own) for own in model.noise],
        "base": {key: _plain(value) for key, value in base.items()},
        "terms": [term_to_json(term) for term in model.terms],
        "passes": [
            {
                "theta": own.theta.tolist(),
                "ranges": [asdict(r) for r in own.ranges],
                "rods": [None if rod is None else _rod(rod) for rod in own.rods],
            }
            for own in model.passes
        ],
        "covariance": [[v if np.isfinite(v) else None for v in row] for row in model.covariance.tolist()],
        "told": model.told.tolist(),
        "residual_std": model.residual_std.tolist(),
        "tails": None if model.tails is None else [asdict(own) for own in model.tails],
    }


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray) else value


def _rod(law: RodLaw) -> dict[str, Any]:
    return {
        "knots": [knots.tolist() for knots in law.knots],
        "coefficients": law.coefficients.tolist(),
        "speed_noise": law.speed_noise,
    }


def model_from_json(content: Any, name: str = "model") -> ArmModel:
    """Inverse of :func:`model_to_json`; ``name`` is what errors call it.

    Raises
    ------
    InputError
        One line that names the key.
    """
    if not isinstance(content, dict) or not str(content.get("schema", "")).startswith("hilfit/model/"):
        raise InputError(f"{name}: is no model; give the model.json of an identification, or the folder it is in")
    if content["schema"] != SCHEMA:
        raise InputError(f"{name}: has schema {content['schema']}, this version reads {SCHEMA}; update hilfit")
    try:
        file = _File.model_validate(content)
        machine = Machine.model_validate(file.machine)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"])) or "machine"
        raise InputError(f"{name}: {place}: {in_words(first)}; identify again, the file was changed") from None
    try:
        terms = tuple(term_from_json(term) for term in file.terms)
    except KeyError as error:
        raise InputError(
            f"{name}: terms: {error} is not known here; install the package that has this effect"
        ) from None
    model = ArmModel(
        machine=machine,
        steps=tuple(file.corrections),
        base=BaseParameters(
            independent=np.array(file.base.independent, dtype=np.intp),
            regrouping=np.array(file.base.regrouping),
            names=tuple(file.base.names),
            expressions=tuple(file.base.expressions),
            units=tuple(file.base.units),
            standard_names=tuple(file.base.standard_names),
            standard_count=file.base.standard_count,
            vanished=tuple(file.base.vanished),
            gap=file.base.gap,
        ),
        bandwidth_hz=file.filter.bandwidth_hz,
        noise=tuple(PositionNoise(own.position, own.speed, own.acceleration) for own in file.position_noise),
        terms=terms,
        passes=tuple(
            Pass(
                np.array(own.theta),
                tuple(Ranges(r.x, r.v, r.force, r.time) for r in own.ranges),
                tuple(None if rod is None else _rod_law(rod) for rod in own.rods),
            )
            for own in file.passes
        ),
        covariance=np.array([[np.inf if v is None else v for v in row] for row in file.covariance]),
        told=np.array(file.told, dtype=bool),
        residual_std=np.array(file.residual_std),
        provenance=Provenance(
            created=file.provenance.created,
            software=file.provenance.software,
            data=tuple(Source(d.role, d.file, d.sha256, d.samples) for d in file.provenance.data),
            verdict=file.provenance.verdict,
            calibration=file.provenance.calibration,
        ),
        tails=None
        if file.tails is None
        else tuple(Tail(own.level, own.rate, own.scale, own.shape) for own in file.tails),
    )
    _require_shapes(model, name)
    return model


def _rod_law(rod: _Rod) -> RodLaw:
    return RodLaw(tuple(np.array(knots) for knots in rod.knots), np.array(rod.coefficients), rod.speed_noise)


def _require_shapes(model: ArmModel, name: str) -> None:
    """Refuse a file whose parts do not belong together."""
    joints, count, base = len(model.joints), len(model.parameter_names), model.base
    wanted = {
        "base.regrouping": (base.regrouping.shape, (len(base.independent), len(base.standard_names))),
        "base.names": ((len(base.names),), (len(base.independent),)),
        "covariance": (model.covariance.shape, (count, count)),
        "told": (model.told.shape, (count,)),
        "position_noise": ((len(model.noise),), (joints,)),
        "residual_std": (model.residual_std.shape, (joints,)),
        "tails": ((joints if model.tails is None else len(model.tails),), (joints,)),
    }
    for number, own in enumerate(model.passes):
        first = len(model.passes) > 1 and number == 0
        wanted[f"passes.{number}.theta"] = (own.theta.shape, (len(model.parameters) if first else count,))
        wanted[f"passes.{number}.ranges"] = ((len(own.ranges),), (joints,))
        wanted[f"passes.{number}.rods"] = ((len(own.rods),), (joints,))
    for place, (found, right) in wanted.items():
        if found != right:
            raise InputError(
                f"{name}: {place}: has shape {found}, it must be {right}; identify again, the file was changed"
            )


def save_model(path: str | Path, model: ArmModel) -> Path:
    """Write a model; the file appears whole or not at all.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    path = Path(path)
    text = json.dumps(model_to_json(model), allow_nan=False, indent=1)
    try:
        with replacing(path) as temporary:
            temporary.write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror}); choose another place") from None
    return path


def load_model(path: str | Path) -> ArmModel:
    """Read a model: ``model.json``, or the folder of a report that holds it.

    Raises
    ------
    InputError
        One line: file, key, what is wrong and what to do.
    """
    path = Path(path)
    if path.is_dir():
        path = path / MODEL_FILE
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; 'hilfit identify' writes it beside report.json") from None
    except (UnicodeDecodeError, json.JSONDecodeError) as error:
        raise InputError(f"{path}: is not JSON ({error}); give the model.json of an identification") from None
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read ({error.strerror}); give the model.json of an identification"
        ) from None
    return model_from_json(content, str(path))
