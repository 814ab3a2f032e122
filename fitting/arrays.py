"""Types of arrays: one name for each that functions here take and give."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

FloatArray: TypeAlias = npt.NDArray[np.float64]
BoolArray: TypeAlias = npt.NDArray[np.bool_]
#: Numbers of rows or columns.
IntArray: TypeAlias = npt.NDArray[np.intp]
