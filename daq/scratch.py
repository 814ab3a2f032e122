"""Arrays that are too large to keep in memory, in an unnamed file of the directory for temporary files.

Arrays are put in once and read whenever they are asked for; what was read belongs to the reader. The file has no name,
so nothing is left behind, whatever ends the process. ``TMPDIR`` says which directory.
"""

from __future__ import annotations

import os
import tempfile
import weakref
from collections.abc import Iterator, MutableMapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from daq.errors import InputError

K = TypeVar("K")


@dataclass(frozen=True)
class Place:
    """Where an array lies in a :class:`Scratch`."""

    offset: int
    shape: tuple[int, ...]
    dtype: np.dtype[Any]

    @property
    def row_bytes(self) -> int:
        """Bytes of one row."""
        return self.dtype.itemsize * int(np.prod(self.shape[1:], dtype=np.int64))


class Scratch:
    """A file of arrays, gone with the object."""

    def __init__(self) -> None:
        handle, name = tempfile.mkstemp(prefix="hilfit-")
        Path(name).unlink()
        self._handle, self._end = handle, 0
        weakref.finalize(self, os.close, handle)

    def room(self, shape: tuple[int, ...], dtype: npt.DTypeLike) -> Place:
        """Make room for an array; what is not written there reads as zero."""
        place = Place(self._end, shape, np.dtype(dtype))
        self._end += place.row_bytes * shape[0]
        return place

    def put(self, array: npt.NDArray[Any]) -> Place:
        """Keep an array."""
        place = self.room(array.shape, array.dtype)
        self.write(place, array)
        return place

    def write(self, place: Place, values: npt.NDArray[Any], start: int = 0) -> None:
        """Write rows from ``start`` on of what lies at a place.

        Raises
        ------
        InputError
            If the disk is full.
        """
        array = np.ascontiguousarray(values, dtype=place.dtype)
        rest = array.reshape(-1).view(np.uint8).data
        offset = place.offset + start * place.row_bytes
        try:
            while len(rest):
                done = os.pwrite(self._handle, rest, offset)
                rest, offset = rest[done:], offset + done
        except OSError as error:
            raise InputError("daq.no_scratch_room", tempfile=tempfile.gettempdir(), reason=error.strerror) from None

    def read(self, place: Place, rows: slice = slice(None)) -> npt.NDArray[Any]:
        """Copy the rows of an array (without a step)."""
        start, stop, _ = rows.indices(place.shape[0])
        out = np.zeros((max(0, stop - start), *place.shape[1:]), dtype=place.dtype)
        rest = out.reshape(-1).view(np.uint8).data
        offset = place.offset + start * place.row_bytes
        while len(rest):
            done = os.preadv(self._handle, [rest], offset)
            if not done:  # room that nothing was written to
                break
            rest, offset = rest[done:], offset + done
        return out


class _Kept(MutableMapping[K, npt.NDArray[Any]]):
    """Arrays in a scratch file; each look reads one. What is put in place of one of its shape takes its room."""

    def __init__(self, scratch: Scratch) -> None:
        self.scratch = scratch
        self._places: dict[K, Place] = {}

    def __getitem__(self, key: K) -> npt.NDArray[Any]:
        return self.scratch.read(self._places[key])

    def __setitem__(self, key: K, values: npt.NDArray[Any]) -> None:
        place = self._places.get(key)
        if place is not None and place.shape == values.shape and place.dtype == values.dtype:
            self.scratch.write(place, values)
        else:
            self._places[key] = self.scratch.put(values)

    def __delitem__(self, key: K) -> None:
        del self._places[key]

    def __iter__(self) -> Iterator[K]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)

    def __contains__(self, key: object) -> bool:
        return key in self._places


class ScratchColumns(_Kept[str]):
    """Named columns in a scratch file."""

    def __getitem__(self, name: str) -> npt.NDArray[Any]:
        values = super().__getitem__(name)
        values.flags.writeable = False
        return values

    def reserve(self, name: str, rows: int, dtype: npt.DTypeLike) -> Place:
        """Reserve room for a column that is written bit by bit."""
        self._places[name] = self.scratch.room((rows,), dtype)
        return self._places[name]

    def cut(self, part: slice) -> dict[str, npt.NDArray[Any]]:
        """Cut some rows of all columns, in memory."""
        return {name: self.scratch.read(place, part) for name, place in self._places.items()}


class ScratchArrays(_Kept[int | None]):
    """Arrays by number in a scratch file of their own."""

    def __init__(self) -> None:
        super().__init__(Scratch())

    def rows(self, key: int | None, rows: slice) -> npt.NDArray[Any]:
        """Copy some rows of an array."""
        return self.scratch.read(self._places[key], rows)

    def put_rows(self, key: int | None, start: int, values: npt.NDArray[Any]) -> None:
        """Put rows in the place of those from ``start`` on."""
        self.scratch.write(self._places[key], values, start)
