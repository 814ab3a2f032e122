"""Between the processes of a simulated machine: packets over socket pairs that the parent made.

``hub <-> plant``     ``STEP`` asks for the next period, ``STATE`` answers with it (also once at power-on)
``hub  -> nodes``     ``STATE`` at power-on, ``SYNC`` with the state to latch, ``FRAME`` for anything else on the bus
``nodes -> hub``      ``TEXT``: frames ready for socketcand clients
``modbus <-> hub``    ``BARRIER`` asks the hub to work off what clients have sent; ``STATE`` answers

A state is one float64 per channel in SI units, in the machine file's order, after 8 bytes of cycle number.
"""

from __future__ import annotations

import socket
import struct

STEP, STATE, SYNC, FRAME, TEXT, BARRIER = (bytes([kind]) for kind in range(1, 7))

CYCLE = struct.Struct("<q")
FRAME_HEAD = struct.Struct("<IB")  # identifier (bit 31: extended), length
PACKET = 1 << 16


def pair() -> tuple[socket.socket, socket.socket]:
    """Make two ends of a packet connection; both survive into child processes."""
    ends = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    for end in ends:
        end.set_inheritable(True)
    return ends


def adopt(descriptor: int) -> socket.socket:
    """Adopt the inherited end."""
    return socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET, fileno=descriptor)


def pack_state(cycle: int, values: bytes) -> bytes:
    """Pack the payload of a state packet."""
    return CYCLE.pack(cycle) + values


def unpack_state(payload: bytes) -> tuple[int, tuple[float, ...]]:
    """Unpack cycle and values of a state packet's payload."""
    count = (len(payload) - CYCLE.size) // 8
    return CYCLE.unpack_from(payload)[0], struct.unpack_from(f"<{count}d", payload, CYCLE.size)
