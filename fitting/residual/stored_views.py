"""Views and effect columns of long recordings: made segment by segment, and kept in a scratch file.

They stand for what :func:`fitting.residual.views.build_views` and :func:`fitting.residual.terms.extra_columns` have in
memory. Ranges, and times since a recording's first sample, are those of all segments together.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property, partial
from typing import overload

import numpy as np

from daq.scratch import Place, Scratch
from fitting.arrays import FloatArray
from fitting.effects.base import DriveView, Ranges
from fitting.regression.design import Design, Extra
from fitting.regression.stored import in_memory
from fitting.residual.views import RodLaw, recording_starts, rod_laws, rod_pressures, views_of_segment

#: Samples that rod pressures are learnt from: thirty coefficients a joint.
_LEARNT = 40_000


class StoredViews(Sequence[tuple[DriveView, ...]]):
    """Views of all segments of a stored design; those of one segment are in memory, the one asked for last."""

    def __init__(self, design: Design, theta: FloatArray, fitted: Sequence[int], extra: Extra | None = None) -> None:
        self._design, self._theta, self._fitted = design, theta, tuple(fitted)
        self._starts = recording_starts(design)
        self._loaded = tuple(sorted({design.segments[i].recording for i in fitted if design.segments[i].loaded}))
        self._scratch = Scratch()
        self._last: tuple[int, tuple[DriveView, ...]] | None = None
        self._forces: list[Place] = []
        self._loads: list[Place] = []
        seen: list[_Seen] = []
        for index in range(len(design.segments)):
            forces, loads = self._model_forces(index, extra)
            self._forces.append(self._scratch.put(forces))
            self._loads.append(self._scratch.put(loads))
            if index in self._fitted:
                seen.append(self._seen(index, forces))
        self._ranges = tuple(_together(seen, joint) for joint in range(len(design.machine.joints)))

    def __len__(self) -> int:
        return len(self._forces)

    @overload
    def __getitem__(self, index: int) -> tuple[DriveView, ...]: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[tuple[DriveView, ...]]: ...

    def __getitem__(self, index: int | slice) -> tuple[DriveView, ...] | Sequence[tuple[DriveView, ...]]:
        if isinstance(index, slice):
            return [self[number] for number in range(*index.indices(len(self)))]
        number = range(len(self))[index]  # an IndexError ends an iteration
        if self._last is None or self._last[0] != number:
            forces = self._force(number)
            views = views_of_segment(
                self._design,
                self._theta,
                in_memory(self._design.segments[number]),
                forces,
                self._scratch.read(self._loads[number]),
                partial(self._rod_pressures, number, forces),
                self._ranges,
                self._starts,
                self._loaded,
            )
            self._last = number, views
        return self._last[1]

    def _force(self, index: int) -> FloatArray:
        return self._scratch.read(self._forces[index])

    def _model_forces(self, index: int, extra: Extra | None) -> tuple[FloatArray, FloatArray]:
        """The model's drive efforts and its loads in a segment, (N, n) each."""
        design, theta = self._design, self._theta
        p, base = len(design.parameters), design.parameters.base_slice.start
        forces, loads = [], []
        for joint in range(len(design.machine.joints)):
            block = design.blocks[joint][index]
            force = block.known + block.force(theta)
            own = None if extra is None else extra.columns[joint][index]
            forces.append(force if own is None else force + own @ theta[p:])
            loads.append(block.force(theta, base))
        return np.column_stack(forces), np.column_stack(loads)

    def _seen(self, index: int, forces: FloatArray) -> _Seen:
        segment = self._design.segments[index]
        x, v, clock = segment.x, np.abs(segment.v), segment.t - self._starts[segment.recording]
        return x.min(axis=0), x.max(axis=0), v.max(axis=0), np.abs(forces).max(axis=0), clock[[0, -1]]

    @cached_property
    def _rods(self) -> dict[bool, tuple[RodLaw | None, ...]]:
        return rod_laws(self._design, self._fitted, self._force, learning_step(self._design, self._fitted))

    def _rod_pressures(self, index: int, forces: FloatArray) -> FloatArray:
        segment = self._design.segments[index]
        return rod_pressures(self._rods, segment, forces, segment.t - self._starts[segment.recording])


def learning_step(design: Design, fitted: Sequence[int]) -> int:
    """Every so many-th sample of a stored design is enough to learn rod pressures from."""
    return max(1, sum(len(design.segments[index]) for index in fitted) // _LEARNT)


#: Least and largest position, largest speed and force (n,), and first and last time (2,) of a segment.
_Seen = tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]


def _together(seen: Sequence[_Seen], joint: int) -> Ranges:
    low, high, speed, force = (np.array([own[k][joint] for own in seen]) for k in range(4))
    times = np.array([own[4] for own in seen])
    return Ranges(
        x=(float(low.min()), float(high.max())),
        v=float(speed.max()),
        force=float(force.max()),
        time=(float(times.min()), float(times.max())),
    )


class StoredColumns(Sequence[FloatArray | None]):
    """Columns (N, k) that effects add to one joint, per segment, in a scratch file; None where they add nothing."""

    def __init__(self, scratch: Scratch, places: Sequence[Place | None]) -> None:
        self._scratch, self._places = scratch, tuple(places)

    def __len__(self) -> int:
        return len(self._places)

    @overload
    def __getitem__(self, index: int) -> FloatArray | None: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[FloatArray | None]: ...

    def __getitem__(self, index: int | slice) -> FloatArray | Sequence[FloatArray | None] | None:
        if isinstance(index, slice):
            return [self[number] for number in range(*index.indices(len(self)))]
        place = self._places[index]
        return None if place is None else self._scratch.read(place)


def stored_columns(
    segments: int, joints: int, made: Callable[[int], Sequence[FloatArray | None]]
) -> tuple[StoredColumns, ...]:
    """Columns of all joints and segments; ``made`` gives those of all joints in one segment."""
    scratch = Scratch()
    table: list[list[Place | None]] = [[] for _ in range(joints)]
    for index in range(segments):
        for row, own in zip(table, made(index), strict=True):
            row.append(None if own is None else scratch.put(own))
    return tuple(StoredColumns(scratch, row) for row in table)
