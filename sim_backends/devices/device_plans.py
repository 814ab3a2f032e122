"""Plans of simulated devices: what a device process needs to know, and nothing about machine files.

A plan is made of numbers and strings only, so it travels as JSON, and the processes that read it load neither the
machine file's parser nor the physics. Devices hold physical values; ``raw = factor * SI + offset``.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

_FLOATS = {"float32": "f", "float64": "d"}


def _width(data_type: str) -> int:
    """Return the bytes that one number takes."""
    return int("".join(filter(str.isdigit, data_type))) // 8


def _whole_limits(data_type: str) -> tuple[int, int] | None:
    """Return smallest and largest number of an integer type; None for a floating one."""
    if data_type in _FLOATS:
        return None
    bits = 8 * _width(data_type)
    return (0, 2**bits - 1) if data_type.startswith("u") else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)


def packed(data_type: str, value: float, order: Literal["little", "big"]) -> bytes:
    """Pack a number; integers are rounded and saturate, and NaN is their smallest."""
    limits = _whole_limits(data_type)
    if limits is None:
        return struct.pack(("<" if order == "little" else ">") + _FLOATS[data_type], value)
    whole = limits[0] if math.isnan(value) else min(max(round(value), limits[0]), limits[1])
    return whole.to_bytes(_width(data_type), order, signed=limits[0] < 0)


@dataclass(frozen=True)
class Signal:
    """One process value: its column in the plant's state, its scaling to raw units and its encoding.

    A turn (0: none) makes it begin anew after so many raw units, ``zero`` being where the value is 0; ``field`` (bits,
    shift; 0: the whole number) is where in the number it stands.
    """

    channel: str
    column: int
    factor: float
    offset: float
    data_type: str

    turn: float = 0.0
    zero: float = 0.0
    field: tuple[int, int] = (0, 0)
    decimals: tuple[int, int] | None = None  # where it says how many it has: object and subindex, or register and table

    def raw(self, state: tuple[float, ...]) -> float:
        """Compute the raw value, not yet rounded where it is the whole number."""
        value = self.factor * state[self.column] + self.offset
        if self.turn:
            value = round(value + self.zero) % self.turn
        bits, shift = self.field
        if bits:
            value = (round(value) & (1 << bits) - 1) << shift
            limits = _whole_limits(self.data_type)
            assert limits is not None
            value -= 2 * (limits[1] + 1) if limits[0] < 0 and value > limits[1] else 0
        return value


@dataclass(frozen=True)
class NodeObject:
    """A CANopen object that carries a signal."""

    index: int
    subindex: int
    signal: Signal


@dataclass(frozen=True)
class NodePlan:
    """One CANopen node. ``kind`` names its EDS; identity is None where the machine file leaves it open."""

    node: int
    kind: str
    objects: tuple[NodeObject, ...]
    device_type: int | None = None
    vendor_id: int | None = None
    product_code: int | None = None
    settings: Mapping[str, float] = field(default_factory=dict)
    revision_number: int | None = None
    serial_number: int | None = None
    firmware: str | None = None


@dataclass(frozen=True)
class RegisterSignal:
    """Modbus registers that carry a signal."""

    register: int
    word_order: str
    signal: Signal


@dataclass(frozen=True)
class UnitPlan:
    """One Modbus unit."""

    unit: int
    registers: tuple[RegisterSignal, ...]


def nodes_from_dict(content: list[dict[str, Any]]) -> tuple[NodePlan, ...]:
    """Make plans of their fields (:func:`dataclasses.asdict`) as JSON carries them."""
    return tuple(
        NodePlan(
            **{key: value for key, value in node.items() if key != "objects"},
            objects=tuple(
                NodeObject(item["index"], item["subindex"], _signal(item["signal"])) for item in node["objects"]
            ),
        )
        for node in content
    )


def units_from_dict(content: list[dict[str, Any]]) -> tuple[UnitPlan, ...]:
    """Do the same for units."""
    return tuple(
        UnitPlan(
            unit["unit"],
            tuple(RegisterSignal(r["register"], r["word_order"], _signal(r["signal"])) for r in unit["registers"]),
        )
        for unit in content
    )


def _signal(content: dict[str, Any]) -> Signal:
    decimals = content["decimals"]
    pairs = {"field": tuple(content["field"]), "decimals": None if decimals is None else tuple(decimals)}
    return Signal(**{**content, **pairs})
