"""The handed-over model of an identification, evaluated on the newest seconds of a machine.

The filters are the fit's own. They are symmetric: at the middle of their window they delay nothing, and that is how a
fit uses them. A live signal has no future, so here the same kernels look at the past only, and the residual that comes
out is that of ``delay_s`` ago: the same numbers, later. Two things are taken from the window instead of the whole
recording: how two position sensors are weighted against each other, and where a rest that reaches beyond the window
began.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from daq import Recording
from daq.arrays import BoolArray, FloatArray
from daq.errors import HilfitError, InputError, RecordingError
from fitting.arm.joint_side import at_joints
from fitting.model.arm_model import FOREIGN, ArmModel, phase_unknown
from fitting.model.codec import load_model
from fitting.model.evaluation import Evaluated, evaluate, without
from fitting.model.uses.payload import tip_columns
from fitting.regression.design import full_residual, predicted_effort
from fitting.residual.laws import Law
from fitting.signals.preparation import segments_of

#: Signal of which a block does not hold enough.
_MEMORY = "time_since_reversal"


class NotLiveError(HilfitError):
    """The model holds something that cannot be evaluated on live signals."""


@dataclass(frozen=True)
class JointBlock:
    """One joint during one block; ``M`` reduced rows.

    Attributes
    ----------
    residual : (M,) measured minus predicted joint effort, N m or N, through the identification filter
    predicted : (M,) predicted joint effort, filtered alike
    direction : (M,) sign of the drive's speed, filtered alike
    tip : (M,) joint effort that one kilogram at the tip adds, filtered alike
    moving : (M,) False where the drive rests: what holds it there is static friction, which no model predicts
    """

    residual: FloatArray
    predicted: FloatArray
    direction: FloatArray
    tip: FloatArray
    moving: BoolArray


class LiveModel:
    """A model on live signals; immutable.

    Parameters
    ----------
    model : as an identification handed it over

    Raises
    ------
    NotLiveError
        If it holds something that live signals do not have.
    """

    def __init__(self, model: ArmModel) -> None:
        confined = [term.id for term in model.terms if term.confined]
        if confined:
            raise NotLiveError("server.acts_single_recordings_fit", confined=", ".join(confined))
        if any(isinstance(t.content, Law) and _MEMORY in (s for s, _ in t.content.signals) for t in model.terms):
            raise NotLiveError("server.law_time_since_last")
        self.machine = model.machine
        self.model = without(model, [n for n, term in enumerate(model.terms) if phase_unknown(term, FOREIGN)])
        self.bank = model.bank

    @classmethod
    def load(cls, path: Path) -> LiveModel:
        """Load the model that an identification wrote (``model.json``, or the folder that holds it).

        Raises
        ------
        NotLiveError
            If it is gone, is not whole, or cannot be evaluated live.
        """
        try:
            return cls(load_model(path))
        except InputError as error:
            raise NotLiveError("server.model_identification_cannot_read", error=error) from None

    @property
    def overlap(self) -> int:
        """Samples before a block that its filters need as well."""
        return 2 * (self.bank.margin + self.bank.half)

    @property
    def delay_s(self) -> float:
        """s by which the residual is late."""
        return (self.bank.margin + self.bank.half) / self.bank.rate_hz

    def block_samples(self, seconds: float) -> int:
        """Count a block's samples in about so many seconds: whole reduced rows, and enough for the filters."""
        rows = max(5, round(seconds * self.bank.rate_hz / self.bank.decimation))
        return rows * self.bank.decimation

    def evaluate(self, time: FloatArray, values: dict[str, FloatArray]) -> tuple[JointBlock, ...] | None:
        """Compute all joints' residuals over one window of ``overlap`` + ``block_samples``; see :meth:`evaluated`.

        Returns
        -------
        None where a sample of the window is missing.
        """
        found = self.evaluated(time, values)
        if found is None:
            return None
        tip = tip_columns(found, 0)
        return tuple(_joint(found, joint, tip[:, joint]) for joint in range(tip.shape[1]))

    def evaluated(self, time: FloatArray, values: dict[str, FloatArray]) -> Evaluated | None:
        """Evaluate the model on one window of samples.

        Parameters
        ----------
        time : (N,) s of machine time
        values : per channel (N,) SI, NaN where nothing was measured

        Returns
        -------
        None where a sample of the window is missing.

        Raises
        ------
        NotLiveError
            If an effect's columns need what live signals do not have.
        """
        recording = Recording(
            self.machine.name, "operation", "live", "", self.machine.rate_hz, np.asarray(time), values
        )
        _, (recording,) = at_joints(self.machine, [recording])
        corrections = self.model.corrections
        latency, resampled = self.model.delays
        try:
            segments = tuple(
                segments_of(
                    corrections.machine,
                    [recording],
                    self.bank,
                    noise=self.model.noise,
                    latency=latency,
                    resampled=resampled,
                    position_error=corrections.position_error,
                    play=corrections.play,
                )
            )
        except RecordingError:
            return None
        if len(segments) != 1 or len(segments[0]) + 2 * self.bank.margin != len(time):
            return None
        # What only a recording has, its clock, is not a number, so that nothing is guessed.
        found = evaluate(self.model, [replace(segments[0], recording=FOREIGN)], {FOREIGN: float("nan")})
        for number, name in enumerate(found.extra.names):
            if any(own is not None and not np.isfinite(own[:, number]).all() for (own,) in found.extra.columns):
                raise NotLiveError("server.needs_live_signals_not", name=name)
        return found


def _joint(found: Evaluated, joint: int, tip: FloatArray) -> JointBlock:
    design, theta, extra = found.design, found.model.theta, found.extra
    segment, block = design.segments[0], design.blocks[joint][0]
    r = segment.r[:, joint]
    columns = np.column_stack(
        [
            r * full_residual(design, theta, joint, 0, extra),
            r * predicted_effort(design, theta, joint, 0, extra),
            np.sign(segment.v[:, joint]) * ~segment.rest[:, joint],
        ]
    )
    reduced = design.bank.reduce(columns)
    return JointBlock(reduced[:, 0], reduced[:, 1], reduced[:, 2], tip, block.keep)
