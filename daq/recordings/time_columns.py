"""The column of time, whatever it counts: seconds, another unit, time since 1970, or moments as ISO 8601 writes them.

What comes out is seconds in float64. Moments become relative to the first row, exactly: seconds since 1970 in float64
are only good to 0.2 microseconds, which is enough, but differences of whole nanoseconds are exact.
"""

from __future__ import annotations

import re
from datetime import UTC, datetime
from typing import Any

import numpy as np
import numpy.typing as npt

from daq.arrays import FloatArray
from daq.errors import BadValueError
from daq.units import conversion

_MOMENT = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d([.,]\d{1,9})?)?\s?(Z|UTC|[+-]\d\d:?\d\d)?", re.IGNORECASE)
#: Seconds since 1970 that a recording's clock may show: 1973 to 2096. In ms, us and ns these do not overlap.
_EPOCH_S = (1e8, 4e9)
_EPOCH_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


def looks_like_moment(text: str) -> bool:
    """Return whether a text is a moment by ISO 8601, with a date."""
    return _MOMENT.fullmatch(text.strip()) is not None


def seconds(values: npt.NDArray[Any], unit: str | None) -> FloatArray:
    """Convert a column of time to seconds; moments relative to the first row, all else as it counts.

    Parameters
    ----------
    values : (N,) numbers, or texts like ``2026-03-02T09:14:05.020Z``
    unit : what the numbers count; None where undeclared: seconds then, or of moments since 1970 whatever
        makes them lie between 1973 and 2096

    Raises
    ------
    ValueError
        What is wrong and what to do, without the column's name.
    """
    if values.dtype.kind not in "iuf":
        return _moments(values)
    known = values[np.isfinite(values)]
    if len(known) == 0:
        return np.asarray(values, dtype=np.float64)
    first = float(known[0])
    if unit is None:
        fits = [u for u, factor in _EPOCH_UNITS.items() if _EPOCH_S[0] <= first * factor <= _EPOCH_S[1]]
        if not fits:
            return np.asarray(values, dtype=np.float64)
        unit = fits[0]
    factor = conversion(unit, "s").factor
    if not _EPOCH_S[0] <= first * factor <= _EPOCH_S[1]:
        return np.asarray(values, dtype=np.float64) * factor
    return np.asarray(values - known[0], dtype=np.float64) * factor


def _moments(values: npt.NDArray[Any]) -> FloatArray:
    stamps = np.empty(len(values))
    first: datetime | None = None
    for row, value in enumerate(values.tolist()):
        if value is None:
            stamps[row] = np.nan
            continue
        text = str(value).strip()
        if not looks_like_moment(text):
            raise BadValueError("daq.row_no_moment", text=text[:40], row=row + 1)
        try:
            moment = datetime.fromisoformat(re.sub(r"\s?(Z|UTC)$", "+00:00", text, flags=re.IGNORECASE))
        except ValueError as error:
            raise BadValueError("daq.row_no_moment_correct", text=text[:40], row=row + 1, error=error) from None
        if first is None:
            first = moment
        if (moment.tzinfo is None) != (first.tzinfo is None):
            raise BadValueError("daq.row_time_zone", text=text[:40], row=row + 1)
        stamps[row] = (_zoned(moment) - _zoned(first)).total_seconds()
    return stamps


def _zoned(moment: datetime) -> datetime:
    return moment if moment.tzinfo is not None else moment.replace(tzinfo=UTC)
