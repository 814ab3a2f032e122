"""Acquisition of daq, as the service uses it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from daq import Machine
from daq.acquisition.acquisition import AcquisitionProcess


@contextmanager
def acquire(machine: Machine, data_directory: Path | None = None) -> Iterator[AcquisitionProcess]:
    """Start acquiring a machine; a device that is not there stays missing and costs only itself.

    What CANopen nodes were like before is kept in ``data_directory``.
    """
    process = AcquisitionProcess(machine, strict=False, data_directory=data_directory)
    process.start()
    try:
        yield process
    finally:
        process.stop()
