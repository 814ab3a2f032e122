"""The parts of a service as installed: the stages of fitting, acquisition and recorder of daq."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from daq import Machine
from daq.acquisition import AcquisitionProcess
from daq.errors import AcquisitionError
from daq.journal import recover
from daq.recorder import Recorder
from server.service import Parts
from server.sessions import RecordOrder
from server.stages import fitting_program

#: Seconds between two looks at whether a recording should stop.
LOOK_S = 0.2


@contextmanager
def acquire(machine: Machine, data_directory: Path | None = None) -> Iterator[AcquisitionProcess]:
    """Start acquiring a machine; a device that is not there stays missing and costs only itself."""
    process = AcquisitionProcess(machine, strict=False, data_directory=data_directory)
    process.start()
    try:
        yield process
    finally:
        process.stop()


class RingRecorder:
    """Records from the ring buffer of a running acquisition (:class:`daq.recorder.Recorder`)."""

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


def installed_parts(data_directory: Path | None = None) -> Parts:
    """What a service runs with unless a test says otherwise; what CANopen nodes were like is kept in its directory."""
    launch = partial(acquire, data_directory=data_directory)
    return Parts(program=fitting_program, launch=launch, recorder=RingRecorder())
