"""Acquisition side of hilfit: machine files, channels, drivers, ring buffer, recorder, recordings.

What identification needs stands here. Acquiring is in modules of their own, which this package does not import, so that
reading a file never loads a bus library:

- :mod:`daq.acquisition`: the cycle that drivers run in, a process of its own
- :mod:`daq.ring`: the shared-memory ring buffer and its readers
- :mod:`daq.recorder`: from the ring to a file that survives a power cut
- :mod:`daq.drivers`: the driver protocol and its conformance check
"""

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
