"""Segments and blocks of long recordings whose arrays lie in a scratch file.

They look like any :class:`fitting.signals.preparation.Segment` and :class:`fitting.regression.design.JointBlock`; an
array is read when it is asked for and belongs to who asked. So what walks through a design segment by segment needs the
memory of one.
"""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np

from daq.scratch import Place, Scratch
from fitting.arrays import FloatArray
from fitting.regression.design import JointBlock, Store
from fitting.signals.filters import FilterBank
from fitting.signals.preparation import Segment

_EFFORT = ("effort_target", "effort_columns")


class _Stored:
    """Reader of arrays of some names from a scratch file, when they are asked for."""

    def __getattr__(self, name: str) -> Any:
        own = self.__dict__
        if name.startswith("_") or name not in own["_places"]:
            raise AttributeError(name)
        return own["_scratch"].read(own["_places"][name])


class StoredSegment(_Stored, Segment):
    """A segment whose arrays are in a scratch file."""

    def __init__(self, segment: Segment, scratch: Scratch) -> None:
        places: dict[str, Place] = {}
        own: dict[str, Any] = {"_scratch": scratch, "_places": places, "_length": len(segment)}
        for item in fields(Segment):
            value = getattr(segment, item.name)
            if isinstance(value, np.ndarray):
                places[item.name] = scratch.put(value)
            else:
                own[item.name] = value
        self.__dict__.update(own)  # the class is frozen

    def __len__(self) -> int:
        return int(self.__dict__["_length"])


def in_memory(segment: Segment) -> Segment:
    """Read the segment's arrays from the file."""
    return Segment(**{item.name: getattr(segment, item.name) for item in fields(Segment)})


class StoredBlock(_Stored, JointBlock):
    """A block whose arrays are in a scratch file, but for which columns and rows are kept."""

    def __init__(self, block: JointBlock, effort: tuple[FloatArray, FloatArray], scratch: Scratch) -> None:
        names = ("target", "known", "own", "reduced_target", "own_reduced")
        arrays = {name: getattr(block, name) for name in names} | dict(zip(_EFFORT, effort, strict=True))
        places = {name: scratch.put(array) for name, array in arrays.items()}
        own = {"_scratch": scratch, "_places": places, "used": block.used, "width": block.width, "keep": block.keep}
        self.__dict__.update(own)  # the class is frozen

    def effort(self, bank: FilterBank, r: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return :meth:`fitting.regression.design.JointBlock.effort`, with the stored lever arm."""
        return self.effort_target, self.effort_columns


def storing(bank: FilterBank, scratch: Scratch) -> Store:
    """Return the store with which :func:`fitting.regression.design.build_design` keeps arrays in a file."""

    def store(segment: Segment, blocks: list[JointBlock]) -> tuple[Segment, list[JointBlock]]:
        r = segment.r
        kept: list[JointBlock] = [StoredBlock(b, b.effort(bank, r[:, j]), scratch) for j, b in enumerate(blocks)]
        return StoredSegment(segment, scratch), kept

    return store
