"""Wire encodings against bytes worked out by hand and by round trip."""

from __future__ import annotations

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from daq import wire

INTEGERS = {"int8": (-128, 127), "uint8": (0, 255), "int16": (-32768, 32767), "uint16": (0, 65535)}
INTEGERS |= {"int32": (-(2**31), 2**31 - 1), "uint32": (0, 2**32 - 1)}


def test_numbers_are_encoded_as_bytes_written_out_by_hand() -> None:
    assert wire.encode("uint32", 0x01020304) == b"\x04\x03\x02\x01"  # CiA 301: least significant byte first
    assert wire.encode("int16", -2) == b"\xfe\xff"
    assert wire.encode("float32", 1.0) == b"\x00\x00\x80\x3f"
    assert wire.to_registers("float32", 1.0) == [0x3F80, 0x0000]
    assert wire.to_registers("float32", 1.0, "little") == [0x0000, 0x3F80]
    assert wire.to_registers("uint32", 0x01020304) == [0x0102, 0x0304]
    assert wire.to_registers("int8", -1) == [0xFFFF]
    assert [wire.registers(kind) for kind in ("uint8", "int16", "float32", "float64")] == [1, 1, 2, 4]


@given(data=st.data(), kind=st.sampled_from(sorted(INTEGERS)), order=st.sampled_from(["big", "little"]))
def test_integers_survive(data: st.DataObject, kind: str, order: str) -> None:
    value = data.draw(st.integers(*INTEGERS[kind]))
    assert wire.decode(kind, wire.encode(kind, value)) == value
    assert wire.from_registers(kind, wire.to_registers(kind, value, order), order) == value


@given(value=st.floats(width=32, allow_nan=False), order=st.sampled_from(["big", "little"]))
def test_floats_survive(value: float, order: str) -> None:
    assert wire.from_registers("float32", wire.to_registers("float32", value, order), order) == value


def test_integers_saturate() -> None:
    assert wire.decode("int16", wire.encode("int16", 1e9)) == 32767
    assert wire.decode("uint8", wire.encode("uint8", -5)) == 0
    assert wire.decode("int8", wire.encode("int8", math.nan)) == -128


def test_the_length_has_to_be_exact() -> None:
    with pytest.raises(struct.error):
        wire.decode("uint32", b"\0\0\0")
