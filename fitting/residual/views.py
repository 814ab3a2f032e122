"""What effects may look at, built from a design and the present state of the model."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import overload

import numpy as np

from fitting.arrays import FloatArray
from fitting.effects.base import DriveView, Ranges
from fitting.regression.design import Design, Extra, predicted_effort
from fitting.regression.drive import expected_sign
from fitting.signals.preparation import Segment
from fitting.signals.splines import evaluate, spline_knots

#: ``views[segment][joint]``
Views = Sequence[tuple[DriveView, ...]]


class LaterViews(Sequence[tuple[DriveView, ...]]):
    """Views that are built when the first of them is looked at: most fits never do."""

    def __init__(self, build: Callable[[], Views]) -> None:
        self._build = build

    @cached_property
    def _views(self) -> Views:
        return self._build()

    @overload
    def __getitem__(self, index: int) -> tuple[DriveView, ...]: ...

    @overload
    def __getitem__(self, index: slice) -> Views: ...

    def __getitem__(self, index: int | slice) -> tuple[DriveView, ...] | Views:
        return self._views[index]

    def __len__(self) -> int:
        return len(self._views)


def signal_ranges(design: Design, fitted: Sequence[int], forces: Sequence[FloatArray]) -> tuple[Ranges, ...]:
    """Ranges of every joint's signals over the fitted segments; ``forces`` are (N, n) per segment of the design."""
    starts = recording_starts(design)
    result = []
    for joint in range(len(design.machine.joints)):
        x = np.concatenate([design.segments[i].x[:, joint] for i in fitted])
        v = np.concatenate([design.segments[i].v[:, joint] for i in fitted])
        force = np.concatenate([forces[i][:, joint] for i in fitted])
        clocks = [design.segments[i].t - starts[design.segments[i].recording] for i in fitted]
        result.append(
            Ranges(
                x=(float(x.min()), float(x.max())),
                v=float(np.abs(v).max()),
                force=float(np.abs(force).max()),
                time=(float(min(c[0] for c in clocks)), float(max(c[-1] for c in clocks))),
            )
        )
    return tuple(result)


def build_views(design: Design, theta: FloatArray, fitted: Sequence[int], extra: Extra | None = None) -> Views:
    """Views of all segments; forces are the model's own, with the effects that were added so far."""
    joints = len(design.machine.joints)
    count = range(len(design.segments))
    forces = [
        np.stack([predicted_effort(design, theta, joint, index, extra) for joint in range(joints)], axis=1)
        for index in count
    ]
    base = design.parameters.base_slice.start
    loads = [
        np.stack([design.blocks[joint][index].force(theta, base) for joint in range(joints)], axis=1) for index in count
    ]
    ranges = signal_ranges(design, fitted, forces)
    laws = dict[bool, tuple[RodLaw | None, ...]]()
    starts = recording_starts(design)

    def pressures(index: int) -> FloatArray:
        if not laws:  # most fits never ask for pressures
            laws.update(rod_laws(design, fitted, lambda number: forces[number]))
        segment = design.segments[index]
        return rod_pressures(laws, segment, forces[index], segment.t - starts[segment.recording])

    loaded = tuple(sorted({design.segments[i].recording for i in fitted if design.segments[i].loaded}))
    return tuple(
        views_of_segment(
            design, theta, design.segments[i], forces[i], loads[i], partial(pressures, i), ranges, starts, loaded
        )
        for i in count
    )


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
    """Views of all joints in one segment, from forces and loads (N, n); ``starts`` has the recordings' first times."""
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
    """Time of each recording's first sample, s."""
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
        """Pressures (N,) in Pa from signals (N, 5)."""
        *smooth, of_sign = np.split(self.coefficients, np.cumsum([len(knots) - 4 for knots in self.knots]))
        parts = zip(self.knots, signals.T, smooth, strict=True)
        sign = expected_sign(signals[:, 0], self.speed_noise)
        return np.asarray(sum(evaluate(*own) for own in parts) + sign * (of_sign[0] + of_sign[1] * signals[:, 1]))

    @staticmethod
    def basis(knots: Sequence[FloatArray], signals: FloatArray, speed_noise: float) -> FloatArray:
        """All functions at signals (N, 5)."""
        parts = [evaluate(k, column) for k, column in zip(knots, signals.T, strict=True)]
        sign = expected_sign(signals[:, 0], speed_noise)
        return np.hstack([*parts, sign[:, None], sign[:, None] * signals[:, 1:2]])


def rod_signals(segment: Segment, joint: int, force: FloatArray, clock: FloatArray) -> FloatArray:
    """What a :class:`RodLaw` is of, (N, 5), from the model's forces (N, n) and the clock (N,)."""
    return np.column_stack([segment.v[:, joint], force[:, joint], segment.x[:, joint], segment.a[:, joint], clock])


def rod_laws(
    design: Design, fitted: Sequence[int], forces: Callable[[int], FloatArray], thin: int = 1
) -> dict[bool, tuple[RodLaw | None, ...]]:
    """Rod pressures as a smooth function of motion, model force and time: per joint a law, None without a sensor.

    A measured pressure holds the very disturbance that a regressor must not know (which chamber takes it up depends on
    the valve). So the pressure is replaced by its regression on signals that do not hold it: an instrument. A free
    cylinder and a loaded one have pressures of their own: the laws of unloaded segments (False) and of loaded ones.

    Parameters
    ----------
    forces : gives the model's forces (N, n) in a segment
    thin : every so many-th sample is enough (of long recordings)
    """
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
            rod_signals(segment, joint, forces(i), segment.t - starts[segment.recording])[::thin]
            for i, segment in zip(fitted, segments, strict=True)
        ]
    )
    knots = tuple(spline_knots(column, 6) for column in together.T)
    step = max(1, len(together) // 4000)  # a few thousand samples fix thirty coefficients
    measured = np.concatenate([segment.p2[::thin, joint] for segment in segments])
    noise = design.noise[joint].speed
    table = RodLaw.basis(knots, together[::step], noise)
    scale = np.maximum(np.abs(table).max(axis=0), 1e-12)
    coefficients = np.linalg.lstsq(table / scale, measured[::step], rcond=1e-8)[0] / scale
    return RodLaw(knots, coefficients, noise)


def rod_pressures(
    laws: Mapping[bool, Sequence[RodLaw | None]], segment: Segment, forces: FloatArray, clock: FloatArray
) -> FloatArray:
    """Expected rod pressures (N, n) in a segment by the laws of its kind, or of the only one; NaN without a law."""
    own = laws[segment.loaded if segment.loaded in laws else not segment.loaded]
    unknown = np.full(len(segment), np.nan)
    columns = [
        unknown if law is None else law(rod_signals(segment, joint, forces, clock)) for joint, law in enumerate(own)
    ]
    return np.column_stack(columns)
