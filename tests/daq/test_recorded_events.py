"""Events in a recording's metadata: those of our recorder are read back, and nothing else does harm."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from bench_machines import plain
from hypothesis import given
from hypothesis import strategies as st

from daq import parse_machine, read_recording
from daq.frames.events import EventLog
from daq.messages import Sentence
from daq.recordings.recorded_events import TEXT_LENGTH, recorded_events
from daq.recordings.recording import recording_table
from daq.recordings.recording_files import write_table

JSON: st.SearchStrategy[Any] = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(["utc_ns", "device", "what", "text", "seconds", "count", "message", "code", "values"]),
            inner,
            max_size=6,
        )
    ),
    max_leaves=20,
)


def test_the_log_s_events_are_read_back_in_seconds_of_the_recording(tmp_path: Path) -> None:
    machine = parse_machine(plain())
    now = [5_000_000_000]
    log = EventLog(lambda: now[0], lambda: now[0])
    log.begin("can/node 31", "silent", "no heartbeat")
    now[0] += 2_000_000_000
    log.end("can/node 31", "silent")
    log.begin("can", "bus_off", "check the cable")
    n = 400
    utc = 4_000_000_000 + np.arange(n) * 20_000_000
    q = 0.3 * np.sin(np.arange(n) / 20)
    values = {"j1.angle": q, "j1.piston": 0.1 * (q + 1.2), "j1.head": 1e6 + 1e5 * q, "j1.rod": 1e6 - 1e5 * q}
    values["oil"] = 300.0 + q
    table = recording_table(machine, "operation", np.arange(n) / 50, values, cycle=np.arange(n), utc_ns=utc)
    metadata = {**table.schema.metadata, b"hilfit.events": json.dumps(log.published()).encode()}
    write_table(tmp_path / "r.parquet", pa.Table.replace_schema_metadata(table, metadata))
    events = read_recording(tmp_path / "r.parquet", machine, "operation").events
    assert [(e.device, e.what, e.time, e.seconds) for e in events] == [
        ("can/node 31", "silent", 1.0, 2.0), ("can", "bus_off", 3.0, None),
    ]  # fmt: skip


@pytest.mark.slow
@given(st.one_of(st.text(max_size=50), JSON.map(json.dumps)))
def test_metadata_of_any_content_gives_events_or_none(text: str) -> None:
    for event in recorded_events({"hilfit.events": text}, np.array([1])):
        assert len(event.text) <= TEXT_LENGTH and "\n" not in event.text + event.device + event.what
        assert event.time is not None and np.isfinite(event.time)
        assert event.seconds is None or np.isfinite(event.seconds)


def test_a_recording_without_events_has_none() -> None:
    assert recorded_events({}) == ()


@pytest.mark.parametrize(
    ("text", "known"),
    [("can: twice", True), ("can: another text", False)],
)
def test_a_text_is_a_sentence_only_if_its_message_makes_it(text: str, known: bool) -> None:
    message = {"code": "daq.named", "values": {"name": "can", "what": "twice"}}
    event = {"utc_ns": 1, "device": "can", "what": "x", "seconds": 0.0, "count": 1, "text": text, "message": message}
    (read,) = recorded_events({"hilfit.events": json.dumps([event])}, np.array([1]))
    assert (read.text, isinstance(read.text, Sentence)) == (text, known)


@pytest.mark.parametrize(
    "message",
    [None, 3, "daq.named", [], {"code": 3}, {"code": "daq.named"}, {"code": "os.path", "values": {}},
     {"code": "daq.named", "values": {"name": {}, "what": 1}}, {"code": "daq.first_of", "values": [1]}],
)  # fmt: skip
def test_messages_of_any_content_do_no_harm(message: Any) -> None:
    event = {"utc_ns": 1, "device": "can", "what": "x", "seconds": 0.0, "count": 1, "text": "a", "message": message}
    (read,) = recorded_events({"hilfit.events": json.dumps([event])}, np.array([1]))
    assert read.text == "a"
