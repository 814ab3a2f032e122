from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from daq.machine.machine_file import Machine
from fitting.arm.dynamics import rigid_body_regressor
from fitting.arrays import FloatArray
from fitting.effects.base import BodyColumn, DriveView, Effect, Parameter, Parity, Shape


class Payload(Effect):
    """A mass at the tip that is picked up, or put down, in the course of a recording."""

    id = "payload"
    title = "a payload in part of the recordings"
    level = "joint"
    variable = "time"
    equation = "Y_tip(q, q', q'') m_p from t_0 on, in one recording or in all"
    parity = Parity.OTHER
    dependence = "all joints upstream at once"
    parameters = (Parameter("m_p", "kg"),)
    discrete_shapes = frozenset({"recording"})
    shape_units = {"t_0": "s"}
    confounders = ("thermal_viscosity_drift", "pressure_drift")
    experiment = "an empty and a loaded run"
    by_motion = False
    look_at = "what the arm carries at its tip: take it off, or tell the model its mass"
    source = "point mass at the origin of the last link frame"
    machine_wide = True

    def shapes(self, view: DriveView) -> Sequence[Shape]:
        """Return one recording, or all (-1), from its start or from one of some moments on."""
        start, end = view.range.time
        return [
            {"recording": float(recording), "t_0": start + share * (end - start)}
            for recording in (-1, *view.loaded_recordings)
            for share in (0.0, 0.15, 0.25, 0.35, 0.45, 0.55, 0.65, 0.75, 0.85)
            if recording >= 0 or share > 0.0  # always there, it is part of the last link
        ]

    def confined(self, shape: Shape) -> bool:
        """Return whether it acts in one recording, without bearing on others."""
        return shape["recording"] >= 0

    def columns(self, view: DriveView, shape: Shape) -> FloatArray:
        """Compute columns (N, n, 1) for all joints."""
        segment = view.segment
        joints = len(view.machine.joints)
        if not segment.loaded or int(shape["recording"]) not in (-1, segment.recording):
            return np.zeros((len(segment), joints, 1))
        if "tip" not in view.cache:
            regressor = rigid_body_regressor(
                view.machine, segment.q, segment.qd, segment.qdd, columns=[10 * (joints - 1)]
            )
            view.cache["tip"] = regressor[:, :, 0] / segment.r
        return (view.cache["tip"] * (view.clock >= shape["t_0"])[:, None])[:, :, None]

    def body_columns(self, machine: Machine, shape: Shape) -> Sequence[BodyColumn]:
        """Return a point mass at the tip; none where it was there in one recording only."""
        if self.confined(shape):
            return ()
        links = np.zeros((len(machine.joints), 10))
        links[-1, 0] = 1.0
        return (BodyColumn(np.asarray(machine.gravity, dtype=float), links, shape["t_0"]),)
