"""Events of devices and buses while a recording was made, as it has them."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from daq.arrays import IntArray
from daq.messages import message_from_json

MOST = 200  # events of a file that are taken; more is a storm, which its counts tell as well
TEXT_LENGTH = 240


@dataclass(frozen=True)
class RecordedEvent:
    """One thing that happened.

    Attributes
    ----------
    time : s since the recording's first row by the computer's clock; negative for what had begun before; None where
        the recording has no such clock
    device : what it happened to, as ``bus/device``, or the bus itself
    what : short name: ``silent``, ``boot_up``, ``emergency``, ``bus_off``, ``utc_jump``, ...
    text : one line
    seconds : how long it lasted; None for what lasted on when the recording ended; 0 for a moment
    count : how often it was seen within it
    """

    time: float | None
    device: str
    what: str
    text: str
    seconds: float | None
    count: int


def recorded_events(metadata: Mapping[str, str], utc_ns: IntArray | None = None) -> tuple[RecordedEvent, ...]:
    """Read the events in a recording's metadata (``hilfit.events``), oldest first, without unreadable ones.

    Parameters
    ----------
    utc_ns : (N,) of the recording's rows
    """
    try:
        listed = json.loads(metadata.get("hilfit.events", "[]"))
    except ValueError:
        return ()
    first = None if utc_ns is None or not len(utc_ns) else int(utc_ns[0])
    found = (_event(entry, first) for entry in (listed if isinstance(listed, list) else ())[:MOST])
    return tuple(event for event in found if event is not None)


def _event(entry: object, first_ns: int | None) -> RecordedEvent | None:
    if not isinstance(entry, dict):
        return None
    try:
        seconds = None if entry["seconds"] is None else float(entry["seconds"])
        began = None if first_ns is None else (int(entry["utc_ns"]) - first_ns) / 1e9
        if not all(math.isfinite(number) for number in (seconds, began) if number is not None):
            return None
        return RecordedEvent(
            began, _line(entry["device"]), _line(entry["what"]), _text(entry), seconds, int(entry["count"])
        )
    except (KeyError, TypeError, ValueError, OverflowError):
        return None


def _text(entry: Mapping[str, Any]) -> str:
    """Return the text as a sentence if it is the one that its message makes; a file may hold anything."""
    text = _line(entry["text"])
    try:
        sentence = message_from_json(entry["message"])
        return sentence if sentence == text else text
    except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError, RecursionError):
        return text


def _line(text: object) -> str:
    return " ".join(str(text).split())[:TEXT_LENGTH]
