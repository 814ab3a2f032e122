"""Room on the disk: recordings end before the database has none left."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

from daq.messages import Sentence
from server.platform.errors import ConflictError

#: Free bytes that recordings and uploads leave to the database, beyond what sealing the running ones takes.
RESERVE_BYTES = 256 * 2**20
Free = Callable[[], int]


def free_bytes(recordings: Path) -> int:
    """Count free bytes below ``recordings``, after what sealing its journals will take."""
    sizes = 0
    for journal in recordings.glob("*.journal"):
        try:
            sizes += journal.stat().st_size
        except FileNotFoundError:  # it was sealed meanwhile
            continue
    return shutil.disk_usage(recordings).free - sizes


def require_room(free: int, needed: int = 0) -> None:
    """Refuse what fills the disk.

    Parameters
    ----------
    needed : bytes that it will take, as far as that is known

    Raises
    ------
    ConflictError
        If not more than :data:`RESERVE_BYTES` would be free.
    """
    if free - needed <= RESERVE_BYTES:
        raise ConflictError(
            Sentence(
                "server.disk_full_mib_free",
                free=max(free, 0) // 2**20,
                needed=needed // 2**20,
                reserve_bytes=RESERVE_BYTES // 2**20,
            )
        )
