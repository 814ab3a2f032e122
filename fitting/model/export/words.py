"""What all exported files say of themselves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from daq.errors import InputError
from fitting.model.arm_model import ArmModel

if TYPE_CHECKING:
    from fitting.model.export.tracing.tracing import Tracer


@dataclass(frozen=True)
class Written:
    """Files that an export wrote, and a line for each part of the model that the format does not carry."""

    files: tuple[Path, ...]
    left_out: tuple[str, ...]


def require_folder(path: Path) -> None:
    """Refuse to write a folder where a file is (InputError)."""
    if path.exists() and not path.is_dir():
        raise InputError(f"{path}: is a file; give a folder with -o")


def said_of(model: ArmModel, left_out: Sequence[str]) -> list[str]:
    """Where a file comes from, and what is not in it, in lines."""
    made = model.provenance
    lines = [
        f"Model of {model.machine.name}, identified {made.created} ({made.verdict}), exported by hilfit.",
        f"Joints: {', '.join(model.joints)}. SI units: rad or m, s, N m or N, Pa.",
    ]
    lines += [f"Data: {source.role} {source.sha256}" for source in made.data]
    lines += [f"Calibration: {made.calibration}"] if made.calibration else []
    return [*lines, *(f"Not in this file: {line}." for line in left_out)]


def heading(tracer: Tracer) -> list[str]:
    """Lines at the beginning of an exported program."""
    return [
        *said_of(tracer.model, tracer.left_out),
        "Signs of speeds are smooth: their expectation under the noise of the measured speed.",
        "t: seconds since the motion began.",
    ]
