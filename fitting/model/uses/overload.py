"""Collisions and overloads: measured against predicted effort, sample by sample, soon.

The filters of an identification look seconds to both sides. Here motion comes from parabolas through the last
:data:`SPAN_S` seconds, which is late by half of that; the effort is as it was measured. The score of a joint is the
residual over its band: parameters and what the fit left of its recordings; and where a drive hardly moves, as much
more as its Coulomb friction leaves open there. Where it rests, friction is whatever holds it, up to the Coulomb
friction either way, and only what is beyond counts: a joint that is held trembles by more than its encoder's noise, so
a sign of speed means nothing there. What counts is what lasts: the smallest score of :data:`LASTS_S`, and none of a
stretch's first :data:`QUIET_S`.

What an unchanged machine's scores do was learnt (:mod:`fitting.model.tails`), so a threshold has a rate of false
alarms. That of the machine is shared by its joints; peaks of several joints at once are one alarm, so the machine's
rate is at most what is stated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from daq.errors import RecordingError
from daq.recordings.recording import Recording
from fitting.arm.expected import expected_sign
from fitting.arrays import FloatArray
from fitting.model.arm_model import ArmModel
from fitting.model.evaluation import Evaluated
from fitting.model.prediction import on_recording, require_arm
from fitting.model.tails import Tail, excursions, tail_of
from fitting.signals.filters import FilterBank
from fitting.signals.preparation import PositionNoise

#: Seconds that a parabola is laid through.
SPAN_S = 0.12
#: Seconds that an exceedance has to last: a valve's knock or a stone is over by then.
LASTS_S = 0.04
#: Seconds without an exceedance after which another one is another alarm.
QUIET_S = 0.5
#: Seconds of a recording that are evaluated at once when scores are learned.
PIECE_S = 60.0
_FEWEST_SIDE = 2


@dataclass(frozen=True)
class Scores:
    """One gap-free stretch of a recording; ``n`` joints.

    Attributes
    ----------
    t : (N,) s, of the samples that are judged
    scores : (N, n) residual over its band
    lasting : (N, n) the smallest size of a score over the last :data:`LASTS_S`; 0 where the stretch is younger
    unit : (N, n) joint effort of a score of one in that pose, N m or N: what a threshold is multiplied by
    residual : (N, n) measured minus predicted joint effort, N m or N; of a drive at rest what friction cannot hold
    """

    t: FloatArray
    scores: FloatArray
    lasting: FloatArray
    unit: FloatArray
    residual: FloatArray


@dataclass(frozen=True)
class Overload:
    """An alarm.

    Attributes
    ----------
    found : s, time of the recording at which it can be known
    joint : number of the joint with the largest score over its threshold
    score, threshold : that score, and what it exceeds
    limit : the effort that the threshold is in that pose, N m or N
    residual : measured minus predicted effort of the joint then, N m or N
    seconds : from the first to the last exceedance
    """

    found: float
    joint: int
    score: float
    threshold: float
    limit: float
    residual: float
    seconds: float


def quick(model: ArmModel) -> ArmModel:
    """Return the model with filters that look :data:`SPAN_S` back."""
    rate = model.machine.rate_hz
    side = max(_FEWEST_SIDE, round(0.5 * SPAN_S * rate))
    value, first, second = (
        scipy.signal.savgol_coeffs(2 * side + 1, 2, deriv=order, delta=1.0 / rate, use="conv") for order in range(3)
    )
    bank = FilterBank(rate, rate / 5, 1, value, first, second, np.ones(1))
    noise = tuple(
        PositionNoise(own.position, bank.speed_noise(own.position), bank.acceleration_noise(own.position))
        for own in model.noise
    )
    return replace(model, noise=noise, filters=bank)


def delay_s(model: ArmModel) -> float:
    """Return the seconds by which a :func:`quick` model is late."""
    return model.bank.margin / model.bank.rate_hz


def scores_of(model: ArmModel, recording: Recording) -> list[Scores]:
    """Compute scores of a recording by a :func:`quick` model, one entry for each stretch between gaps.

    Raises
    ------
    RecordingError
        If it has no stretch that is long enough.
    """
    found, _ = on_recording(model, recording)
    return [scores_in(found, index) for index in range(len(found.design.segments))]


def scores_in(found: Evaluated, index: int) -> Scores:
    """Compute scores of one stretch evaluated by a :func:`quick` model."""
    segment, model = found.design.segments[index], found.model
    error = segment.effort - found.drive_effort(index)
    band = np.hypot(found.parameter_std(index), model.residual_std)
    for joint in range(error.shape[1]):
        known = expected_sign(segment.v[:, joint], model.noise[joint].sign)
        most = abs(model.drive_values(joint).get("f_c", 0.0))  # Coulomb friction, N or N m
        rest = segment.rest[:, joint]
        held = error[:, joint] + most * known  # with the friction that the sign of speed represents
        error[:, joint] = np.where(rest, np.sign(held) * np.maximum(np.abs(held) - most, 0.0), error[:, joint])
        open_friction = most * np.sqrt(np.maximum(1.0 - known**2, 0.0))
        band[:, joint] = np.where(rest, band[:, joint], np.hypot(band[:, joint], open_friction))
    scores, rate = error / band, model.bank.rate_hz
    lasting = _lasting(scores, round(LASTS_S * rate), round(QUIET_S * rate))
    return Scores(segment.t, scores, lasting, np.abs(segment.r) * band, segment.r * error)


def _lasting(scores: FloatArray, before: int, first: int) -> FloatArray:
    sizes = np.zeros_like(scores)
    if len(scores) > before:
        sizes[before:] = np.lib.stride_tricks.sliding_window_view(np.abs(scores), before + 1, axis=0).min(axis=-1)
    sizes[:first] = 0.0
    return sizes


def _scores_in_pieces(model: ArmModel, recording: Recording) -> list[Scores]:
    """Compute :func:`scores_of`, a minute at a time: else a long recording would not fit in memory."""
    rows, start, found = round(PIECE_S * model.machine.rate_hz), None, list[Scores]()
    count = max(1, len(recording) // rows)
    for number in range(count):
        end = len(recording) if number == count - 1 else (number + 1) * rows
        try:
            piece, _ = on_recording(model, recording.cut(slice(number * rows, end)), start)
        except RecordingError:
            if number == count - 1 and not found:
                raise
            continue  # nothing but a gap
        start = next(iter(piece.starts.values())) if start is None else start
        found += [scores_in(piece, index) for index in range(len(piece.design.segments))]
    return found


def learn(model: ArmModel, recordings: Sequence[Recording]) -> tuple[Tail, ...]:
    """Learn an unchanged machine's scores, per joint.

    Raises
    ------
    InputError
        If the recordings are too short.
    """
    own = quick(model)
    parts = [part.lasting for recording in recordings for part in _scores_in_pieces(own, recording)]
    quiet = round(QUIET_S * model.machine.rate_hz)
    return tuple(
        tail_of([part[:, joint] for part in parts], model.machine.rate_hz, quiet) for joint in range(len(model.joints))
    )


def thresholds(tails: Sequence[Tail], per_hour: float) -> FloatArray:
    """Compute scores (n,) that raise an alarm, for so many false alarms an hour."""
    return np.array([tail.threshold(per_hour / 3600.0 / len(tails)) for tail in tails])


def overloads(model: ArmModel, recording: Recording, limits: FloatArray) -> list[Overload]:
    """Find alarms in a recording.

    Parameters
    ----------
    limits : (n,) of :func:`thresholds`

    Raises
    ------
    RecordingError
        If it has no stretch that is long enough, or its drives carry no arm.
    """
    require_arm(recording)
    return alarms_in(model, scores_of(quick(model), recording), limits)


def alarms_in(model: ArmModel, scores: Sequence[Scores], limits: FloatArray) -> list[Overload]:
    """Find alarms in a recording's stretches, by the :func:`quick` model's scores and thresholds (n,)."""
    late, quiet, found = delay_s(quick(model)), round(QUIET_S * model.machine.rate_hz), list[Overload]()
    for part in scores:
        share = part.lasting / limits
        for run in excursions(share.max(axis=1) > 1.0, quiet):
            first = run.start
            joint = int(np.argmax(share[first]))
            score, limit, residual = (float(own[first, joint]) for own in (part.scores, part.unit, part.residual))
            seconds, most = float(part.t[run.stop - 1] - part.t[first]), float(limits[joint])
            found.append(Overload(float(part.t[first]) + late, joint, score, most, most * limit, residual, seconds))
    return found
