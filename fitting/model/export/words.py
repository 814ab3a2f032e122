"""Headers that all exported files have."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from daq.errors import InputError
from daq.messages import Sentence
from fitting.arrays import FloatArray
from fitting.model.arm_model import ArmModel
from fitting.model.evaluation import narrow


@dataclass(frozen=True)
class Written:
    """Files that an export wrote, and a line for each part of the model that the format does not carry."""

    files: tuple[Path, ...]
    left_out: tuple[str, ...]


def require_folder(path: Path) -> None:
    """Refuse to write a folder where a file is (InputError)."""
    if path.exists() and not path.is_dir():
        raise InputError("fitting.folder_is_file", path=path)


def model_card(model: ArmModel, left_out: Sequence[str]) -> list[str]:
    """Write the model's card: machine, data, range, error, effects, calibration; and what is not in the file."""
    made = model.provenance
    lines = [
        f"Model of {model.machine.name}, identified {made.created} ({made.verdict}), exported by hilfit.",
        f"Joints: {', '.join(model.joints)}. SI units: rad or m, s, N m or N, Pa.",
    ]
    lines += [f"Data: {source.role} {source.file} {source.sha256}" for source in made.data]
    lines += [
        f"Range of {name}: drive {own.x[0]:.4g} to {own.x[1]:.4g}, speed to {own.v:.3g}, effort to {own.force:.3g}."
        for name, own in zip(model.joints, model.passes[-1].ranges, strict=True)
    ]
    errors = model.errors
    lines += [] if errors is None else [f"Error on another motion: {per_joint(model, errors)}."]
    lines += [f"{line[0].upper()}{line[1:]}." for line in narrow(model)]
    effects = ", ".join(Sentence("fitting.at_joint", effect=term.id, joint=model.place(term)) for term in model.terms)
    lines += [f"Effects: {effects or 'none'}."]
    lines += [f"Calibration: {made.calibration}"] if made.calibration else []
    return [*lines, *(f"Not in this file: {line}." for line in left_out)]


def per_joint(model: ArmModel, values: FloatArray) -> str:
    """Write a number of each joint with its unit."""
    return ", ".join(
        f"{n} {v:.3g} {u}" for n, v, u in zip(model.joints, values.tolist(), model.joint_units, strict=True)
    )


def refitted(model: ArmModel, rest: ArmModel) -> list[str]:
    """Word what a fit without some terms costs."""
    if model.errors is None or rest.errors is None:
        return []
    whole, without = per_joint(model, model.errors), per_joint(model, rest.errors)
    return [f"the rest was fitted again without it; error on another motion: {without}; of the whole model: {whole}"]
