"""What effects may look at, built from a design and the present state of the model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property, partial
from typing import overload

import numpy as np
import numpy.typing as npt

from fitting.drive import expected_sign
from fitting.effects.base import DriveView, Ranges
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
    starts = _recording_starts(design)
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

    starts = _recording_starts(design)
    loaded = tuple(sorted({design.segments[i].recording for i in fitted if design.segments[i].loaded}))
    views = []
    for index in count:
        segment = design.segments[index]
        views.append(
            tuple(
                DriveView(
                    machine=design.machine,
                    joint=joint,
                    segment=segment,
                    bank=design.bank,
                    noise=design.noise,
                    forces=forces[index],
                    loads=loads[index],
                    rod_pressures=partial(rod_pressures, index),
                    ranges=ranges,
                    clock=segment.t - starts[segment.recording],
                    base=design.parameters.base,
                    base_values=theta[base],
                    loaded_recordings=loaded,
                )
                for joint in range(joints)
            )
        )
    return tuple(views)


def _recording_starts(design: Design) -> dict[int, float]:
    starts: dict[int, float] = {}
    for segment in design.segments:
        starts[segment.recording] = min(starts.get(segment.recording, np.inf), float(segment.t[0]))
    return starts


def _rod_pressures(design: Design, fitted: Sequence[int], forces: Sequence[FloatArray]) -> list[FloatArray]:
    """Rod pressures as a smooth function of motion, model force and time, (N, n) per segment.

    A measured pressure holds the very disturbance that a regressor must not know (which chamber takes it up depends on
    the valve). So the pressure is replaced by its regression on signals that do not hold it: an instrument.
    """
    rods = [np.full_like(force, np.nan) for force in forces]
    starts = _recording_starts(design)
    for joint in range(len(design.machine.joints)):
        if any(np.isnan(design.segments[i].p2[0, joint]) for i in fitted):
            continue

        def signals(index: int, joint: int = joint) -> FloatArray:
            segment = design.segments[index]
            v, force = segment.v[:, joint], forces[index][:, joint]
            clock = segment.t - starts[segment.recording]
            return np.column_stack([v, force, segment.x[:, joint], segment.a[:, joint], clock])

        together = np.concatenate([signals(i) for i in fitted])
        knots = [spline_knots(column, 6) for column in together.T]
        noise = design.noise[joint].speed

        def basis(values: FloatArray, knots: list[FloatArray] = knots, noise: float = noise) -> FloatArray:
            parts = [evaluate(k, column) for k, column in zip(knots, values.T, strict=True)]
            sign = expected_sign(values[:, 0], noise)
            return np.hstack([*parts, sign[:, None], sign[:, None] * values[:, 1:2]])

        step = max(1, len(together) // 4000)  # a few thousand samples fix thirty coefficients
        measured = np.concatenate([design.segments[i].p2[:, joint] for i in fitted])
        table = basis(together[::step])
        scale = np.maximum(np.abs(table).max(axis=0), 1e-12)
        coefficients = np.linalg.lstsq(table / scale, measured[::step], rcond=1e-8)[0] / scale
        for index in range(len(design.segments)):
            rods[index][:, joint] = basis(signals(index)) @ coefficients
    return rods
