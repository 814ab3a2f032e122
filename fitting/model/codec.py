"""``model.json`` (schema ``hilfit/model/1``): a model on disk.

Numbers are written with all their digits: a model that was read back predicts the same numbers. Keys are added in later
versions, never renamed. ``sha256`` is of everything else that this schema knows, so a changed file is noticed.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from daq.errors import HilfitError, InputError
from daq.machine.machine_file import Machine
from daq.messages import Sentence
from daq.validation_words import in_words
from daq.whole_files import replacing
from fitting.arm.base_parameters import BaseParameters
from fitting.arrays import FloatArray
from fitting.effects.base import Ranges
from fitting.model import motion
from fitting.model.arm_model import ArmModel, Pass, Provenance, Seen
from fitting.model.tails import Tail
from fitting.residual.stored_terms import term_from_json, term_to_json
from fitting.residual.views import RodLaw
from fitting.signals.preparation import PositionNoise

SCHEMA = "hilfit/model/1"
#: Its name beside a report.
MODEL_FILE = "model.json"
#: Share of a covariance's own size by which it may fall short of being one.
_ROUNDED = 1e-6


def _rows(values: list[list[Any]]) -> FloatArray:
    """Convert rows of one length to an array; ``None`` is infinite."""
    if len({len(row) for row in values}) > 1:
        raise ValueError("rows have different lengths")
    return np.array([[np.inf if v is None else v for v in row] for row in values], dtype=float)


# Lists in the file, arrays once they are read; what is not known is no number.
Size = Annotated[float, Field(ge=0)]
Values = Annotated[list[float], AfterValidator(np.array)]
Sizes = Annotated[list[Size], AfterValidator(np.array)]
Known = Annotated[list[Size | None], AfterValidator(lambda values: np.array(values, dtype=float))]
Numbers = Annotated[list[Annotated[int, Field(ge=0)]], AfterValidator(lambda own: np.array(own, dtype=np.intp))]
Rows = Annotated[list[list[float]], AfterValidator(_rows)]


class _Part(BaseModel):
    """A part of the file; keys of later versions are passed over."""

    model_config = ConfigDict(extra="ignore", allow_inf_nan=False)


class _Filter(_Part):
    bandwidth_hz: float = Field(gt=0)


class _Base(_Part):
    independent: Numbers
    regrouping: Rows
    names: tuple[str, ...]
    expressions: tuple[str, ...]
    units: tuple[str, ...]
    standard_names: tuple[str, ...]
    standard_count: int = Field(ge=0)
    vanished: tuple[str, ...]
    gap: tuple[float, float]


class _Rod(_Part):
    knots: tuple[Values, ...]
    coefficients: Values
    speed_noise: Size


class _Pass(_Part):
    theta: Values
    ranges: tuple[Ranges, ...]
    rods: tuple[_Rod | None, ...]


class _Seen(_Part):
    q: Rows
    qd: Rows
    qdd: Rows
    effort: Rows
    error: Rows


class _Fit(_Part):
    """What one fit states."""

    terms: list[dict[str, Any]]
    passes: list[_Pass] = Field(min_length=1)
    covariance: Annotated[list[list[float | None]], AfterValidator(_rows)]
    told: Annotated[list[bool], AfterValidator(lambda values: np.array(values, dtype=bool))]
    residual_std: Sizes
    hidden: Sizes | None = None
    errors: Known | None = None
    coverage: Known | None = None


class _File(_Fit):
    schema_: Literal["hilfit/model/1"] = Field(alias="schema")
    machine: dict[str, Any]
    corrections: list[dict[str, Any]]
    filter: _Filter
    position_noise: tuple[PositionNoise, ...]
    base: _Base
    provenance: Provenance
    tails: tuple[Tail, ...] | None = None
    rests: list[_Fit] = []
    seen: _Seen | None = None
    temperature: tuple[Size, Size] | None = None
    sha256: str | None = None


def model_schema() -> dict[str, Any]:
    """Return the JSON schema of the file."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **_File.model_json_schema(by_alias=True)}


def model_to_json(model: ArmModel) -> dict[str, Any]:
    """Return a model as plain JSON; :func:`model_from_json` reads it back."""
    std = np.where(np.isfinite(model.std), model.std, np.nan)
    rows = zip(model.parameter_names, model.theta, std, model.parameter_units, strict=True)
    content = {
        "schema": SCHEMA,
        "provenance": asdict(model.provenance),
        "parameters": [
            {"name": name, "value": float(value), "std": None if np.isnan(own) else float(own), "unit": unit}
            for name, value, own, unit in rows
        ],
        "machine": model.machine.model_dump(mode="json", by_alias=True, exclude_none=True),
        "corrections": [dict(step) for step in model.steps],
        "filter": {"bandwidth_hz": model.bandwidth_hz},
        "position_noise": [asdict(own) for own in model.noise],
        "base": asdict(model.base),
        **_fit_to_json(model),
        "tails": None if model.tails is None else [asdict(own) for own in model.tails],
        "rests": [_fit_to_json(own) for own in model.rests],
        "seen": None if model.seen is None else asdict(model.seen),
        "temperature": model.temperature,
    }
    plain: dict[str, Any] = _plain(content)
    return plain | {"sha256": _checksum(plain)}


def _fit_to_json(model: ArmModel) -> dict[str, Any]:
    return {
        "terms": [term_to_json(term) for term in model.terms],
        "passes": [asdict(own) for own in model.passes],
        "covariance": [[v if np.isfinite(v) else None for v in row] for row in model.covariance.tolist()],
        "told": model.told,
        "residual_std": model.residual_std,
        "hidden": model.hidden,
        **{key: _known(getattr(model, key)) for key in ("errors", "coverage")},
    }


def _known(values: FloatArray | None) -> list[float | None] | None:
    return None if values is None else [None if np.isnan(own) else own for own in values.tolist()]


def _plain(value: Any) -> Any:
    """Convert arrays and tuples to lists, everywhere."""
    if isinstance(value, dict):
        return {key: _plain(own) for key, own in value.items()}
    if isinstance(value, np.ndarray):
        return value.tolist()
    return value if isinstance(value, str) or not hasattr(value, "__iter__") else [_plain(own) for own in value]


def _checksum(content: Mapping[str, Any]) -> str:
    """Compute SHA-256 of what the schema knows, without itself and a service's calibration."""
    known = {field.alias or name for name, field in _File.model_fields.items()} - {"sha256"}
    kept = {key: value for key, value in content.items() if key in known}
    if isinstance(kept.get("provenance"), dict):
        kept["provenance"] = {key: own for key, own in kept["provenance"].items() if key != "calibration"}
    return hashlib.sha256(json.dumps(kept, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def model_from_json(content: Any, name: str = "model") -> ArmModel:
    """Invert :func:`model_to_json`; errors call it ``name``.

    Raises
    ------
    InputError
        One line that names the key.
    """
    if not isinstance(content, dict) or not str(content.get("schema", "")).startswith("hilfit/model/"):
        raise InputError("fitting.no_model", name=name)
    if content["schema"] != SCHEMA:
        raise InputError("fitting.schema_version_reads", name=name, content=content["schema"], schema=SCHEMA)
    try:
        file = _File.model_validate(content)
        machine = Machine.model_validate(file.machine)
    except ValidationError as error:
        first = error.errors()[0]
        raise _damaged(name, ".".join(map(str, first["loc"])) or "machine", in_words(first)) from None
    except ArithmeticError as error:
        what = Sentence("fitting.part_not_calculable", reason=str(error.args[-1]))
        raise _damaged(name, "machine", what) from None
    model = ArmModel(
        machine=machine,
        steps=tuple(file.corrections),
        base=BaseParameters(**vars(file.base)),
        bandwidth_hz=file.filter.bandwidth_hz,
        noise=file.position_noise,
        provenance=file.provenance,
        tails=file.tails,
        temperature=file.temperature,
        seen=None if file.seen is None else Seen(**vars(file.seen)),
        **_fit_from_json(file, name, ""),
    )
    rests = tuple(replace(model, **_fit_from_json(own, name, f"rests.{k}.")) for k, own in enumerate(file.rests))
    for place, own in [("", model), *((f"rests.{k}.", own) for k, own in enumerate(rests))]:
        _require_sound(own, name, place)
    if file.sha256 is not None and file.sha256 != _checksum(content):
        raise InputError("fitting.sha_file_changed_after", name=name)
    return replace(model, rests=rests)


def _damaged(name: str, place: str, what: str) -> InputError:
    return InputError("fitting.identify_again_file_changed", name=name, place=place, what=what)


def _fit_from_json(file: _Fit, name: str, place: str) -> dict[str, Any]:
    terms = []
    for number, term in enumerate(file.terms):
        try:
            json.dumps(term, allow_nan=False)
            terms.append(term_from_json(term))
        except KeyError as error:
            at = f"{place}terms.{number}"
            raise InputError("fitting.not_known_here", name=name, at=at, error=error) from None
        except (TypeError, ValueError, AttributeError, IndexError):
            raise _damaged(name, f"{place}terms.{number}", Sentence("fitting.part_no_effect")) from None
    return {
        "terms": tuple(terms),
        "passes": tuple(
            Pass(**vars(own) | {"rods": tuple(None if rod is None else RodLaw(**vars(rod)) for rod in own.rods)})
            for own in file.passes
        ),
        **{key: getattr(file, key) for key in ("covariance", "told", "residual_std", "hidden", "errors", "coverage")},
    }


def _require_sound(model: ArmModel, name: str, place: str) -> None:
    """Refuse a file whose parts do not belong together, or that cannot be calculated with."""
    try:
        _require_shapes(model, name, place)
        sizes = {
            "position_noise": [own for noise in model.noise for own in asdict(noise).values()],
            "tails": [own for tail in model.tails or () for own in asdict(tail).values()],
            f"{place}passes": [r for own in model.passes for ranges in own.ranges for r in (ranges.v, ranges.force)],
        }
        below = next((key for key, own in sizes.items() if min(own, default=0.0) < 0), None)
        if below is not None:
            raise _damaged(name, below, Sentence("fitting.part_below_zero"))
        known = np.isfinite(np.diag(model.covariance))
        own = model.covariance[np.ix_(known, known)]
        wrong = _damaged(name, f"{place}covariance", Sentence("fitting.part_no_covariance"))
        if not np.isfinite(own).all() or np.any(np.diag(own) < 0):
            raise wrong
        size = np.sqrt(np.maximum(np.diag(own), 1e-300))
        scaled = own / size[:, None] / size
        alike = np.allclose(scaled, scaled.T, atol=_ROUNDED)
        if not alike or (len(own) and np.linalg.eigvalsh(scaled).min() < -_ROUNDED * len(own)):
            raise wrong
        held = motion.gravity(model, model.limits.mean(axis=0), temperature=model.usual_oil)
        if not np.isfinite(held).all():
            raise _damaged(name, f"{place}passes", Sentence("fitting.part_efforts_not_finite"))
    except (HilfitError, ArithmeticError, LookupError, TypeError, ValueError, AttributeError) as e:
        if isinstance(e, InputError) and str(e).startswith(f"{name}: "):
            raise
        what = str(e).splitlines()[0] if str(e) else type(e).__name__
        reason = Sentence("fitting.part_not_calculable", reason=what)
        raise _damaged(name, place.rstrip(".") or "model", reason) from None


def _require_shapes(model: ArmModel, name: str, place: str) -> None:
    for number, term in enumerate(model.terms):
        if term.joint is not None and not 0 <= term.joint < len(model.joints):
            what = Sentence("fitting.part_other_joint", joint=term.joint, count=len(model.joints))
            raise _damaged(name, f"{place}terms.{number}.joint", what)
    joints, count, base, n = len(model.joints), len(model.parameter_names), model.base, len(model.base.independent)
    standard = len(base.standard_names)
    wanted: dict[str, tuple[Any, tuple[int, ...]]] = {
        "base.regrouping": (base.regrouping, (n, standard)),
        **{f"base.{key}": (getattr(base, key), (n,)) for key in ("names", "expressions", "units")},
        **{key: (own, (joints,)) for key, own in (("position_noise", model.noise), ("tails", model.tails))},
        f"{place}covariance": (model.covariance, (count, count)),
        **{f"{place}{key}": (getattr(model, key), (count,)) for key in ("told", "hidden")},
        **{f"{place}{key}": (getattr(model, key), (joints,)) for key in ("residual_std", "errors", "coverage")},
    }
    for number, own in enumerate(model.passes):
        first = len(model.passes) > 1 and number == 0
        wanted[f"{place}passes.{number}.theta"] = own.theta, (len(model.parameters) if first else count,)
        wanted |= {f"{place}passes.{number}.{key}": (getattr(own, key), (joints,)) for key in ("ranges", "rods")}
    if model.seen is not None:
        wanted |= {f"seen.{key}": (rows, (len(model.seen.q), joints)) for key, rows in vars(model.seen).items()}
    for key, (own, right) in wanted.items():
        found = getattr(own, "shape", None) or (len(own or ()),)
        if own is not None and found != right:
            raise _damaged(name, key, Sentence("fitting.part_other_shape", shape=str(found), right=str(right)))
    if n and max(base.independent) >= standard:
        what = Sentence("fitting.part_beyond_columns", column=max(base.independent), count=standard)
        raise _damaged(name, "base.independent", what)


def save_model(path: str | Path, model: ArmModel) -> Path:
    """Write a model; the file appears whole or not at all.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    path = Path(path)
    text = json.dumps(model_to_json(model), allow_nan=False)  # indented ten times as slow, and a number a line
    try:
        with replacing(path) as temporary:
            temporary.write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise InputError("fitting.not_writable_here", path=path, reason=error.strerror) from None
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
        raise InputError("fitting.no_such_file", path=path) from None
    except (UnicodeDecodeError, json.JSONDecodeError) as error:
        raise InputError("fitting.not_json", path=path, error=error) from None
    except OSError as error:
        raise InputError("fitting.cannot_read", path=path, reason=error.strerror) from None
    return model_from_json(content, str(path))
