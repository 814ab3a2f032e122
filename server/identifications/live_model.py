"""The fitted model of an identification, evaluated on the newest seconds of a machine.

The filters are the fit's own. They are symmetric: at the middle of their window they delay nothing, and that is how a
fit uses them. A live signal has no future, so here the same kernels look at the past only, and the residual that comes
out is that of ``delay_s`` ago: the same numbers, later. Two things are taken from the window instead of the whole
recording: how two position sensors are weighted against each other, and where a rest that reaches beyond the window
began.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from daq import Recording, load_machine
from daq.errors import HilfitError, RecordingError
from daq.machine_file import Machine
from fitting.arm.joint_side import at_joints
from fitting.effects.base import DriveView, Ranges
from fitting.loop.kinematic_check import corrections_from_json
from fitting.loop.residual_loop import delays, final_model, term_from_json
from fitting.loop.session import Session
from fitting.pipeline.stage_program import load_request
from fitting.regression.design import Design, Extra, build_design, full_residual, predicted_effort
from fitting.residual.kinematics import Corrections
from fitting.residual.laws import Law
from fitting.residual.terms import Model, Term, extra_columns
from fitting.signals.preparation import prepare

FloatArray = npt.NDArray[np.float64]
_STAGES = ("residual", "attribution")
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
    moving : (M,) False where the drive rests: what holds it there is static friction, which no model predicts
    """

    residual: FloatArray
    predicted: FloatArray
    direction: FloatArray
    moving: npt.NDArray[np.bool_]


class LiveModel:
    """A fitted model; immutable.

    Parameters
    ----------
    machine : as the machine file has it
    session : the identification's data, of which only the filters, the noise and the reduction are kept
    corrections, terms : what the loop found
    model : the final fit
    """

    def __init__(
        self, machine: Machine, session: Session, corrections: Corrections, terms: Sequence[Term], model: Model
    ) -> None:
        self.machine = machine
        self.bank = session.bank
        self._base = session.base
        self._noise = session.position_noise
        self._corrections = corrections
        self._latency, self._resampled = delays(session, terms)
        self._terms = tuple(terms)
        self._theta = model.fit.theta
        self._ranges: tuple[Ranges, ...] = model.views[model.fitted[0]][0].ranges
        confined = [term.id for term in terms if term.confined]
        if confined:
            raise NotLiveError(
                f"{', '.join(confined)} acts in single recordings of the fit; the calibration says nothing of now"
            )

        if any(isinstance(t.content, Law) and _MEMORY in (s for s, _ in t.content.signals) for t in terms):
            raise NotLiveError(
                "a law of the time since the last reversal needs more of the past than is looked at at a time"
            )

    @classmethod
    def load(cls, request: Path) -> LiveModel:
        """The model of a finished identification, from its request file and the results of its stages.

        Raises
        ------
        InputError, HilfitError
            If a file of it is gone.
        """
        wanted = load_request(request)
        try:
            results = {
                name: json.loads((wanted.output / "stages" / f"{name}.json").read_text(encoding="utf-8"))
                for name in _STAGES
            }
        except (OSError, ValueError) as error:
            raise NotLiveError(f"the results of the identification cannot be read ({error}); identify again") from None
        machine, session = load_machine(wanted.machine), Session.load(wanted)
        terms = [term_from_json(entry["term"]) for entry in results["attribution"]["accepted"]]
        steps = [step for finding in results["residual"]["kinematics"] for step in finding["steps"]]
        corrections = corrections_from_json(session, steps)
        model = final_model(session, corrections, terms)[1].model
        return cls(machine, session, corrections, terms, model)

    @property
    def overlap(self) -> int:
        """Samples before a block that its filters need as well."""
        return 2 * (self.bank.margin + self.bank.half)

    @property
    def delay_s(self) -> float:
        """s by which the residual is late."""
        return (self.bank.margin + self.bank.half) / self.bank.rate_hz

    def block_samples(self, seconds: float) -> int:
        """Samples of a block of about so many seconds: whole reduced rows, and at least what the filters ask for."""
        rows = max(5, round(seconds * self.bank.rate_hz / self.bank.decimation))
        return rows * self.bank.decimation

    def evaluate(self, time: FloatArray, values: dict[str, FloatArray]) -> tuple[JointBlock, ...] | None:
        """Residuals of every joint over one window of ``overlap`` + ``block_samples`` samples.

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
            If an effect's columns need what live signals do not tell.
        """
        recording = Recording(
            self.machine.name, "operation", "live", "", self.machine.rate_hz, np.asarray(time), values
        )
        _, (recording,) = at_joints(self.machine, [recording])
        try:
            segments = prepare(
                self._corrections.machine,
                [recording],
                self.bank,
                noise=self._noise,
                latency=self._latency,
                resampled=self._resampled,
                position_error=self._corrections.position_error,
                play=self._corrections.play,
            )
        except RecordingError:
            return None
        if len(segments) != 1 or len(segments[0]) + 2 * self.bank.margin != len(time):
            return None
        design = build_design(self._corrections.machine, self._base, self.bank, self._noise, segments)
        extra = self._extra(design)
        return tuple(self._joint(design, joint, extra) for joint in range(len(design.machine.joints)))

    def _joint(self, design: Design, joint: int, extra: Extra) -> JointBlock:
        segment, block = design.segments[0], design.blocks[joint][0]
        r = segment.r[:, joint]
        columns = np.column_stack(
            [
                r * full_residual(design, self._theta, joint, 0, extra),
                r * predicted_effort(design, self._theta, joint, 0, extra),
                np.sign(segment.v[:, joint]) * ~segment.rest[:, joint],
            ]
        )
        reduced = self.bank.reduce(columns)
        return JointBlock(reduced[:, 0], reduced[:, 1], reduced[:, 2], block.keep)

    def _extra(self, design: Design) -> Extra:
        """Columns of the effects; two passes, since some hold the force that the model with them predicts."""
        extra = extra_columns(design, (), ())
        for _ in range(2 if self._terms else 0):
            extra = extra_columns(design, (self._views(design, extra),), self._terms)
        for number, name in enumerate(extra.names):
            if any(own is not None and not np.isfinite(own[:, number]).all() for (own,) in extra.columns):
                raise NotLiveError(
                    f"{name} needs what live signals do not tell (the recording's clock, or expected pressures); "
                    "this calibration cannot be watched"
                )
        return extra

    def _views(self, design: Design, extra: Extra) -> tuple[DriveView, ...]:
        """What effects may look at now; what only a recording has is NaN, so that nothing is guessed."""
        joints = range(len(design.machine.joints))
        segment, part = design.segments[0], design.parameters.base_slice
        count = len(design.parameters)
        theta = self._theta if extra.names else self._theta[:count]
        unknown = np.full(len(segment), np.nan)
        view = DriveView(
            machine=design.machine,
            joint=0,
            segment=segment,
            bank=design.bank,
            noise=design.noise,
            forces=np.stack([predicted_effort(design, theta, j, 0, extra) for j in joints], axis=1),
            loads=np.stack([design.blocks[j][0].columns[:, part] @ self._theta[part] for j in joints], axis=1),
            rod_pressures=partial(np.full, (len(segment), len(joints)), np.nan),
            ranges=self._ranges,
            clock=unknown,
            base=design.parameters.base,
            base_values=self._theta[part],
            loaded_recordings=(),
        )
        return tuple(replace(view, joint=joint, cache={}) for joint in joints)
