"""Planned motions as if they had been recorded: what an experiment will show, before anybody makes it.

A motion program goes through the same filters as a recording, so its columns are those that the regression will have.
Only the measured efforts are missing, and nothing here needs them: information is a matter of columns and noise.

Effects look at the model's own forces, and at chamber pressures that follow from them. On a recording the expected rod
pressure is a smooth function of motion and force, fitted where both were seen. A planned motion may go where nothing
was: a load that pulls where it always pushed. There the valve's physics has to carry on: the chamber that is being
emptied keeps its back-pressure, and no chamber falls below the lowest pressure that any of the machine was seen at; the
other one then carries the force.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import scipy

from daq.errors import InputError
from daq.machine.machine_file import Machine
from daq.motion_files import Motion
from fitting.arm.linkage import piston_motion
from fitting.arrays import FloatArray
from fitting.effects.base import DriveView
from fitting.regression.design import Design, Extra
from fitting.residual.terms import Model, Term, extra_columns
from fitting.residual.views import SegmentViews, Views
from fitting.signals.filters import FilterBank
from fitting.signals.preparation import REST_SPEED, PositionNoise, Segment, long_rests, motion_segment

#: Position, speed and acceleration, each (N, n).
States = tuple[FloatArray, FloatArray, FloatArray]

ROLE = "planned"


def planned_segment(
    machine: Machine, bank: FilterBank, noise: Sequence[PositionNoise], motion: Motion, recording: int = 0
) -> Segment:
    """Return the segment that preparation would make of a recorded motion, without noise and efforts.

    Joints without a column are mid-range. Below some times the position's own noise a speed counts as rest.
    ``recording`` is the number that the recording will have.

    Raises
    ------
    InputError
        If the motion is shorter than the filters.
    """
    length = round(motion.seconds * bank.rate_hz) + 1
    least = 2 * (bank.margin + bank.half) + 4 * bank.decimation
    if length <= least:
        raise InputError("fitting.motion_shorter_filters", seconds=motion.seconds, least=least / bank.rate_hz)
    time = np.arange(length) / bank.rate_hz
    samples = length - 2 * bank.margin
    moved: dict[str, tuple[FloatArray, FloatArray, FloatArray]] = {
        name: bank.smooth(_resampled(motion.time, column, time)) for name, column in motion.columns.items()
    }
    still = np.zeros(samples)
    parked = [(still + sum(joint.limits.position) / 2, still, still) for joint in machine.joints]
    if motion.rods == "pinned":
        turning = [moved.get(joint.name, parked[j]) for j, joint in enumerate(machine.joints)]
        return segment_of_states(machine, bank, noise, _stacked(turning), recording)
    driving = [
        moved.get(
            joint.name, parked[j] if joint.cylinder is None else piston_motion(joint.cylinder.linkage, *parked[j])
        )
        for j, joint in enumerate(machine.joints)
    ]
    return segment_of_states(machine, bank, noise, _stacked(parked), recording, _stacked(driving), loaded=False)


def segment_of_states(
    machine: Machine,
    bank: FilterBank,
    noise: Sequence[PositionNoise],
    turning: States,
    recording: int = 0,
    driving: States | tuple[()] = (),
    loaded: bool = True,
) -> Segment:
    """Make :func:`planned_segment` from the states of all joints at the machine's rate; of the pistons if given."""
    time = (bank.margin + np.arange(len(turning[0]))) / bank.rate_hz
    planned = {"recording": recording, "role": ROLE, "start": bank.margin, "loaded": loaded}
    moved = motion_segment(machine, time, turning, driving, **planned)
    # At rest as in preparation; without noise as well.
    slow = np.abs(moved.v) <= np.maximum([REST_SPEED * own.speed for own in noise], 1e-12)
    return replace(moved, rest=np.stack([long_rests(own, bank.rate_hz) for own in slow.T], axis=1))


def _stacked(columns: Sequence[tuple[FloatArray, FloatArray, FloatArray]]) -> States:
    position, speed, acceleration = (np.stack(part, axis=1) for part in zip(*columns, strict=True))
    return position, speed, acceleration


def _resampled(time: FloatArray, values: FloatArray, wanted: FloatArray) -> FloatArray:
    if len(time) == len(wanted) and np.allclose(time, wanted, rtol=0, atol=1e-9):
        return values
    return np.asarray(scipy.interpolate.make_interp_spline(time, values, k=5)(np.minimum(wanted, time[-1])))


_LOWEST = 0.005  # quantile that counts as the lowest pressure seen


@dataclass(frozen=True)
class ChamberModel:
    """Rod pressure of one cylinder as a function of speed and force.

    Attributes
    ----------
    head_area, rod_area : m^2
    coefficients : of :meth:`_features`; NaN where no pressures are measured
    speeds, forces : intervals that were seen
    floor : lowest pressure of either chamber, Pa
    """

    head_area: float
    rod_area: float
    coefficients: FloatArray
    speeds: tuple[float, float]
    forces: tuple[float, float]
    floor: float

    @staticmethod
    def _features(v: FloatArray, force: FloatArray) -> FloatArray:
        out, back = np.maximum(v, 0.0), np.maximum(-v, 0.0)
        pushing = np.maximum(force, 0.0)
        return np.column_stack([np.ones_like(v), out, back, out**2, back**2, pushing, force - pushing, np.sign(v)])

    def rod_pressure(self, v: FloatArray, force: FloatArray) -> FloatArray:
        """Predict rod pressure (N,) in Pa at piston speeds ``v`` and drive efforts ``force``."""
        seen = self._features(np.clip(v, *self.speeds), np.clip(force, *self.forces)) @ self.coefficients
        # p1 = (F + p2 A2) / A1 must not fall below its floor either.
        least = np.maximum(self.floor, (self.floor * self.head_area - force) / self.rod_area)
        return np.asarray(np.maximum(seen, least))


def chamber_models(model: Model) -> tuple[ChamberModel | None, ...]:
    """Fit chamber models of all cylinders with measured pressures on recordings with links on.

    The floor is the machine's: a chamber that always carried a load has never been at its own.
    """
    found: list[ChamberModel | None] = []
    design = model.design
    loaded = [i for i in model.fitted if design.segments[i].loaded]
    segments = [design.segments[i] for i in loaded]
    measured = [
        joint.cylinder is not None and not any(np.isnan(s.p1[0, j]) or np.isnan(s.p2[0, j]) for s in segments)
        for j, joint in enumerate(design.machine.joints)
    ]
    lowest = [
        float(np.quantile(np.concatenate([pressures[::10, j] for pressures in chambers]), _LOWEST))
        for j in np.flatnonzero(measured)
        for chambers in ([s.p1 for s in segments], [s.p2 for s in segments])
    ]
    for number, joint in enumerate(design.machine.joints):
        cylinder = joint.cylinder
        if cylinder is None or not measured[number]:
            found.append(None)
            continue
        step = max(1, sum(len(s) for s in segments) // 4000)
        v = np.concatenate([s.v[::step, number] for s in segments])
        force = np.concatenate([model.views[i][number].force[::step] for i in loaded])
        p2 = np.concatenate([s.p2[::step, number] for s in segments])
        table = ChamberModel._features(v, force)
        scale = np.maximum(np.abs(table).max(axis=0), 1e-12)
        found.append(
            ChamberModel(
                cylinder.head_area,
                cylinder.rod_area,
                np.linalg.lstsq(table / scale, p2, rcond=1e-8)[0] / scale,
                (float(v.min()), float(v.max())),
                (float(force.min()), float(force.max())),
                min(lowest),
            )
        )
    return tuple(found)


def usual_chambers(machine: Machine, back_pressure: float) -> tuple[ChamberModel | None, ...]:
    """Return chamber models before measurement: the emptied chamber keeps ``back_pressure`` (Pa)."""
    nothing = np.zeros(ChamberModel._features(np.zeros(1), np.zeros(1)).shape[1])
    everywhere = (-np.inf, np.inf)
    return tuple(
        None
        if own is None
        else ChamberModel(own.head_area, own.rod_area, nothing, everywhere, everywhere, back_pressure)
        for own in (joint.cylinder for joint in machine.joints)
    )


def planned_views(
    design: Design,
    theta: FloatArray,
    chambers: tuple[ChamberModel | None, ...],
    terms: Sequence[Term] = (),
    like: DriveView | None = None,
) -> Views:
    """Return views of all segments of a planned design.

    Parameters
    ----------
    design : planned motions
    theta : parameters that the forces are computed with: drive, base, then those of ``terms``
    chambers : where expected rod pressures come from
    terms : what was added to the model
    like : a view of recordings, whose ranges count so that shapes mean the same; the plan's own without
    """
    every = range(len(design.segments))
    views = _with_pressures(SegmentViews(design, theta, every), chambers, like)
    if not terms:
        return views
    # The forces hold what the accepted effects add, which is built from the forces: once around is enough.
    extra: Extra = extra_columns(design, views, terms)
    return _with_pressures(SegmentViews(design, theta, every, extra), chambers, like)


def _with_pressures(views: Views, chambers: tuple[ChamberModel | None, ...], like: DriveView | None) -> Views:
    result = []
    for row in views:
        pressures = _pressures(row[0].segment.v, row[0].forces, chambers)
        result.append(
            tuple(
                replace(
                    view,
                    ranges=view.ranges if like is None else like.ranges,
                    loaded_recordings=view.loaded_recordings if like is None else like.loaded_recordings,
                    rod_pressures=pressures,
                    cache={},
                )
                for view in row
            )
        )
    return tuple(result)


def _pressures(
    v: FloatArray, forces: FloatArray, chambers: tuple[ChamberModel | None, ...]
) -> Callable[[], FloatArray]:
    """Return a function of one segment's rod pressures, computed at its first call."""

    @cache
    def values() -> FloatArray:
        columns = [
            np.full(len(v), np.nan) if each is None else each.rod_pressure(v[:, j], forces[:, j])
            for j, each in enumerate(chambers)
        ]
        return np.column_stack(columns)

    return values
