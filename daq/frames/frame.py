"""One cycle of acquisition: when it was and what every channel said."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from daq.arrays import FlagArray, FloatArray, RowArray
from daq.quality import Quality

__all__ = ["Frame", "Quality", "frame_from_row", "row_dtype", "row_from_frame"]


@dataclass(frozen=True)
class Frame:
    """Measurements of one SYNC; ``n`` channels in the order of the channel table.

    Attributes
    ----------
    cycle : counter of SYNCs; a number that is left out is a cycle that was missed
    monotonic_ns : ns of the monotonic clock when SYNC was sent
    utc_ns : ns since 1970 when SYNC was sent
    time : s of machine time (``cycle / rate_hz``; the wall's seconds unless a simulation runs faster)
    values : (n,) SI; NaN where nothing is known
    ages : (n,) s of machine time between the value's sampling and SYNC; negative when sampled after it; NaN where
        nothing is known
    quality : (n,) :class:`daq.quality.Quality`
    """

    cycle: int
    monotonic_ns: int
    utc_ns: int
    time: float
    values: FloatArray
    ages: FloatArray
    quality: FlagArray


@lru_cache(maxsize=64)
def row_dtype(channels: int) -> np.dtype[np.void]:
    """Return the layout of a frame of so many channels as a ring buffer row (packed, native byte order)."""
    return np.dtype(
        [
            ("cycle", np.int64),
            ("monotonic_ns", np.int64),
            ("utc_ns", np.int64),
            ("time", np.float64),
            ("values", np.float64, (channels,)),
            ("ages", np.float64, (channels,)),
            ("quality", np.uint8, (channels,)),
        ]
    )


def row_from_frame(frame: Frame) -> RowArray:
    """Convert the frame to an array of shape (1,) of :func:`row_dtype`."""
    row = np.empty(1, dtype=row_dtype(len(frame.values)))
    row["cycle"], row["monotonic_ns"], row["utc_ns"] = frame.cycle, frame.monotonic_ns, frame.utc_ns
    row["time"] = frame.time
    row["values"], row["ages"], row["quality"] = frame.values, frame.ages, frame.quality
    return row


def frame_from_row(row: np.void) -> Frame:
    """Convert one row of the ring buffer to its frame."""
    return Frame(
        cycle=int(row["cycle"]),
        monotonic_ns=int(row["monotonic_ns"]),
        utc_ns=int(row["utc_ns"]),
        time=float(row["time"]),
        values=np.array(row["values"]),
        ages=np.array(row["ages"]),
        quality=np.array(row["quality"]),
    )
