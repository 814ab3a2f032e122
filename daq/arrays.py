"""Types of arrays: one name for each that functions here take and give."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

FloatArray: TypeAlias = npt.NDArray[np.float64]
BoolArray: TypeAlias = npt.NDArray[np.bool_]
#: Counts, cycles, times in ns.
IntArray: TypeAlias = npt.NDArray[np.int64]
#: Of :class:`daq.quality.Quality`, and what else is a flag of few values.
FlagArray: TypeAlias = npt.NDArray[np.uint8]
#: Rows of a ring buffer (:func:`daq.frames.frame.row_dtype`).
RowArray: TypeAlias = npt.NDArray[np.void]
