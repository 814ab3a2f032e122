"""The one path from a handed-over model and a motion to efforts and their standard deviations.

It is the pipeline's own: designs, columns and sums are made by the functions that the fit used, of parameters that the
model brought along. So on a recording of the identification it gives the pipeline's prediction.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from fitting.arrays import FloatArray
from fitting.effects.base import DriveView
from fitting.model.arm_model import FOREIGN, ArmModel, Pass
from fitting.regression.design import Design, Extra, build_design, predicted_effort
from fitting.residual.terms import extra_columns
from fitting.residual.views import recording_starts, rod_pressures, views_of_segment
from fitting.signals.preparation import Segment, motion_segment

#: Share of the recorded positions and speeds by which a motion may be outside them, and kelvins of the oil.
_MARGIN, _WARMER = 0.02, 1.0
#: Shares in a 95 % band between which it holds what it states.
_HOLDS = 0.92, 0.98


@dataclass(frozen=True)
class Evaluated:
    """A model on some segments; what :mod:`fitting.regression.design` needs to predict any of its efforts.

    Attributes
    ----------
    model : the model, with the terms that were evaluated
    design : its columns
    extra : columns of its effects
    starts : by recording the time at which its clock begins, s
    """

    model: ArmModel
    design: Design
    extra: Extra
    starts: Mapping[int, float]

    def drive_effort(self, index: int) -> FloatArray:
        """Compute the drives' efforts (N, n) in a segment, N at a piston."""
        design, theta, joints = self.design, self.model.theta, range(len(self.design.blocks))
        return np.stack([predicted_effort(design, theta, joint, index, self.extra) for joint in joints], axis=1)

    def joint_effort(self, index: int) -> FloatArray:
        """Compute the joints' efforts (N, n) in a segment, N m or N."""
        return np.asarray(self.design.segments[index].r * self.drive_effort(index))

    def parameter_std(self, index: int) -> FloatArray:
        """Compute the standard deviation of the drives' efforts (N, n) by the parameters' covariance."""
        return np.stack([self._spread(self._columns(joint, index)) for joint in range(len(self.design.blocks))], axis=1)

    def std(self, index: int) -> FloatArray:
        """Compute the deviation of measured drive efforts (N, n): by parameters, and the fit's remainder."""
        return np.hypot(self.parameter_std(index), self.model.residual_std)

    def joint_std(self, index: int) -> FloatArray:
        """Compute the same of the joints' efforts (N, n), N m or N."""
        return np.abs(self.design.segments[index].r) * self.std(index)

    def sum_variance(self, index: int, weights: FloatArray) -> FloatArray:
        """Compute variances (n,) by the parameters' covariance of sums over drive efforts with weights (N, n)."""
        joints = range(len(self.design.blocks))
        sums = [weights[:, joint] @ self._columns(joint, index) for joint in joints]
        return np.array([float(self._spread(own[None, :])[0]) ** 2 for own in sums])

    def _columns(self, joint: int, index: int) -> FloatArray:
        """Compute each parameter's unit share of a drive's effort, (N, p)."""
        columns, own = self.design.blocks[joint][index].columns, self.extra.columns[joint][index]
        more = np.zeros((len(columns), len(self.extra.names))) if own is None else own
        return np.hstack([columns, more])

    def _spread(self, columns: FloatArray) -> FloatArray:
        """Compute the standard deviation (N,) of columns (N, p); infinite where undetermined parameters take part."""
        known = np.isfinite(np.diag(self.model.covariance))
        spread = np.linalg.norm(columns[:, known] @ self.model.covariance_root, axis=1)
        return np.where(np.any(columns[:, ~known] != 0, axis=1), np.inf, spread)

    def views(self, index: int) -> tuple[DriveView, ...]:
        """Return what effects and expected pressures use of the whole model, by joint."""
        return _views(self.design, self.model.passes[-1], self.extra, index, self.starts)


def evaluate(model: ArmModel, segments: Sequence[Segment], starts: Mapping[int, float] | None = None) -> Evaluated:
    """Evaluate a model with all of its terms on prepared segments.

    Parameters
    ----------
    starts : by recording the time at which its clock begins, s; that of its first sample if None
    """
    design = build_design(model.arm, model.base, model.bank, model.noise, segments)
    starts = recording_starts(design) if starts is None else starts
    extra = extra_columns(design, (), ())
    count = len(model.parameters)
    # Where no column holds a force there is one pass, and the forces that views have do not matter.
    for own in model.passes[:-1] or (replace(model.passes[-1], theta=model.theta[:count]),) if model.terms else ():
        views = tuple(_views(design, own, extra, index, starts) for index in range(len(design.segments)))
        extra = extra_columns(design, views, model.terms)
    return Evaluated(model, design, extra, starts)


def _views(design: Design, own: Pass, extra: Extra, index: int, starts: Mapping[int, float]) -> tuple[DriveView, ...]:
    joints, segment = range(len(design.blocks)), design.segments[index]
    base = design.parameters.base_slice.start
    forces = np.stack([predicted_effort(design, own.theta, joint, index, extra) for joint in joints], axis=1)
    loads = np.stack([design.blocks[j][index].force(own.theta, base) for j in joints], axis=1)
    clock = segment.t - starts[segment.recording]
    pressures = partial(rod_pressures, {True: own.rods}, segment, forces, clock)
    return views_of_segment(design, own.theta, segment, forces, loads, pressures, own.ranges, starts, ())


def segment_of(
    model: ArmModel,
    moved: Sequence[Any],
    t: Any,
    *,
    temperature: Any = None,
    external: FloatArray | None = None,
) -> Segment:
    """Make a segment of an unrecorded motion: numbers, or expressions in their place.

    Parameters
    ----------
    moved : ``q, qd, qdd``, (N, n) each
    """
    unseen = {"recording": FOREIGN, "role": "operation", "temperature": temperature, "external": external}
    return motion_segment(model.arm, t, moved, **unseen)


def beyond(model: ArmModel, segment: Segment) -> npt.NDArray[np.bool_]:
    """Return where (N, n) a motion is beyond recorded positions and speeds, its error unknown.

    And all joints where the oil is colder or warmer, if the model knows its temperature and the motion has one. What is
    not a number is beyond.
    """
    low, high, fast = np.array([(*own.x, own.v) for own in model.passes[-1].ranges]).T
    margin = _MARGIN * (high - low)
    inside = np.minimum(segment.x >= low - margin, segment.x <= high + margin)
    inside = np.minimum(inside, np.abs(segment.v) <= (1.0 + _MARGIN) * fast)
    if model.temperature is not None and segment.temperature is not None:
        cold, warm = model.temperature
        oil = segment.temperature[:, None]
        inside = np.minimum(inside, np.minimum(oil >= cold - _WARMER, oil <= warm + _WARMER))
    return np.asarray(np.less(inside, 1.0))


def narrow(model: ArmModel) -> list[str]:
    """Warn of each joint whose 95 % band was too narrow on validation."""
    shares = [] if model.coverage is None else zip(model.joints, model.coverage.tolist(), strict=True)
    return [
        f"of {name}, {share:.0%} of the samples of another motion were in the 95 % band: there the model leaves "
        f"{'more' if share < _HOLDS[0] else 'less'} than on the motion of the fit"
        for name, share in shares
        if share < _HOLDS[0] or share > _HOLDS[1]
    ]


def without(model: ArmModel, numbers: Collection[int]) -> ArmModel:
    """Remove some terms from the model; the others' parameters are not refitted."""
    if not numbers:
        return model
    kept = list(range(len(model.parameters)))
    for number, own in enumerate(model.term_slices):
        kept += [] if number in numbers else range(own.start, own.stop)
    return replace(
        model,
        terms=tuple(term for number, term in enumerate(model.terms) if number not in numbers),
        # A fit of several may have had no terms yet.
        passes=tuple(replace(own, theta=own.theta[[k for k in kept if k < len(own.theta)]]) for own in model.passes),
        covariance=model.covariance[np.ix_(kept, kept)],
        told=model.told[kept],
        hidden=None if model.hidden is None else model.hidden[kept],
    )
