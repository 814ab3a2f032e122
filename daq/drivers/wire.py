"""Wire encodings: how one number looks in a CANopen object (little endian) and in Modbus registers."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence

_FORMATS: dict[str, str] = {
    "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int24": "3s", "uint24": "3s", "int32": "i", "uint32": "I",
    "int64": "q", "uint64": "Q", "float32": "f", "float64": "d",
}  # fmt: skip


def struct_code(data_type: str) -> str:
    """Return the letter of :mod:`struct` for ``data_type``."""
    return _FORMATS[data_type]


def size(data_type: str) -> int:
    """Return the bytes of one value of ``data_type``."""
    return struct.calcsize(_FORMATS[data_type])


def registers(data_type: str) -> int:
    """Return the number of 16-bit Modbus registers of one ``data_type`` value."""
    return (size(data_type) + 1) // 2


def encode(data_type: str, value: float) -> bytes:
    """Encode for CANopen, little endian; integers are rounded and saturate at their type's ends."""
    if data_type.startswith("float"):
        return struct.pack("<" + _FORMATS[data_type], value)
    bits = 8 * size(data_type)
    low, high = (0, 2**bits - 1) if data_type.startswith("u") else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    raw = low if math.isnan(value) else int(min(max(round(value), low), high))
    return raw.to_bytes(size(data_type), "little", signed=low < 0)


def decode(data_type: str, data: bytes) -> float:
    """Decode the number in ``data`` (little endian); the length must be exact (else struct.error)."""
    return number(data_type, struct.unpack("<" + _FORMATS[data_type], data)[0])


def number(data_type: str, unpacked: float | bytes) -> float:
    """Convert what :mod:`struct` made by :func:`struct_code`; it knows no 24-bit integers."""
    if isinstance(unpacked, bytes):
        return float(int.from_bytes(unpacked, "little", signed=not data_type.startswith("u")))
    return float(unpacked)


def from_bits(data_type: str, data: bytes, bit: int, bits: int) -> float:
    """Decode ``bits`` bits of ``data`` from ``bit`` on (CANopen's order); ValueError if ``data`` ends before."""
    if 8 * len(data) < bit + bits:
        raise ValueError("too few bytes")
    field = int.from_bytes(data, "little") >> bit & (1 << bits) - 1
    if not data_type.startswith("u") and not data_type.startswith("float") and field >> bits - 1:
        field -= 1 << bits
    if data_type.startswith("float"):
        return decode(data_type, field.to_bytes(bits // 8, "little"))
    return float(field)


def from_registers(data_type: str, words: list[int], word_order: str = "big", byte_order: str = "big") -> float:
    """Decode the number in Modbus registers, as many words as :func:`registers`."""
    if byte_order == "little":  # within each register
        words = [(word & 0xFF) << 8 | word >> 8 for word in words]
    ordered = words if word_order == "little" else words[::-1]
    data = b"".join(word.to_bytes(2, "little") for word in ordered)
    return decode(data_type, data[: size(data_type)])


MOST_DECIMALS = 9


class Decimals:
    """Decimals of one channel, once its device has sent them (CiA 404: 0x6132; a register of many transmitters).

    Parameters
    ----------
    sentinels : raw values, before decimals, that mean "no valid measurement"
    """

    def __init__(self, sentinels: Sequence[float]) -> None:
        self._sentinels = frozenset(sentinels)
        self._factor = math.nan

    @property
    def known(self) -> bool:
        """True once the device has sent them."""
        return not math.isnan(self._factor)

    def learn(self, places: int) -> bool:
        """Take the device's decimals; return False if they cannot be."""
        self._factor = 10.0**-places if 0 <= places <= MOST_DECIMALS else math.nan
        return self.known

    def forget(self) -> None:
        """Forget them: they may be others when the device is back."""
        self._factor = math.nan

    def value(self, raw: float) -> float:
        """Scale a raw value by its decimals; NaN for a sentinel, or while they are unknown."""
        return math.nan if raw in self._sentinels else raw * self._factor
