"""A model on a recording: predicted efforts beside measured ones, with the band that measured ones should lie in.

Two models of one machine are compared on one recording: which predicts it better, and which parameters differ.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from daq.errors import InputError, RecordingError
from daq.recordings.column_map import load_map
from daq.recordings.recording import Recording, read_recording
from daq.recordings.recording_files import write_table
from fitting.arm.joint_side import at_joints
from fitting.arrays import BoolArray, FloatArray
from fitting.model.arm_model import FOREIGN, ArmModel, phase_unknown
from fitting.model.evaluation import Evaluated, beyond, evaluate, narrow, without
from fitting.regression.design import effort_errors
from fitting.regression.error_sizes import measured_efforts, sizes
from fitting.residual.confirmation.confirmation import overall_change
from fitting.signals.preparation import segments_of
from fitting.signals.rods import with_declared_rods

#: Standard deviations on each side of a normal variable's 95 % band.
BAND = 1.959963984540054
#: Standard deviations of the difference from which on a parameter counts as another one.
APART = 3.0


@dataclass(frozen=True)
class Predicted:
    """Efforts of all joints in one recording, the stretches between gaps in a row: arrays (N, n), N m or N.

    Attributes
    ----------
    joints, units : names, and units of the efforts
    t : (N,) s, the recording's
    measured : as sensors gave it, moved by what the model states of delays
    predicted : by the model
    std : standard deviation of the difference: parameters, and what the fit left of its own recordings
    moving : False where a joint's drive rests: what holds it there is static friction, which no model predicts
    beyond : where a joint is beyond the positions and speeds that were recorded, so that the band does not hold
    errors : per joint (M_j,) the residual of its moving rows through the identification filter
    filtered : ``std``, ``rms``, ``mean`` and ``relative`` of these errors, a value per joint, as a report has them
    left_out : a line for each term of the model that this recording cannot have, and for each joint whose band is wrong
    """

    joints: tuple[str, ...]
    units: tuple[str, ...]
    t: FloatArray
    measured: FloatArray
    predicted: FloatArray
    std: FloatArray
    moving: BoolArray
    beyond: BoolArray
    errors: tuple[FloatArray, ...]
    filtered: dict[str, list[float | None]]
    left_out: tuple[str, ...]

    @property
    def residual(self) -> FloatArray:
        """Measured minus predicted."""
        return self.measured - self.predicted

    @property
    def coverage(self) -> FloatArray:
        """Share (n,) of the moving samples whose measured effort lies in the 95 % band; NaN where nothing moves."""
        inside = (np.abs(self.residual) <= BAND * self.std) & self.moving
        count = self.moving.sum(axis=0)
        return np.asarray(np.where(count > 0, inside.sum(axis=0) / np.maximum(count, 1), np.nan))


def load_recording(model: ArmModel, path: Path, *, columns: Path | None = None, resample: bool = False) -> Recording:
    """Load a recording of the model's arm; ``columns`` is a file with a column map.

    Raises
    ------
    RecordingError
        One line that names file or channel.
    """
    named = None if columns is None else load_map(columns, model.machine)
    return read_recording(path, model.machine, "validate", columns=named, resample=resample)


def on_recording(
    model: ArmModel, recording: Recording, start: float | None = None
) -> tuple[Evaluated, tuple[str, ...]]:
    """Evaluate a model on a recording, with a line for each term that the recording cannot have.

    Parameters
    ----------
    start : time at which its clock begins, s; None: at its first sample, as the recording is whole

    Raises
    ------
    RecordingError
        If it has no stretch that is long enough.
    """
    number = next((n for n, own in enumerate(model.provenance.data) if own.sha256 == recording.sha256), FOREIGN)
    lost = [n for n, term in enumerate(model.terms) if phase_unknown(term, number)]
    lines = [
        f"{model.terms[n].id}: its phase is known only in the recordings that the model was identified from"
        for n in lost
    ]
    machine, measured = at_joints(model.machine, [recording])
    measured, more = with_declared_rods(machine, measured)
    latency, resampled = model.delays
    corrections = model.corrections
    segments = segments_of(
        corrections.machine,
        measured,
        model.bank,
        noise=model.noise,
        latency=latency,
        resampled=resampled,
        position_error=corrections.position_error,
        play=corrections.play,
    )
    kept = without(model, lost)
    starts = None if start is None else {number: start}
    return evaluate(kept, [replace(segment, recording=number) for segment in segments], starts), (*lines, *more)


def require_arm(recording: Recording) -> None:
    """Refuse a recording of free drives (RecordingError): nothing acts on the joints there."""
    if recording.role == "unloaded":
        raise RecordingError("fitting.free_drives_carry_no", file=recording.file)


def predict(model: ArmModel, recording: Recording) -> Predicted:
    """Predict efforts in a recording.

    Raises
    ------
    RecordingError
        If it has no stretch that is long enough, or its drives carry no arm.
    """
    require_arm(recording)
    found, lines = on_recording(model, recording)
    design, indices = found.design, range(len(found.design.segments))
    errors = effort_errors(design, found.model.theta, indices, found.extra)
    of = sizes("std", errors, measured_efforts(design, indices))
    return Predicted(
        joints=model.joints,
        units=model.joint_units,
        t=np.concatenate([segment.t for segment in design.segments]),
        measured=np.concatenate([segment.r * segment.effort for segment in design.segments]),
        predicted=np.concatenate([found.joint_effort(i) for i in indices]),
        std=np.concatenate([found.joint_std(i) for i in indices]),
        moving=np.concatenate([~segment.rest for segment in design.segments]),
        beyond=np.concatenate([beyond(model, segment) for segment in design.segments]),
        errors=errors,
        filtered={key.removeprefix("std_"): values for key, values in of.items()},
        left_out=(*lines, *narrow(model)),
    )


def write_predicted(path: Path, found: Predicted) -> None:
    """Write a prediction as a table, ``.csv`` or ``.parquet``, whole or not at all.

    Columns: ``time`` (s), and of each joint ``measured``, ``predicted``, ``residual``, ``std``, ``low`` and ``high``
    (both ends of the 95 % band, N m or N), ``moving`` and ``beyond`` (0 or 1).

    Raises
    ------
    RecordingError
        If the suffix is another one or the place cannot be written.
    """
    parts = {key: getattr(found, key) for key in ("measured", "predicted", "residual", "std")}
    parts |= {"low": found.predicted - BAND * found.std, "high": found.predicted + BAND * found.std}
    parts |= {key: getattr(found, key).astype(float) for key in ("moving", "beyond")}
    write_joints(path, found.t, found.joints, parts)


def write_joints(path: Path, t: FloatArray, joints: Sequence[str], parts: Mapping[str, FloatArray]) -> None:
    """Write a table of ``time`` (s) and of each joint the columns (N, n) of some values that are there."""
    columns = {
        f"{name}.{key}": values[:, k]
        for k, name in enumerate(joints)
        for key, values in parts.items()
        if not np.isnan(values[:, k]).any()
    }
    write_table(path, pa.table({"time": t} | columns))


@dataclass(frozen=True)
class Shift:
    """One parameter that both models have: values, and their difference in its standard deviations."""

    name: str
    unit: str
    first: float
    second: float
    sigmas: float


@dataclass(frozen=True)
class Compared:
    """Two models on one recording.

    Attributes
    ----------
    first, second : what each predicts
    overall : change of the error of all joints from the first to the second, each joint in units of its error by the
        first: ``change_percent`` and ``ci95_percent`` (blocks of three seconds drawn again)
    shifts : parameters that both have and that differ by :data:`APART` or more, largest first
    """

    first: Predicted
    second: Predicted
    overall: dict[str, Any]
    shifts: tuple[Shift, ...]


def compare(first: ArmModel, second: ArmModel, recording: Recording) -> Compared:
    """Predict a recording by two models.

    Raises
    ------
    InputError
        If they are not of one machine.
    """
    if first.joints != second.joints or first.machine.name != second.machine.name:
        raise InputError(
            "fitting.models_of_two_machines",
            machine=first.machine.name,
            joints=", ".join(first.joints),
            other=second.machine.name,
            other_joints=", ".join(second.joints),
        )
    # Both errors through one filter, or they would not be of the same signals.
    one = predict(first, recording)
    other = predict(replace(second, bandwidth_hz=first.bandwidth_hz), recording)
    floor = np.array([float(np.std(e)) if len(e) else 0.0 for e in one.errors])
    rng = np.random.default_rng(0)
    overall = overall_change(one.errors, other.errors, floor, first.bank.reduced_rate_hz, rng)
    return Compared(one, other, overall, _shifts(first, second))


def _shifts(first: ArmModel, second: ArmModel) -> tuple[Shift, ...]:
    places = {name: number for number, name in enumerate(second.parameter_names)}
    found = []
    for number, (name, unit) in enumerate(zip(first.parameter_names, first.parameter_units, strict=True)):
        if name in places and first.told[number] and second.told[places[name]]:
            values = float(first.theta[number]), float(second.theta[places[name]])
            spread = float(np.hypot(first.std[number], second.std[places[name]]))
            if spread > 0 and abs(values[1] - values[0]) >= APART * spread:
                found.append(Shift(name, unit, *values, (values[1] - values[0]) / spread))
    return tuple(sorted(found, key=lambda shift: -abs(shift.sigmas)))
