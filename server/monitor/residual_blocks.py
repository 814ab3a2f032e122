"""Rows of a ring buffer, cut into windows: each block of new samples, with those before it that filters need."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from daq.arrays import FloatArray, RowArray
from daq.quality import MEASURED


class Windows:
    """Collects rows and gives a window for every ``block`` new ones.

    Parameters
    ----------
    overlap, block : samples; a window has both
    """

    def __init__(self, overlap: int, block: int) -> None:
        self._length = overlap + block
        self._block = block
        self._rows: RowArray | None = None

    def push(self, rows: RowArray, missed: int = 0) -> Iterator[RowArray]:
        """Yield the windows that are complete with these rows; ``missed`` rows were lost before them."""
        if missed or self._rows is None:
            self._rows = rows[:0]
        self._rows = np.concatenate([self._rows, rows])
        while len(self._rows) >= self._length:
            yield self._rows[: self._length]
            self._rows = self._rows[self._block :]


def measured(rows: RowArray, names: tuple[str, ...]) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Return time and SI values by channel; NaN where not measured in its cycle, as a recording has it."""
    values = np.where(np.isin(rows["quality"], [int(q) for q in MEASURED]), rows["values"], np.nan)
    return np.ascontiguousarray(rows["time"]), {name: values[:, index] for index, name in enumerate(names)}
