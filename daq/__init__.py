"""Acquisition side of hilfit: machine files, channels, drivers, ring buffer, recorder, recordings.

What identification needs stands here. Acquiring is in modules of their own, which this package does not import, so that
reading a file never loads a bus library. Names are loaded when they are first used: the acquisition process, of which
there may be many on one computer, needs neither recordings nor what they are read and resampled with:

- :mod:`daq.acquisition`: the cycle that drivers run in, a process of its own
- :mod:`daq.ring`: the shared-memory ring buffer and its readers
- :mod:`daq.recorder`: from the ring to a file that survives a power cut
- :mod:`daq.drivers`: the driver protocol and its conformance check
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from daq.errors import (
        AcquisitionError,
        BusError,
        CommissioningError,
        DiskFullError,
        HilfitError,
        InputError,
        MachineFileError,
        RecordingError,
        StorageError,
    )
    from daq.machine_file import Channel, Cylinder, Joint, Machine, load_machine, machine_to_yaml, parse_machine
    from daq.quality import Quality
    from daq.recording import ROLES, Recording, read_recording, write_recording

__all__ = [
    "ROLES",
    "AcquisitionError",
    "BusError",
    "Channel",
    "CommissioningError",
    "Cylinder",
    "DiskFullError",
    "HilfitError",
    "InputError",
    "Joint",
    "Machine",
    "MachineFileError",
    "Quality",
    "Recording",
    "RecordingError",
    "StorageError",
    "load_machine",
    "machine_to_yaml",
    "parse_machine",
    "read_recording",
    "write_recording",
]

_HOME = {
    "errors": (
        "AcquisitionError", "BusError", "CommissioningError", "DiskFullError", "HilfitError", "InputError",
        "MachineFileError", "RecordingError", "StorageError",
    ),
    "machine_file": (
        "Channel", "Cylinder", "Joint", "Machine", "load_machine", "machine_to_yaml", "parse_machine",
    ),
    "quality": ("Quality",),
    "recording": ("ROLES", "Recording", "read_recording", "write_recording"),
}  # fmt: skip


def __getattr__(name: str) -> Any:
    for module, names in _HOME.items():
        if name in names:
            return getattr(importlib.import_module(f"{__name__}.{module}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
