"""MCAP (mcap.dev) with one JSON message per row, what tools of robotics read."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import orjson

from daq.recordings.recording_files import Table

TOPIC = "/hilfit/frame"


def write(table: Table, units: dict[str, str], target: Path) -> None:
    """Write a recording's table; a message's log time is UTC of its SYNC where known, else the recording's time.

    Parameters
    ----------
    units : per channel, kept as the file's metadata and in the schema
    """
    from mcap.writer import Writer

    names = list(table.columns)
    properties: dict[str, Any] = {
        name: {"type": ["number", "null"], **({"description": units[name]} if name in units else {})} for name in names
    }
    schema = {"type": "object", "title": "hilfit.Frame", "properties": properties}
    stamps = np.asarray(table.columns.get("utc_ns", np.round(np.asarray(table.columns["time"]) * 1e9)), dtype=np.int64)
    lists = [np.asarray(table.columns[name]).tolist() for name in names]
    with target.open("wb") as file:
        writer: Any = Writer(file)  # its methods are not annotated
        writer.start(profile="", library="hilfit")
        schema_id = writer.register_schema(name="hilfit.Frame", encoding="jsonschema", data=json.dumps(schema).encode())
        channel_id = writer.register_channel(topic=TOPIC, message_encoding="json", schema_id=schema_id)
        writer.add_metadata("hilfit", {**dict(table.metadata), "units": json.dumps(units)})
        for number, (stamp, row) in enumerate(zip(stamps.tolist(), zip(*lists, strict=True), strict=True)):
            content = {
                name: None if isinstance(value, float) and not math.isfinite(value) else value
                for name, value in zip(names, row, strict=True)
            }
            writer.add_message(channel_id, stamp, orjson.dumps(content), max(stamp, 0), number)
        writer.finish()
