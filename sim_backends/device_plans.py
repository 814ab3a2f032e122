"""Plans of simulated devices: what a device process needs to know, and nothing about machine files.

A plan is made of numbers and strings only, so it travels as JSON, and the processes that read it load neither the
machine file's parser nor the physics. Devices hold physical values; ``raw = factor * SI + offset``.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

STRUCT_CODES = {
    "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I", "int64": "q", "uint64": "Q",
    "float32": "f", "float64": "d",
}  # fmt: skip


def whole_limits(code: str) -> tuple[int, int] | None:
    """Smallest and largest number of an integer struct code; None for a floating one."""
    if code in "fd":
        return None
    bits = 8 * struct.calcsize("<" + code)
    return (0, 2**bits - 1) if code.isupper() else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)


@dataclass(frozen=True)
class Signal:
    """One process value: its column in the plant's state, its scaling to raw units and its encoding."""

    channel: str
    column: int
    factor: float
    offset: float
    data_type: str

    def raw(self, state: tuple[float, ...]) -> float:
        """The raw value, not yet rounded."""
        return self.factor * state[self.column] + self.offset


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
    device_type: int | None
    vendor_id: int | None
    product_code: int | None
    settings: Mapping[str, float]


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


def nodes_to_dict(nodes: tuple[NodePlan, ...]) -> list[dict[str, Any]]:
    """Plans as JSON can carry them."""
    return [asdict(node) for node in nodes]


def nodes_from_dict(content: list[dict[str, Any]]) -> tuple[NodePlan, ...]:
    """The inverse of :func:`nodes_to_dict`."""
    return tuple(
        NodePlan(
            **{key: value for key, value in node.items() if key != "objects"},
            objects=tuple(
                NodeObject(item["index"], item["subindex"], Signal(**item["signal"])) for item in node["objects"]
            ),
        )
        for node in content
    )


def units_to_dict(units: tuple[UnitPlan, ...]) -> list[dict[str, Any]]:
    """Plans as JSON can carry them."""
    return [asdict(unit) for unit in units]


def units_from_dict(content: list[dict[str, Any]]) -> tuple[UnitPlan, ...]:
    """The inverse of :func:`units_to_dict`."""
    return tuple(
        UnitPlan(
            unit["unit"],
            tuple(RegisterSignal(r["register"], r["word_order"], Signal(**r["signal"])) for r in unit["registers"]),
        )
        for unit in content
    )
