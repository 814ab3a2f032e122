"""Messages of the live stream; every one carries the stream's sequence number.

A client adds what it gets to what it has only if ``seq`` is one more than the last; after a hole it connects again
and begins with a snapshot. Values are in the channels' units; what is not a number is ``null``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import orjson

from daq import Machine, Quality
from daq.arrays import FloatArray, RowArray
from server.platform.http.bodies import finite

#: Name of each quality, by its number in a frame.
QUALITIES = tuple(quality.name.lower() for quality in Quality)


@dataclass(frozen=True)
class Channels:
    """Names and units of a machine's channels, and the way from SI to those units.

    Attributes
    ----------
    names, units : per channel
    scale, offset : (n,) value in the unit = scale * value in SI + offset
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    scale: FloatArray
    offset: FloatArray

    @classmethod
    def of(cls, machine: Machine) -> Channels:
        """List the channels in the order of the machine file, which is that of a frame."""
        conversions = [machine.conversion(channel) for channel in machine.channels]
        offset = np.array([float(conversion.from_si(0.0)) for conversion in conversions])
        scale = np.array([float(conversion.from_si(1.0)) for conversion in conversions]) - offset
        return cls(tuple(c.name for c in machine.channels), tuple(c.unit for c in machine.channels), scale, offset)


def snapshot(seq: int, state: str, channels: Channels | None, row: RowArray | None) -> str:
    """Collect everything there is to know now: the first message, and again whenever acquisition restarts.

    Parameters
    ----------
    state : of the acquisition (``running``, ``waiting``, ``off``, ...)
    channels, row : None while there is nothing; ``row`` has shape (1,) as the ring buffer holds it
    """
    content: dict[str, Any] = {"type": "snapshot", "seq": seq, "acquisition": state, "time": None, "channels": {}}
    if channels is not None and row is not None:
        values = channels.scale * row["values"][0] + channels.offset
        content["time"] = float(row["time"][0])
        content["utc_ns"] = int(row["utc_ns"][0])
        content["channels"] = {
            name: {
                "value": finite(values[index]),
                "unit": channels.units[index],
                "quality": QUALITIES[int(row["quality"][0, index])],
                "age_s": finite(row["ages"][0, index]),
            }
            for index, name in enumerate(channels.names)
        }
    elif channels is not None:
        content["channels"] = {
            name: {"value": None, "unit": unit, "quality": "missing", "age_s": None}
            for name, unit in zip(channels.names, channels.units, strict=True)
        }
    return _text(content)


def frames(seq: int, channels: Channels, rows: RowArray, missed: int = 0) -> str:
    """Collect samples since the last message, oldest first; quality and age are those of the newest.

    Parameters
    ----------
    rows : (N,) rows of the ring buffer, N > 0
    missed : rows that this reader lost before them
    """
    values = channels.scale * rows["values"] + channels.offset
    return _text(
        {
            "type": "frames",
            "seq": seq,
            "channels": channels.names,
            "samples": [
                {"t": float(time), "utc": utc / 1e9, "values": value}
                for time, utc, value in zip(rows["time"], rows["utc_ns"].tolist(), values, strict=True)
            ],
            "quality": [QUALITIES[int(number)] for number in rows["quality"][-1]],
            "age_s": np.ascontiguousarray(rows["ages"][-1]),
            "missed": missed,
        }
    )


def heartbeat(seq: int, state: str) -> str:
    """Send a sign of life, and what the acquisition does."""
    return _text({"type": "heartbeat", "seq": seq, "acquisition": state})


def _text(content: dict[str, Any]) -> str:
    return orjson.dumps(content, option=orjson.OPT_SERIALIZE_NUMPY).decode()
