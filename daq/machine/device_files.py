"""Files that a machine file names (DBC, EDS, DCF), looked at before they are read: anybody may have named them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

from daq.errors import MachineFileError
from daq.messages import Sentence

if TYPE_CHECKING:
    from daq.machine.machine_file import Machine

LARGEST = 16_000_000  # bytes; the largest ones in use have a few


def named_files(machine: Machine) -> Iterator[tuple[str, str]]:
    """List files that a machine names: by which bus or node, and the path as written there."""
    for bus in machine.buses:
        for path in getattr(bus, "dbc", ()):
            yield f"bus '{bus.name}'", path
        for node in getattr(bus, "nodes", ()):
            if node.eds is not None:
                yield Sentence("daq.bus_node", bus_name=bus.name, node=node.node), node.eds


def refuse_files_elsewhere(machine: Machine, name: str) -> None:
    """Raise MachineFileError if a machine from outside names a file that is not in the machine's own folder.

    Or whoever sends machine files would learn which files there are on this computer. ``name`` is the file's in errors.
    """
    for place, path in named_files(machine):
        parts = PurePosixPath(path.replace("\\", "/"))
        if parts.is_absolute() or ".." in parts.parts or ":" in path:
            raise MachineFileError("daq.names_file_outside_machine", name=name, place=place)


def check_device_file(path: str, suffixes: tuple[str, ...], place: str) -> None:
    """Raise MachineFileError, in one line that begins with ``place``, if it is no file to be read."""
    if Path(path).suffix.lower() not in suffixes:
        raise MachineFileError("daq.unknown_kind_file", place=place, suffixes=", ".join(suffixes))
    if not Path(path).is_file():  # nor a device or a pipe, which would never end
        raise MachineFileError("daq.no_such_file", place=place)
    if Path(path).stat().st_size > LARGEST:
        raise MachineFileError("daq.larger_mb", place=place, largest=LARGEST // 1000000)
