"""Staubli TX40: 61 parameters with a coupled wrist, and the friction curve that the loop finds.

Data and published parameters: the TX40 example of FIGAROH (Nguyen and others, Apache-2.0). One recording of 9 s at 5
kHz, motors only, no repeat: the noise floor is an estimate.

What is judged on other data than it was fitted on are five blocks, contiguous in time: fitted on four, judged on the
fifth. The error is ``|measured - predicted| / |measured|`` over all joints, printed twice: over *every row*,
standstill and reversals included, low-passed and decimated to 50 Hz as the publication does; and over the *moving
rows*, which are what is fitted.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import signal

from benchmarks.measured.stacks import Found, Stack, loop, refitted, relative, stack_of
from benchmarks.targets import Check, fact, figure
from daq.machine.machine_file import load_machine
from daq.recordings.recording import read_recording, write_recording
from fitting.arrays import FloatArray
from fitting.effects import effect
from fitting.loop.session import Session
from fitting.residual.terms import Model, Term

MACHINE = Path(__file__).parent / "machines" / "staubli_tx40.yaml"
_RECORDED_HZ, _EVALUATED_HZ = 5000.0, 50.0
_FOLDS = 5
#: Effects that do not help on this arm, by an independent trial.
REFUSED = ("asymmetric_friction", "load_dependent_friction")


@dataclass(frozen=True)
class Errors:
    """Relative errors in percent: fitted, and over five blocks; every row, and moving rows."""

    every_row: float
    every_row_blocks: float
    moving: float
    moving_blocks: float


@dataclass(frozen=True)
class Staubli:
    """Results on the TX40.

    Attributes
    ----------
    parameters : number of parameters that the recording determines
    base, after : errors of the base model, and with what the loop added
    trials : errors with effects that were refused, added on every joint all the same
    found : what the loop found
    bandwidth_hz : of the identification filter
    joints : per joint relative error of every row before and after, percent
    friction : (name, published, here) of the drives' parameters
    residuals : speed, residual before and after, (K,) of joint 1 on moving rows
    """

    parameters: int
    base: Errors
    after: Errors
    trials: dict[str, Errors]
    found: Found
    bandwidth_hz: float
    joints: tuple[tuple[float, float], ...]
    friction: tuple[tuple[str, float, float], ...]
    residuals: tuple[FloatArray, FloatArray, FloatArray]

    def checks(self) -> tuple[Check, ...]:
        """Check against the publication and an independent trial."""
        names = self.found.names
        root, refused = "velocity_root_friction" in names, not set(REFUSED) & set(names)
        moving = self.after.moving_blocks / self.base.moving_blocks
        return (
            figure("TX40: parameters told", self.parameters, least=61.0, shown=str(self.parameters)),
            figure("TX40: relative error of the base model, every row", self.base.every_row, "{:.2f} %", most=8.4),
            figure("TX40: five blocks before the loop", self.base.every_row_blocks, "{:.2f} %"),
            figure("TX40: five blocks after the loop", self.after.every_row_blocks, "{:.2f} %", most=8.1),
            figure("TX40: five blocks of moving rows, after over before", moving, "{:.2f}", most=0.8),
            fact("TX40: friction with a root of the speed found unaided", root, ", ".join(names)),
            fact("TX40: asymmetric and load-dependent friction refused", refused, ", ".join(names)),
        )


def recording(data: Path, directory: Path) -> Path:
    """Resample the recording to the machine file's rate: low-passed without delay, from 5 kHz."""
    machine = load_machine(MACHINE)
    step = round(_RECORDED_HZ / machine.rate_hz)
    kernel = signal.firwin(20 * step + 1, 0.4 * machine.rate_hz, fs=_RECORDED_HZ, window=("kaiser", 8.0))

    def low(values: FloatArray) -> FloatArray:
        return np.asarray(signal.convolve(np.pad(values, 10 * step, mode="edge"), kernel, mode="valid")[::step])

    files = ("pos_read_data.csv", "curr_data.csv")
    positions, torques = (np.loadtxt(data / name, delimiter=",", skiprows=1) for name in files)
    values = {}
    for joint in range(6):
        values[f"motor{joint + 1}.position"] = low(positions[:, joint])
        values[f"motor{joint + 1}.torque"] = low(torques[:, joint])
    rows = len(values["motor1.position"])
    return write_recording(directory / "tx40.parquet", machine, "train", np.arange(rows) / machine.rate_hz, values)


def session_of(path: Path) -> Session:
    """Make a session on the recording, with default options."""
    machine = load_machine(MACHINE)
    return Session(machine, [read_recording(path, machine, "train")])


def base_errors(model: Model) -> tuple[int, Errors]:
    """Count the parameters that the recording determines; return the base model's errors."""
    return int(np.count_nonzero(model.fit.determined)), _errors(model)


def trials(session: Session) -> dict[str, Errors]:
    """Return the errors with each of :data:`REFUSED` added on every joint."""
    joints = range(len(session.machine.joints))
    return {name: _errors(refitted(session, [Term(effect(name), joint) for joint in joints])) for name in REFUSED}


def evaluate(data: Path, directory: Path) -> Staubli:
    """Evaluate the base model, the loop, and errors before and after."""
    path = recording(data, directory)
    found = loop(MACHINE, [("train", path)], directory / "tx40")
    session = session_of(path)
    before, after = refitted(session, ()), refitted(session, found.terms, found)
    count, base = base_errors(before)
    first, second = stack_of(before, 0), stack_of(after, 0)
    theta, theta_more = first.fit(), second.fit()
    own = zip(_by_joint(before, first, theta), _by_joint(after, second, theta_more), strict=True)
    keep = first.keep[0]
    return Staubli(
        parameters=count,
        base=base,
        after=_errors(after),
        trials=trials(session),
        found=found,
        bandwidth_hz=session.bank.bandwidth_hz,
        joints=tuple(own),
        friction=friction(data, before),
        residuals=(
            session.bank.reduce(before.design.segments[0].v[:, 0])[keep],
            (first.reduced_target[0] - first.reduced[0] @ theta)[keep],
            (second.reduced_target[0] - second.reduced[0] @ theta_more)[keep],
        ),
    )


def _low(model: Model, values: FloatArray) -> FloatArray:
    """Low-pass at 20 Hz and decimate to 50 Hz: what two decimations by ten leave of 5 kHz."""
    rate = model.design.bank.rate_hz
    kernel = signal.firwin(2 * round(0.4 * rate) + 1, 0.4 * _EVALUATED_HZ, fs=rate)
    return np.asarray(signal.oaconvolve(values, kernel, mode="valid")[:: round(rate / _EVALUATED_HZ)])


def _errors(model: Model) -> Errors:
    stack = stack_of(model, 0)
    theta = stack.fit()
    columns, targets = stack.every_row(lambda values: _low(model, values))
    every = [y - A @ theta for A, y in zip(columns, targets, strict=True)]
    moving, effort = stack.moving_error(theta)
    rows, low_rows = len(stack.keep[0]), len(targets[0])
    block, low_block = np.arange(rows) * _FOLDS // rows, np.arange(low_rows) * _FOLDS // low_rows
    left_out: list[FloatArray] = []
    left_out_moving: list[FloatArray] = []
    for fold in range(_FOLDS):
        without = stack.fit(block != fold)
        here = low_block == fold
        left_out += [(y - A @ without)[here] for A, y in zip(columns, targets, strict=True)]
        left_out_moving.append(stack.moving_error(without, block == fold)[0])
    whole = np.concatenate(targets)
    return Errors(
        every_row=relative(np.concatenate(every), whole),
        every_row_blocks=relative(np.concatenate(left_out), whole),
        moving=relative(moving, effort),
        moving_blocks=relative(np.concatenate(left_out_moving), effort),
    )


def _by_joint(model: Model, stack: Stack, theta: FloatArray) -> list[float]:
    columns, targets = stack.every_row(lambda values: _low(model, values))
    return [relative(y - A @ theta, y) for A, y in zip(columns, targets, strict=True)]


def friction(data: Path, model: Model) -> tuple[tuple[str, float, float], ...]:
    """Compare published drive parameters with those found, in the published meaning.

    The publication gives motor 6 on joint 5 the speed of joint 6 alone and the reverse, instead of the motor's own
    speed on both; its ``fv5``, ``fv6`` and ``Ia5`` are therefore ours plus those of the motor.
    """
    names, base_names = model.design.parameters.names, model.design.parameters.base.names
    theta = stack_of(model, 0).fit()
    with (data / "published_base_parameters.csv").open(encoding="utf-8") as file:
        published = {row[0]: float(row[1]) for row in csv.reader(file) if row}
    own = dict(zip(names, theta.tolist(), strict=False))
    first = len(names) - len(base_names)
    motor = {name: float(theta[first + place]) for place, name in enumerate(base_names) if name.endswith("m6")}
    rows: list[tuple[str, float, float]] = []
    for joint in range(1, 7):
        share = 1.0 if joint in (5, 6) else 0.0
        rows.append((f"fv{joint}", published[f"fv{joint}"], own[f"joint{joint}.f_v"] + share * motor["f_vm6"]))
        rows.append((f"fs{joint}", published[f"fs{joint}"], own[f"joint{joint}.f_c"]))
        if f"Ia{joint}" in published:
            rows.append((f"Ia{joint}", published[f"Ia{joint}"], own[f"joint{joint}.J"] + share * motor["Jm6"]))
    for old, new in (("fv", "f_v"), ("fs", "f_c"), ("Ia", "J")):
        rows.append((f"{old}m6", published[f"{old}m6"], motor[f"{new}m6"]))
    return tuple(rows)
