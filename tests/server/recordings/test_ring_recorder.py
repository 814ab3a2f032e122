"""The recorder of a running service: when acquisition dies, a file is left, and the store knows its rows."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet
from service_fakes import MACHINE

from daq import parse_machine
from daq.acquisition.ring import RingWriter, ring_buffer
from daq.frames.frame import Frame, row_dtype
from server.recordings.recording_resource import RingRecorder
from server.recordings.recording_sessions import RecordOrder


def test_a_recording_whose_acquisition_ended_says_its_rows(tmp_path: Path) -> None:
    machine, path = parse_machine(MACHINE), tmp_path / "rec-1.parquet"
    reported: list[dict[str, Any]] = []
    with ring_buffer(row_dtype(len(machine.channels)), 64) as name:
        writer = RingWriter(name)

        def follow(statistics: dict[str, Any]) -> None:
            if not reported:  # it listens now
                for cycle in range(25):
                    values = np.array([0.1, 2.0])
                    quality = np.zeros(2, dtype=np.uint8)
                    writer.write(Frame(cycle, 1, 2, cycle / 50, values, values * 0, quality))
                writer.finish()
            reported.append(statistics)

        order = RecordOrder(machine, name, "train", path, None, threading.Event(), follow)
        found = RingRecorder().record(order)
        writer.close()
    rows = pyarrow.parquet.read_metadata(path).num_rows
    assert (found["rows"], found["seconds"]) == (rows, rows / 50)
    assert "acquisition of 'lever' ended" in found["ended_early"]
    assert str(tmp_path) not in found["ended_early"]
