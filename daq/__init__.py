"""Acquisition side of hilfit: machine files, channels, drivers, ring buffer, recorder, recordings.

What identification needs stands here. Acquiring is in modules of their own, which this package does not import, so that
reading a file never loads a bus library. Names are loaded when they are first used: the acquisition process, of which
there may be many on one computer, needs neither recordings nor what reads and resamples them:

=================  =================================================================================================
``machine``        what a machine file says, and its checks
``kinematics``     Denavit-Hartenberg tables from URDF and MJCF, drafts of machine files
``recordings``     files of any form read, checked, resampled, written; MDF4, MCAP and MAT for other tools
``frames``         what a cycle is made of: channels in their places, clock, events
``drivers``        the driver protocol, its conformance check, CANopen, plain CAN and Modbus
``acquisition``    the cycle that drivers run in, a process of its own; the ring buffer and its readers; the recorder,
                   from the ring to a file that survives a power cut; traces and their replay
``commissioning``  tools for the days on which a machine is connected
``commands``       the commands of ``hilfit`` for all this
=================  =================================================================================================

A room imports only those above it in this list (a contract in ``pyproject.toml``). Beside the rooms: errors, quality
flags, types of arrays, units, motion files, and what reads YAML from strangers.
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
    from daq.machine.machine_file import Channel, Cylinder, Joint, Machine, load_machine, machine_to_yaml, parse_machine
    from daq.quality import Quality
    from daq.recordings.recording import ROLES, Recording, read_recording, write_recording

__all__ = [
    "ROLES", "AcquisitionError", "BusError", "Channel", "CommissioningError", "Cylinder", "DiskFullError",
    "HilfitError", "InputError", "Joint", "Machine", "MachineFileError", "Quality", "Recording", "RecordingError",
    "StorageError", "load_machine", "machine_to_yaml", "parse_machine", "read_recording", "write_recording",
]  # fmt: skip

#: Where these names are, what loads least first.
_HOMES = ("errors", "quality", "machine.machine_file", "recordings.recording")


def __getattr__(name: str) -> Any:
    for home in _HOMES if name in __all__ else ():
        found = getattr(importlib.import_module(f"{__name__}.{home}"), name, None)
        if found is not None:
            return found
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
