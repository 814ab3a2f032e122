"""Files that a machine file names (DBC, EDS, DCF), looked at before they are read: anybody may have named them."""

from __future__ import annotations

from pathlib import Path

from daq.errors import MachineFileError

LARGEST = 16_000_000  # bytes; the largest ones in use have a few


def check_device_file(path: str, suffixes: tuple[str, ...], place: str) -> None:
    """Raise MachineFileError, in one line that begins with ``place``, if it is no file to be read."""
    if Path(path).suffix.lower() not in suffixes:
        raise MachineFileError(f"{place}: unknown kind of file; give {', '.join(suffixes)}")
    if not Path(path).is_file():  # nor a device or a pipe, which would never end
        raise MachineFileError(f"{place}: no such file; a path begins at the machine file's folder")
    if Path(path).stat().st_size > LARGEST:
        raise MachineFileError(f"{place}: is larger than {LARGEST // 1_000_000} MB; is it the right file?")
