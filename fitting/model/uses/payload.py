"""The mass at the tip, live: the residual of all joints on what one kilogram there makes.

The regressor's column of the last link's mass is what the effect ``payload`` adds. Within a window of some seconds the
joints are weighted by what is left of their residuals, and rows that follow each other are as dependent as their first
autocorrelation states. A payload that was there in the recordings of the fit is part of the last link.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from daq.recordings.recording import Recording
from fitting.arm.dynamics import rigid_body_regressor
from fitting.arrays import BoolArray, FloatArray
from fitting.model.arm_model import ArmModel
from fitting.model.evaluation import Evaluated
from fitting.model.prediction import on_recording
from fitting.regression.design import effort_residual

#: Seconds of motion that an estimate is made of.
WINDOW_S = 10.0
_ROUNDS, _FEWEST, _MOST_DEPENDENT = 3, 8, 0.95


@dataclass(frozen=True)
class Weighed:
    """Mass at the tip beyond that of the fit's recordings, kg, and its standard deviation."""

    mass: float
    std: float


@dataclass(frozen=True)
class PayloadSignal:
    """A mass over time; NaN where nothing moves: (M,) each.

    Attributes
    ----------
    t : s, of the newest row that an estimate is made of
    mass, std : kg
    """

    t: FloatArray
    mass: FloatArray
    std: FloatArray


def tip_columns(found: Evaluated, index: int) -> FloatArray:
    """Compute joint efforts (M, n) of one kilogram at the tip in a segment, filtered as a residual."""
    design, n = found.design, len(found.design.machine.joints)
    segment = design.segments[index]
    whole = rigid_body_regressor(design.machine, segment.q, segment.qd, segment.qdd, columns=[10 * (n - 1)])
    return design.bank.reduce(whole[:, :, 0])


def weighed(residual: FloatArray, tip: FloatArray, moving: BoolArray) -> Weighed | None:
    """Estimate the mass that a residual shows; None where too little moves.

    Parameters
    ----------
    residual, tip : (M, n) joint efforts, N m or N: measured minus predicted, and of one kilogram at the tip
    moving : (M, n) False where a drive rests
    """
    joints = [j for j in range(residual.shape[1]) if moving[:, j].sum() >= _FEWEST and np.any(tip[:, j] != 0)]
    if not joints:
        return None
    parts = [(residual[moving[:, j], j], tip[moving[:, j], j]) for j in joints]
    spread = [float(np.std(e)) for e, _ in parts]
    mass, information, dependent = 0.0, 0.0, 1.0
    for _ in range(_ROUNDS):
        weights = [1.0 / max(s, 1e-9) ** 2 for s in spread]
        information = sum(w * float(y @ y) for w, (_, y) in zip(weights, parts, strict=True))
        mass = sum(w * float(y @ e) for w, (e, y) in zip(weights, parts, strict=True)) / information
        left = [e - mass * y for e, y in parts]
        spread = [float(np.sqrt(np.mean(own**2))) for own in left]
        dependent = sum(_dependence(own) for own in left) / len(left)
    return Weighed(mass, float(np.sqrt(dependent / information)))


def _dependence(left: FloatArray) -> float:
    """Compute the growth of a sum's variance because consecutive rows are alike."""
    power = float(left @ left)
    alike = min(max(float(left[1:] @ left[:-1]) / power if power > 0 else 0.0, 0.0), _MOST_DEPENDENT)
    return (1.0 + alike) / (1.0 - alike)


def payload_signal(model: ArmModel, recording: Recording, every_s: float = 1.0) -> PayloadSignal:
    """Estimate the payload over a recording each ``every_s`` seconds from the last :data:`WINDOW_S`.

    Raises
    ------
    RecordingError
        If it has no stretch that is long enough.
    """
    found, _ = on_recording(model, recording)
    bank, rows = model.bank, list[tuple[float, float, float]]()
    window = max(_FEWEST, round(WINDOW_S * bank.reduced_rate_hz))
    step = max(1, round(every_s * bank.reduced_rate_hz))
    for index, segment in enumerate(found.design.segments):
        joints = range(len(found.design.blocks))
        residual = np.column_stack(
            [effort_residual(found.design, found.model.theta, joint, index, found.extra) for joint in joints]
        )
        tip = tip_columns(found, index)
        moving = np.column_stack([found.design.blocks[joint][index].keep for joint in joints])
        times = segment.t[bank.half :: bank.decimation][: len(residual)]
        for end in range(window, len(residual) + 1, step):
            part = slice(end - window, end)
            own = weighed(residual[part], tip[part], moving[part])
            rows.append((times[end - 1], *((own.mass, own.std) if own else (np.nan, np.nan))))
    table = np.array(rows).reshape(-1, 3)
    return PayloadSignal(table[:, 0], table[:, 1], table[:, 2])
