"""Two models of one machine on one recording: which predicts it better, and what differs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from daq.errors import InputError
from daq.recordings.recording import Recording
from fitting.model.arm_model import ArmModel
from fitting.model.prediction import Predicted, predict
from fitting.residual.confirmation.confirmation import overall_change

#: Standard deviations of the difference from which on a parameter counts as another one.
APART = 3.0


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
            f"compare: the first model is of '{first.machine.name}' ({', '.join(first.joints)}), the second of "
            f"'{second.machine.name}' ({', '.join(second.joints)}); give two models of one machine"
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
