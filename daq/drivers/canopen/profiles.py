"""Measurements of a CANopen device by its profile: CiA 404 (transducers), 406 (encoders), 410 (inclinometers).

The low half of the device type (0x1000) is the profile's number. A few objects say how a value is scaled; they are
read by SDO, as is its identity, when the node runs, so that nothing waits for it; nothing is ever written. What they
hold becomes a source.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from daq.drivers.canopen.link import Sdo, SdoRefusedError

Objects = Mapping[tuple[int, int], int]

NAMES = {
    401: "inputs and outputs (CiA 401)",
    404: "transducer (CiA 404)",
    406: "encoder (CiA 406)",
    410: "inclinometer (CiA 410)",
}
#: 0x6131 (CiA 303-2): prefix, numerator and denominator in a byte each; the unit's name here.
PRESSURE_UNITS = {
    0x004E0000: "bar",
    0x00220000: "Pa",
    0x03220000: "kPa",
    0x06220000: "MPa",
    0xFD4E0000: "mbar",
}
TEMPERATURE_UNITS = {0x002D0000: "degC", 0x00050000: "K"}
UNITS = PRESSURE_UNITS | TEMPERATURE_UNITS
#: Objects that are worth asking for, by profile.
ASKED = {
    404: tuple((index, channel) for channel in (1, 2) for index in (0x6131, 0x6132, 0x61A1)),
    406: ((0x6001, 0), (0x6002, 0), (0x6003, 0), (0x6005, 1), (0x6501, 0), (0x6502, 0)),
    410: ((0x6000, 0),),
}
_TWO_TO_THE = 2**32


@dataclass(frozen=True)
class Measured:
    """A value that a device has to offer.

    Attributes
    ----------
    index, subindex, data_type : of its object
    unit : of a value, "" where it is not known
    scale : value = scale * raw
    kind : ``angle``, ``length``, ``pressure``, ``temperature``, ``tilt`` or ``value``
    more : further keys of a source
    """

    index: int
    subindex: int
    data_type: str
    unit: str
    scale: float
    kind: str
    more: Mapping[str, Any] = field(default_factory=dict)


def profile_of(device_type: int) -> int:
    """Return the number of the profile; 0 for none."""
    return device_type & 0xFFFF


def profile_name(device_type: int) -> str:
    """Return its own name, in words."""
    number = profile_of(device_type)
    return NAMES.get(number, f"CiA {number}" if number else "no profile")


def measured(device_type: int, objects: Objects) -> list[Measured]:
    """Return what a device measures, as far as its profile defines it.

    Parameters
    ----------
    objects : those of :data:`ASKED` that it has; also process values themselves, which show that they are there
    """
    number = profile_of(device_type)
    if number == 404:
        return [_transducer(channel, objects) for channel in (1, 2) if (0x6131, channel) in objects]
    if number == 406:
        return _encoder(objects)
    if number == 410:
        step = 0.001 * objects.get((0x6000, 0), 10)
        return [Measured(index, 0, "int16", "deg", step, "tilt") for index in (0x6010, 0x6020)]
    return []


def _transducer(channel: int, objects: Objects) -> Measured:
    unit = UNITS.get(objects[0x6131, channel], "")
    kind = "temperature" if unit in TEMPERATURE_UNITS.values() else "pressure" if unit else "value"
    return Measured(0x6130, channel, "float32", unit, 1.0, kind)


def _encoder(objects: Objects) -> list[Measured]:
    if (0x6005, 1) in objects:  # steps of 1 nm, CiA 406
        return [Measured(0x6020, 1, "int32", "mm", 1e-6 * objects[0x6005, 1], "length")]
    steps = objects.get((0x6001, 0)) or objects.get((0x6501, 0))
    if not steps:
        return [Measured(0x6004, 0, "uint32", "", 1.0, "value")]
    whole = objects.get((0x6002, 0)) or steps
    more = {} if whole >= _TWO_TO_THE else {"modulo": whole}
    return [Measured(0x6004, 0, "uint32", "rad", 2 * math.pi / steps, "angle", more)]


DEVICE_TYPE = "0x1000:0"
TEXTS = ((0x1008, 0), (0x1009, 0), (0x100A, 0))  # name, hardware, firmware (CiA 301, 7.5.2)
NUMBERS = ((0x1018, 1), (0x1018, 2), (0x1018, 3), (0x1018, 4))  # vendor, product, revision, serial number
LONGEST = 60  # characters of a text

DeviceObjects = dict[str, int | str]


def _key(index: int, subindex: int) -> str:
    """Write an object as ``0x1018:4``."""
    return f"0x{index:04X}:{subindex}"


def ask(sdo: Sdo) -> DeviceObjects:
    """Ask for objects that the node has, by :func:`_key`: numbers, texts of at most 60 characters.

    Raises
    ------
    CommissioningError
        If it stops answering.
    """
    found: DeviceObjects = {}
    for asked in ((0x1000, 0), *NUMBERS):
        _ask(sdo, asked, found)
    for asked in ASKED.get(profile_of(int(found.get(DEVICE_TYPE, 0))), ()):
        _ask(sdo, asked, found)
    for index, subindex in TEXTS:
        with contextlib.suppress(SdoRefusedError):
            text = sdo.read(index, subindex).rstrip(b"\0 ").decode("latin-1")
            found[_key(index, subindex)] = "".join(c for c in text if c.isprintable())[:LONGEST]
    return found


def _ask(sdo: Sdo, place: tuple[int, int], found: DeviceObjects) -> None:
    with contextlib.suppress(SdoRefusedError):
        found[_key(*place)] = sdo.read_unsigned(*place)
