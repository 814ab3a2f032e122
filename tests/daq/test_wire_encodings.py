"""Wire encodings against bytes worked out by hand and by round trip."""

from __future__ import annotations

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from daq.drivers import wire

INTEGERS = {"int8": (-128, 127), "uint8": (0, 255), "int16": (-32768, 32767), "uint16": (0, 65535)}
INTEGERS |= {"int32": (-(2**31), 2**31 - 1), "uint32": (0, 2**32 - 1)}


def words(big_endian: bytes, order: str = "big") -> list[int]:
    """Registers as the Modbus application protocol (4.2) has them on the wire."""
    found = list(struct.unpack(f">{len(big_endian) // 2}H", big_endian))
    return found if order == "big" else found[::-1]


def test_numbers_are_encoded_as_bytes_written_out_by_hand() -> None:
    assert wire.encode("uint32", 0x01020304) == b"\x04\x03\x02\x01"  # CiA 301: least significant byte first
    assert wire.encode("int16", -2) == b"\xfe\xff"
    assert wire.encode("float32", 1.0) == b"\x00\x00\x80\x3f"
    assert wire.from_registers("float32", [0x3F80, 0x0000]) == 1.0
    assert wire.from_registers("float32", [0x0000, 0x3F80], "little") == 1.0
    assert wire.from_registers("uint32", [0x0102, 0x0304]) == 0x01020304
    assert wire.from_registers("int8", [0xFFFF]) == -1
    assert [wire.registers(kind) for kind in ("uint8", "int16", "float32", "float64")] == [1, 1, 2, 4]


@given(data=st.data(), kind=st.sampled_from(sorted(INTEGERS)), order=st.sampled_from(["big", "little"]))
def test_integers_survive(data: st.DataObject, kind: str, order: str) -> None:
    value = data.draw(st.integers(*INTEGERS[kind]))
    assert wire.decode(kind, wire.encode(kind, value)) == value
    sent = words(value.to_bytes(2 * wire.registers(kind), "big", signed=value < 0), order)
    assert wire.from_registers(kind, sent, order) == value


@given(value=st.floats(width=32, allow_nan=False), order=st.sampled_from(["big", "little"]))
def test_floats_survive(value: float, order: str) -> None:
    assert wire.from_registers("float32", words(struct.pack(">f", value), order), order) == value


def test_integers_saturate() -> None:
    assert wire.decode("int16", wire.encode("int16", 1e9)) == 32767
    assert wire.decode("uint8", wire.encode("uint8", -5)) == 0
    assert wire.decode("int8", wire.encode("int8", math.nan)) == -128


def test_the_length_has_to_be_exact() -> None:
    with pytest.raises(struct.error):
        wire.decode("uint32", b"\0\0\0")
