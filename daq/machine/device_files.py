"""Files that a machine file names (DBC, EDS, DCF), looked at before they are read: anybody may have named them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, get_args

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from daq.errors import MachineFileError
from daq.machine.buses import BESIDE
from daq.messages import Sentence

if TYPE_CHECKING:
    from daq.machine.machine_file import Machine

LARGEST = 16_000_000  # bytes; the largest ones in use have a few


def named_files(machine: Machine) -> Iterator[tuple[str, str]]:
    """List files that a machine names: by which bus, node or channel, and the path as written there."""
    for bus in machine.buses:
        yield from _named(bus, bus.name, f"bus '{bus.name}'")
    for channel in machine.channels:
        if channel.source is not None:
            yield from _named(channel.source, channel.source.bus, f"channel '{channel.name}'")


def names_files(field: FieldInfo) -> bool:
    """Test whether texts in a field of a model are files: a :data:`daq.machine.buses.DeviceFile`, or several."""
    return any(map(_is_marked, (field.annotation, *field.metadata)))


def _is_marked(annotation: object) -> bool:
    return annotation == BESIDE or any(map(_is_marked, get_args(annotation)))


def _named(part: BaseModel, bus_name: str, place: str) -> Iterator[tuple[str, str]]:
    for name, field in type(part).model_fields.items():
        for value in _values(getattr(part, name)):
            if isinstance(value, BaseModel):
                node = getattr(value, "node", None)
                own = place if node is None else Sentence("daq.bus_node", bus_name=bus_name, node=node)
                yield from _named(value, bus_name, own)
            elif isinstance(value, str) and names_files(field):
                yield place, value


def _values(value: object) -> Iterator[object]:
    """List what is in a value, however deep in lists and tables."""
    if isinstance(value, dict):
        value = (*value.keys(), *value.values())
    if isinstance(value, list | tuple | set | frozenset):
        for own in value:
            yield from _values(own)
    else:
        yield value


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
