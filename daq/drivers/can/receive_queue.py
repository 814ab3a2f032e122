"""The kernel's queue of a SocketCAN interface.

It keeps frames until they are read. By default it holds some hundred frames, and what comes beyond is
lost without a word: a thread that is kept from running for a tenth of a second on a busy bus is enough.
"""

from __future__ import annotations

import contextlib
import socket
import struct
from typing import Any

QUEUE_BYTES = 8 << 20  # some thousand frames, each with its bookkeeping of about a kilobyte: a second of a full bus
_RCVBUFFORCE = 33  # asm-generic/socket.h: beyond net.core.rmem_max, for who may administer the network
_MEMINFO = 55  # asm-generic/socket.h
_DROPS = 8  # linux/sock_diag.h: SK_MEMINFO_DROPS, of unsigned 32-bit numbers


def _of(bus: Any) -> socket.socket | None:
    found = getattr(bus, "socket", None)
    family = getattr(socket, "AF_CAN", None)
    return found if isinstance(found, socket.socket) and found.family == family else None


def lengthen(bus: Any) -> None:
    """Let the kernel keep more frames for a python-can bus, as many as it lets us."""
    queue = _of(bus)
    if queue is None:
        return
    for option in (socket.SO_RCVBUF, _RCVBUFFORCE):
        with contextlib.suppress(OSError):
            queue.setsockopt(socket.SOL_SOCKET, option, QUEUE_BYTES)


def lost_frames(bus: Any) -> int:
    """Frames that the kernel had no room for since the bus was opened; 0 where nobody tells.

    Raises
    ------
    OSError
        If it is closed.
    """
    queue = _of(bus)
    if queue is None:
        return 0
    content = queue.getsockopt(socket.SOL_SOCKET, _MEMINFO, 4 * (_DROPS + 1))
    return int(struct.unpack_from("=I", content, 4 * _DROPS)[0]) if len(content) > 4 * _DROPS else 0
