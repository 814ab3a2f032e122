"""Acquisition of daq, as the service uses it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from daq import Machine
from daq.acquisition import AcquisitionProcess


@contextmanager
def acquire(machine: Machine) -> Iterator[AcquisitionProcess]:
    """Start acquiring a machine; a device that is not there stays missing and costs only itself."""
    process = AcquisitionProcess(machine, strict=False)
    process.start()
    try:
        yield process
    finally:
        process.stop()
