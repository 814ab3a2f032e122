"""The recorder of daq, as the service uses it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from daq.acquisition.journal import recover
from daq.acquisition.recorder import Recorder
from daq.errors import AcquisitionError
from server.recordings.recording_sessions import RecordOrder

#: Seconds between two looks at whether a recording should stop.
LOOK_S = 0.2


class RingRecorder:
    """Records from the ring buffer of a running acquisition (:class:`daq.acquisition.recorder.Recorder`)."""

    def record(self, order: RecordOrder) -> dict[str, Any]:
        """Record until the time is over, stopped, or the acquisition ends; rows that came before are kept."""
        recorder = Recorder(order.ring_name, order.machine, order.role, order.path)
        recorder.start(order.seconds)
        while recorder.active and not order.stop.wait(LOOK_S):
            order.report({"rows": recorder.rows, "seconds": recorder.rows / order.machine.rate_hz})
        try:
            summary = recorder.stop()
        except AcquisitionError as error:
            if not order.path.is_file():
                raise
            return {
                "rows": recorder.rows,
                "seconds": recorder.rows / order.machine.rate_hz,
                "ended_early": str(error).replace(f"{order.path.parent}/", ""),
            }
        return {
            "rows": summary.rows,
            "seconds": summary.seconds,
            "missed_cycles": summary.missed_cycles,
            "quality": summary.quality,
            "events": summary.events,
        }

    def recover(self, directory: Path) -> dict[Path, int]:
        """Seal the journals that a killed server left in ``directory``."""
        return {found.file: found.rows for found in recover(directory) if found.file is not None}
