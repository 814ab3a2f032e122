"""Where a value that was called frozen began to stand still, known when the recording is whole.

Live detection needs a while, so the first equal values of a sensor that hangs are called fresh. In a finished recording
they are marked as well: every value equal to the one before it, back to the last change. The first value of such a run
was a measurement, and stays one.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from daq.quality import Quality


def backdated(table: pa.Table, names: Sequence[str]) -> tuple[pa.Table, dict[str, int]]:
    """The table of a recording with frozen values marked from their beginning, and how many more that is per channel.

    Parameters
    ----------
    table : with a column ``<name>`` and ``<name>.quality`` for each of ``names``
    """
    added: dict[str, int] = {}
    for name in names:
        index = table.schema.get_field_index(f"{name}.quality")
        quality = table.column(index).to_numpy().copy()
        marked = _mark(table.column(name).to_numpy(), quality)
        if marked:
            added[name] = marked
            field = table.schema.field(index)
            table = table.set_column(index, field, pa.array(quality, type=field.type))
    return table, added


def _mark(values: npt.NDArray[np.float64], quality: npt.NDArray[np.integer]) -> int:
    """Mark one channel, in place; how many."""
    frozen = quality == Quality.FROZEN
    count = 0
    for start in np.flatnonzero(frozen & ~np.concatenate(([False], frozen[:-1]))):
        row = int(start) - 1
        while row > 0 and quality[row] == Quality.FRESH and values[row] == values[start] == values[row - 1]:
            quality[row] = Quality.FROZEN
            count += 1
            row -= 1
    return count
