"""Size that a compressed file declares, before a byte of it is unpacked.

A few kilobytes of Parquet or MAT can unpack to gigabytes. What a recording holds is in its header; one that says a
hundred times its size, and more than a recording of hours has, is none.
"""

from __future__ import annotations

import math
from pathlib import Path

from daq.errors import InputError, RecordingError

#: Bytes in memory up to which nobody asks, and how many times the size of the file is too much beyond that.
ALWAYS, RATIO = 256 * 2**20, 100
_VALUE_BYTES = 8


def refuse_bombs(path: Path, shown: str) -> None:
    """Raise InputError, in one line, if a file declares that it unpacks to much more than a recording does."""
    declared = _declared(path)
    if declared > max(ALWAYS, RATIO * path.stat().st_size):
        raise RecordingError(
            "server.says_unpacks_mib_times",
            shown=shown,
            declared=declared / 2**20,
            declared_2=declared // path.stat().st_size,
        )


def _declared(path: Path) -> int:
    """Read the declared size in memory, bytes; 0 without one: the file's reader reports what is wrong."""
    try:
        if path.suffix == ".parquet":
            import pyarrow.parquet

            found = pyarrow.parquet.read_metadata(path)
            packed = sum(found.row_group(group).total_byte_size for group in range(found.num_row_groups))
            return int(max(packed, found.num_rows * found.num_columns * _VALUE_BYTES))
        if path.suffix == ".mat":
            from scipy.io import whosmat

            return sum(math.prod(shape) for _, shape, _ in whosmat(path)) * _VALUE_BYTES
    except (InputError, OSError, ValueError, TypeError, KeyError, NotImplementedError, MemoryError):
        pass
    return 0
