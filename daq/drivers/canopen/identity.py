"""What a CANopen node says of itself, asked in service: identity, and objects that say how its values are scaled.

Read by SDO when the node runs, so that nothing waits for it; nothing is ever written.
"""

from __future__ import annotations

import contextlib

from daq.drivers.canopen.link import Sdo, SdoRefusedError
from daq.drivers.canopen.profiles import ASKED, profile_of

DEVICE_TYPE = "0x1000:0"
TEXTS = ((0x1008, 0), (0x1009, 0), (0x100A, 0))  # name, hardware, firmware (CiA 301, 7.5.2)
NUMBERS = ((0x1018, 1), (0x1018, 2), (0x1018, 3), (0x1018, 4))  # vendor, product, revision, serial number
LONGEST = 60  # characters of a text

Told = dict[str, int | str]


def key(index: int, subindex: int) -> str:
    """How an object is called: ``0x1018:4``."""
    return f"0x{index:04X}:{subindex}"


def ask(sdo: Sdo) -> Told:
    """Objects that the node has, by :func:`key`: numbers, and texts of at most 60 characters.

    Raises
    ------
    CommissioningError
        If it stops answering.
    """
    found: Told = {}
    for asked in ((0x1000, 0), *NUMBERS):
        _ask(sdo, asked, found)
    for asked in ASKED.get(profile_of(int(found.get(DEVICE_TYPE, 0))), ()):
        _ask(sdo, asked, found)
    for index, subindex in TEXTS:
        with contextlib.suppress(SdoRefusedError):
            text = sdo.read(index, subindex).rstrip(b"\0 ").decode("latin-1")
            found[key(index, subindex)] = "".join(c for c in text if c.isprintable())[:LONGEST]
    return found


def _ask(sdo: Sdo, place: tuple[int, int], found: Told) -> None:
    with contextlib.suppress(SdoRefusedError):
        found[key(*place)] = sdo.read_unsigned(*place)
