"""Signals that effects may use, built from a design and the present state of the model."""

from __future__ import annotations

from collections.abc import Callable, Mapping, MutableMapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import overload

import numpy as np

from daq.scratch import ScratchArrays
from fitting.arm.expected import expected_sign
from fitting.arrays import FloatArray
from fitting.effects.base import DriveView, Ranges
from fitting.regression.design import Design, Extra, predicted_effort
from fitting.regression.stored import in_memory
from fitting.signals.preparation import Segment
from fitting.signals.splines import evaluate, spline_knots

#: ``views[segment][joint]``
Views = Sequence[tuple[DriveView, ...]]
#: Samples of a cylinder that are enough to learn its rod pressures from: thirty coefficients.
_LEARNT = 40_000


class SegmentViews(Sequence[tuple[DriveView, ...]]):
    """Views of all segments of a design, made when the first of them is looked at: most fits never are.

    Forces are the model's own, with the effects that were added so far. Of a design whose arrays are in a file
    (:attr:`fitting.regression.design.Design.stored`) forces and loads are in one as well, and the views of one segment
    are in memory, the one that was asked for last.
    """

    def __init__(self, design: Design, theta: FloatArray, fitted: Sequence[int], extra: Extra | None = None) -> None:
        self._design, self._theta, self._fitted, self._extra = design, theta, tuple(fitted), extra
        self._loaded = tuple(sorted({design.segments[i].recording for i in fitted if design.segments[i].loaded}))
        self._made: dict[int, tuple[DriveView, ...]] = {}

    def __len__(self) -> int:
        return len(self._design.segments)

    @overload
    def __getitem__(self, index: int) -> tuple[DriveView, ...]: ...

    @overload
    def __getitem__(self, index: slice) -> Views: ...

    def __getitem__(self, index: int | slice) -> tuple[DriveView, ...] | Views:
        if isinstance(index, slice):
            return [self[number] for number in range(*index.indices(len(self)))]
        number = range(len(self))[index]  # an IndexError ends an iteration
        if number not in self._made:
            if self._design.stored:
                self._made.clear()
            self._made[number] = self._views(number)
        return self._made[number]

    def _views(self, number: int) -> tuple[DriveView, ...]:
        segment, (forces, loads) = self._design.segments[number], self._efforts[number]
        segment, pressures = in_memory(segment) if self._design.stored else segment, partial(self._pressures, number)
        known = pressures, self._ranges, self._starts, self._loaded
        return views_of_segment(self._design, self._theta, segment, forces, loads, *known)

    @cached_property
    def _starts(self) -> dict[int, float]:
        return recording_starts(self._design)

    @cached_property
    def _efforts(self) -> Mapping[int | None, FloatArray]:
        """The model's drive efforts and its loads (2, N, n) by segment."""
        design, base = self._design, self._design.parameters.base_slice.start
        kept: MutableMapping[int | None, FloatArray] = ScratchArrays() if design.stored else {}
        joints = range(len(design.machine.joints))
        for index in range(len(self)):
            forces = [predicted_effort(design, self._theta, joint, index, self._extra) for joint in joints]
            loads = [design.blocks[joint][index].force(self._theta, base) for joint in joints]
            kept[index] = np.stack([np.stack(forces, axis=1), np.stack(loads, axis=1)])
        return kept

    @cached_property
    def _ranges(self) -> tuple[Ranges, ...]:
        """Ranges of every joint's signals over the fitted segments."""
        seen = []
        for index in self._fitted:
            segment = self._design.segments[index]
            x, v, force = segment.x, np.abs(segment.v), np.abs(self._efforts[index][0])
            clock = segment.t - self._starts[segment.recording]
            seen.append((x.min(axis=0), x.max(axis=0), v.max(axis=0), force.max(axis=0), clock[0], clock[-1]))
        low, high, speed, force, first, last = zip(*seen, strict=True)
        times = float(min(first)), float(max(last))
        ends = zip(np.min(low, axis=0), np.max(high, axis=0), strict=True)
        largest = zip(np.max(speed, axis=0), np.max(force, axis=0), strict=True)
        return tuple(
            Ranges(x=(float(a), float(b)), v=float(v), force=float(f), time=times)
            for (a, b), (v, f) in zip(ends, largest, strict=True)
        )

    @cached_property
    def _pressures(self) -> _RodPressures:
        return _RodPressures(self._design, self._fitted, self._efforts, self._starts)


class _RodPressures:
    """Expected rod pressures (N, n) of a segment, by laws that are learnt when the first is asked for.

    Views hold this, and not the :class:`SegmentViews` that hold them: memory is given back at once.
    """

    def __init__(
        self,
        design: Design,
        fitted: Sequence[int],
        efforts: Mapping[int | None, FloatArray],
        starts: Mapping[int, float],
    ) -> None:
        self._design, self._fitted, self._efforts, self._starts = design, fitted, efforts, starts

    @cached_property
    def _laws(self) -> dict[bool, tuple[RodLaw | None, ...]]:
        return rod_laws(self._design, self._fitted, lambda index: self._efforts[index][0])

    def __call__(self, index: int) -> FloatArray:
        segment = self._design.segments[index]
        clock = segment.t - self._starts[segment.recording]
        return rod_pressures(self._laws, segment, self._efforts[index][0], clock)


def views_of_segment(
    design: Design,
    theta: FloatArray,
    segment: Segment,
    forces: FloatArray,
    loads: FloatArray,
    rod_pressures: Callable[[], FloatArray],
    ranges: tuple[Ranges, ...],
    starts: Mapping[int, float],
    loaded_recordings: tuple[int, ...],
) -> tuple[DriveView, ...]:
    """Return views of all joints in a segment by forces and loads (N, n); ``starts``: recordings' first times."""
    shared: dict[str, FloatArray] = {}
    return tuple(
        DriveView(
            machine=design.machine,
            joint=joint,
            segment=segment,
            bank=design.bank,
            noise=design.noise,
            forces=forces,
            loads=loads,
            rod_pressures=rod_pressures,
            ranges=ranges,
            clock=segment.t - starts[segment.recording],
            base=design.parameters.base,
            base_values=theta[design.parameters.base_slice],
            loaded_recordings=loaded_recordings,
            shared=shared,
        )
        for joint in range(len(design.machine.joints))
    )


def recording_starts(design: Design) -> dict[int, float]:
    """Return each recording's first time, s."""
    starts: dict[int, float] = {}
    for segment in design.segments:
        starts[segment.recording] = min(starts.get(segment.recording, np.inf), float(segment.t[0]))
    return starts


@dataclass(frozen=True)
class RodLaw:
    """Expected rod pressure of one cylinder: splines of five signals, the sign of speed, and that times the force.

    Attributes
    ----------
    knots : of the splines in speed, model force, position, acceleration and clock
    coefficients : of all their functions in this order, then of the sign and of the sign times the force, Pa
    speed_noise : of the sign's expectation, m/s
    """

    knots: tuple[FloatArray, ...]
    coefficients: FloatArray
    speed_noise: float

    def __call__(self, signals: FloatArray) -> FloatArray:
        """Compute pressures (N,) in Pa from signals (N, 5)."""
        *smooth, of_sign = np.split(self.coefficients, np.cumsum([len(knots) - 4 for knots in self.knots]))
        parts = zip(self.knots, signals.T, smooth, strict=True)
        sign = expected_sign(signals[:, 0], self.speed_noise)
        return np.asarray(sum(evaluate(*own) for own in parts) + sign * (of_sign[0] + of_sign[1] * signals[:, 1]))

    @staticmethod
    def basis(knots: Sequence[FloatArray], signals: FloatArray, speed_noise: float) -> FloatArray:
        """Evaluate all functions at signals (N, 5)."""
        parts = [evaluate(k, column) for k, column in zip(knots, signals.T, strict=True)]
        sign = expected_sign(signals[:, 0], speed_noise)
        return np.hstack([*parts, sign[:, None], sign[:, None] * signals[:, 1:2]])


def _rod_signals(segment: Segment, joint: int, force: FloatArray, clock: FloatArray) -> FloatArray:
    """Compute the signals of a :class:`RodLaw`, (N, 5), from model forces (N, n) and clock (N,)."""
    return np.column_stack([segment.v[:, joint], force[:, joint], segment.x[:, joint], segment.a[:, joint], clock])


def rod_laws(
    design: Design, fitted: Sequence[int], forces: Callable[[int], FloatArray]
) -> dict[bool, tuple[RodLaw | None, ...]]:
    """Fit rod pressures by smooth laws of motion, model force and time, one per joint; None without a sensor.

    A measured pressure holds the very disturbance that a regressor must not know (which chamber takes it up depends on
    the valve). So the pressure is replaced by its regression on signals that do not hold it: an instrument. A free
    cylinder and a loaded one have pressures of their own: the laws of unloaded segments (False) and of loaded ones.

    Parameters
    ----------
    forces : gives the model's forces (N, n) in a segment
    """
    thin = max(1, sum(len(design.segments[index]) for index in fitted) // _LEARNT)
    kinds = {loaded: [i for i in fitted if design.segments[i].loaded == loaded] for loaded in (False, True)}
    starts, joints = recording_starts(design), range(len(design.machine.joints))
    return {
        loaded: tuple(_rod_law(design, own, forces, starts, joint, thin) for joint in joints)
        for loaded, own in kinds.items()
        if own
    }


def _rod_law(
    design: Design,
    fitted: Sequence[int],
    forces: Callable[[int], FloatArray],
    starts: Mapping[int, float],
    joint: int,
    thin: int,
) -> RodLaw | None:
    segments = [design.segments[i] for i in fitted]
    if any(np.isnan(segment.p2[0, joint]) for segment in segments):
        return None
    together = np.concatenate(
        [
            _rod_signals(segment, joint, forces(i), segment.t - starts[segment.recording])[::thin]
            for i, segment in zip(fitted, segments, strict=True)
        ]
    )
    knots = tuple(spline_knots(column, 6) for column in together.T)
    step = max(1, len(together) // 4000)  # a few thousand samples fix thirty coefficients
    measured = np.concatenate([segment.p2[::thin, joint] for segment in segments])
    noise = design.noise[joint].sign
    table = RodLaw.basis(knots, together[::step], noise)
    scale = np.maximum(np.abs(table).max(axis=0), 1e-12)
    coefficients = np.linalg.lstsq(table / scale, measured[::step], rcond=1e-8)[0] / scale
    return RodLaw(knots, coefficients, noise)


def rod_pressures(
    laws: Mapping[bool, Sequence[RodLaw | None]], segment: Segment, forces: FloatArray, clock: FloatArray
) -> FloatArray:
    """Predict rod pressures (N, n) in a segment by the laws of its kind, or the only one's; NaN without a law."""
    own = laws[segment.loaded if segment.loaded in laws else not segment.loaded]
    unknown = np.full(len(segment), np.nan)
    columns = [
        unknown if law is None else law(_rod_signals(segment, joint, forces, clock)) for joint, law in enumerate(own)
    ]
    return np.column_stack(columns)
