"""What effects may look at, built from a design and the present state of the model."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, partial
from typing import overload

import numpy as np
import numpy.typing as npt

from fitting.drive import expected_sign
from fitting.effects.base import DriveView, Ranges
from fitting.preparation import Segment
from fitting.regression import Design, Extra, predicted_effort
from fitting.splines import evaluate, spline_knots

FloatArray = npt.NDArray[np.float64]
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
    base = design.parameters.base_slice
    loads = [
        np.stack([design.blocks[joint][index].columns[:, base] @ theta[base] for joint in range(joints)], axis=1)
        for index in count
    ]
    ranges = signal_ranges(design, fitted, forces)
    rods: list[list[FloatArray]] = []

    def rod_pressures(index: int) -> FloatArray:
        if not rods:  # most fits never ask for pressures
            rods.append(_rod_pressures(design, fitted, forces))
        return rods[0][index]

    starts = recording_starts(design)
    loaded = tuple(sorted({design.segments[i].recording for i in fitted if design.segments[i].loaded}))
    return tuple(
        views_of_segment(
            design, theta, design.segments[i], forces[i], loads[i], partial(rod_pressures, i), ranges, starts, loaded
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


def _rod_pressures(design: Design, fitted: Sequence[int], forces: Sequence[FloatArray]) -> list[FloatArray]:
    """Rod pressures of :func:`rod_laws` in all segments, (N, n) each."""
    laws = rod_laws(design, fitted, lambda index: forces[index])
    return [
        np.column_stack([np.full(len(force), np.nan) if law is None else law(index, force) for law in laws])
        for index, force in enumerate(forces)
    ]


def rod_laws(
    design: Design, fitted: Sequence[int], forces: Callable[[int], FloatArray], thin: int = 1
) -> list[Callable[[int, FloatArray], FloatArray] | None]:
    """Rod pressures as a smooth function of motion, model force and time: per joint a law, None without a sensor.

    A measured pressure holds the very disturbance that a regressor must not know (which chamber takes it up depends on
    the valve). So the pressure is replaced by its regression on signals that do not hold it: an instrument.

    Parameters
    ----------
    forces : gives the model's forces (N, n) in a segment
    thin : every so many-th sample is enough (of long recordings)

    Returns
    -------
    list
        Functions of a segment's number and its forces (N, n) that give pressures (N,).
    """
    starts = recording_starts(design)
    laws: list[Callable[[int, FloatArray], FloatArray] | None] = []
    for joint in range(len(design.machine.joints)):
        if any(np.isnan(design.segments[i].p2[0, joint]) for i in fitted):
            laws.append(None)
            continue

        def signals(index: int, force: FloatArray, joint: int = joint) -> FloatArray:
            segment = design.segments[index]
            v = segment.v[:, joint]
            clock = segment.t - starts[segment.recording]
            return np.column_stack([v, force[:, joint], segment.x[:, joint], segment.a[:, joint], clock])

        together = np.concatenate([signals(i, forces(i))[::thin] for i in fitted])
        knots = [spline_knots(column, 6) for column in together.T]
        noise = design.noise[joint].speed

        def basis(values: FloatArray, knots: list[FloatArray] = knots, noise: float = noise) -> FloatArray:
            parts = [evaluate(k, column) for k, column in zip(knots, values.T, strict=True)]
            sign = expected_sign(values[:, 0], noise)
            return np.hstack([*parts, sign[:, None], sign[:, None] * values[:, 1:2]])

        step = max(1, len(together) // 4000)  # a few thousand samples fix thirty coefficients
        measured = np.concatenate([design.segments[i].p2[::thin, joint] for i in fitted])
        table = basis(together[::step])
        scale = np.maximum(np.abs(table).max(axis=0), 1e-12)
        coefficients = np.linalg.lstsq(table / scale, measured[::step], rcond=1e-8)[0] / scale

        def law(
            index: int,
            force: FloatArray,
            signals: Callable[[int, FloatArray], FloatArray] = signals,
            basis: Callable[[FloatArray], FloatArray] = basis,
            coefficients: FloatArray = coefficients,
        ) -> FloatArray:
            return np.asarray(basis(signals(index, force)) @ coefficients)

        laws.append(law)
    return laws
