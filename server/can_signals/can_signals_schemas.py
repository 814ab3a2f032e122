"""Answers of the routes of CAN signals."""

from __future__ import annotations

from typing import Any, Literal, get_args

from pydantic import BaseModel

from daq.machine.quantities import JOINT_QUANTITIES, Quantity
from server.platform.http.bodies import Message, Shown


class CanSignal(Shown):
    """A signal of a DBC file: its value in ``unit`` is ``factor * raw + offset``.

    ``frame_id`` has 29 bits if ``extended``; ``pgn`` is null unless the message is J1939. ``start_bit`` is counted as
    in the file. A signal that ``selects`` is a multiplexer; one with a ``multiplexer`` is there only where that has one
    of ``multiplexer_values``. ``channels`` come from it; ``source`` are the keys of a channel's source that mean it,
    null with a ``refusal`` where none can come from it.
    """

    bus: str
    file: str
    message: str
    signal: str
    frame_id: int
    extended: bool
    pgn: int | None
    message_bytes: int
    start_bit: int
    bits: int
    byte_order: Literal["little", "big"]
    signed: bool
    is_float: bool
    factor: float | None
    offset: float | None
    unit: str
    minimum: float | None
    maximum: float | None
    selects: bool
    multiplexer: str | None
    multiplexer_values: list[int]
    cycle_ms: int | None
    channels: list[str]
    source: dict[str, str | int] | None
    refusal: str | None
    refusal_message: Message | None = None


class CanFile(Shown):
    """A file that a bus names: its digest (null if it is not there), or why it cannot be read."""

    name: str
    sha256: str | None
    messages: int
    signals: int
    error: str | None
    error_message: Message | None = None


class CanBus(BaseModel):
    """A bus; ``problems`` are lines about channels, ``left_out`` counts signals that are not listed at all.

    ``messages``: what problems were made of, by their text.
    """

    name: str
    files: list[CanFile]
    problems: list[str]
    messages: dict[str, Message] = {}
    left_out: int


class CanSignalQuantity(BaseModel):
    """What a channel can measure, and whether it then names a joint."""

    name: str
    of_a_joint: bool

    @classmethod
    def all(cls) -> list[CanSignalQuantity]:
        """Return every one."""
        return [cls(name=name, of_a_joint=name in JOINT_QUANTITIES) for name in get_args(Quantity)]


class CanSignalList(BaseModel):
    """Buses of plain CAN or J1939 of a machine, and ``found`` signals, of which the first are listed.

    ``version`` is that of the machine's file, ``quantities`` are what a channel can measure.
    """

    machine: str
    version: int
    buses: list[CanBus]
    found: int
    items: list[CanSignal]
    quantities: list[CanSignalQuantity]


class CanFileReplaced(BaseModel):
    """A file that was replaced."""

    name: str
    sha256: str


def matching(buses: list[dict[str, Any]], search: str) -> list[dict[str, Any]]:
    """Search signals with every word: names, unit, identifier, PGN, channels; those in use first."""
    words = search.lower().split()
    every = (signal for bus in buses for signal in bus["signals"])
    found = [signal for signal in every if not words or all(word in _text(signal) for word in words)]
    return sorted(found, key=lambda signal: not signal["channels"])


def _text(signal: dict[str, Any]) -> str:
    pgn = "" if signal["pgn"] is None else f"pgn 0x{signal['pgn']:04x} {signal['pgn']}"
    names = (signal["bus"], signal["file"], signal["message"], signal["signal"], signal["unit"], *signal["channels"])
    return " ".join(map(str, names)).lower() + f" 0x{signal['frame_id']:x} {signal['frame_id']} {pgn}"
