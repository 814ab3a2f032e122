"""Where an object is in a node's PDOs, from its EDS or DCF (CiA 306): mapping as it is, nothing is asked or written.

::

    0x1800 + n : 1   COB-ID (bit 31: not used)    : 2  transmission type    : 5  event timer, ms
    0x1A00 + n : 0   number of entries            : k  index << 16 | subindex << 8 | bits

A DCF holds a value (ParameterValue) where an EDS has a default.
"""

from __future__ import annotations

import configparser
import io
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from canopen.objectdictionary import ODVariable
from canopen.objectdictionary.eds import import_eds

from daq.drivers.canopen.mapping import laid_out
from daq.errors import MachineFileError
from daq.machine.device_files import check_device_file
from daq.messages import Sentence, named

SUFFIXES = (".eds", ".dcf")
SYNCHRONOUS = 240  # transmission types up to here are sampled at SYNC; 252 to 255 are not
_SECTION = re.compile(r"([0-9A-F]{4})(?:sub([0-9A-F]{1,2}))?", re.IGNORECASE)
_NOT_USED = 0x8000_0000
_PDOS = 512
_ENTRIES = 64  # a PDO has 64 bits


@dataclass(frozen=True)
class Place:
    """An object in a PDO.

    Attributes
    ----------
    cob_id : of the PDO
    bit, bits : where in its data, little endian
    synchronous : whether it is sampled at SYNC
    event_ms : a PDO that nothing changes comes after so long all the same; 0: it does not, or nothing is said
    length : bytes of the PDO; 0: as many as its first frame has
    """

    cob_id: int
    bit: int
    bits: int
    synchronous: bool
    event_ms: int
    length: int = 0


@dataclass(frozen=True)
class Pdo:
    """A TPDO as it is set up: transmission type, event timer (ms), and (index, subindex, bits) of what it carries."""

    number: int
    cob_id: int
    transmission: int
    event_ms: int
    entries: tuple[tuple[int, int, int], ...]

    def places(self) -> dict[tuple[int, int], Place]:
        """Find for every object (index, subindex) in it its first place."""
        found: dict[tuple[int, int], Place] = {}
        synchronous, length = self.transmission <= SYNCHRONOUS, (sum(bits for *_, bits in self.entries) + 7) // 8
        bit = 0
        for index, subindex, bits in self.entries:
            place = Place(self.cob_id, bit, bits, synchronous, 0 if synchronous else self.event_ms, length)
            found.setdefault((index, subindex), place)
            bit += bits
        return found


def pdo_places(path: str, node: int, bus: str) -> dict[tuple[int, int], Place]:
    """Find for every object (index, subindex) that a node sends its first place.

    Raises
    ------
    MachineFileError
        If the file is not there or no EDS.
    """
    dictionary = read_eds(path, node, named(Sentence("daq.bus_node", bus_name=bus, node=node), path))
    found: dict[tuple[int, int], Place] = {}
    for pdo in pdos_of(partial(value_of, dictionary), _PDOS):
        for key, place in pdo.places().items():
            found.setdefault(key, place)
    return found


def pdos_of(value: Callable[[int, int], int | None], most: int) -> Iterator[Pdo]:
    """Read those of a device's first ``most`` TPDOs that are in use.

    Parameters
    ----------
    value : what an object (index, subindex) holds; None where it is not there
    """
    for number in range(most):
        parameters, mapping = 0x1800 + number, 0x1A00 + number
        cob_id = value(parameters, 1)
        if cob_id is None or cob_id & _NOT_USED or not cob_id & 0x7FF:
            continue
        transmission, event_ms = value(parameters, 2), value(parameters, 5) or 0
        mapped = [value(mapping, k) or 0 for k in range(1, min(value(mapping, 0) or 0, _ENTRIES) + 1)]
        entries = tuple((index, sub, bits) for index, sub, _, bits in laid_out(mapped))
        yield Pdo(number + 1, cob_id & 0x7FF, 255 if transmission is None else transmission, event_ms, entries)


def read_eds(path: str, node: int, place: str) -> Any:
    """Read an EDS or DCF as canopen's object dictionary (MachineFileError, beginning with ``place``, if invalid)."""
    check_device_file(path, SUFFIXES, place)
    try:
        data = Path(path).read_bytes()
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = data.decode("cp1252", errors="replace")  # what most editors of such files write
        if "[DeviceInfo]" not in text:
            raise ValueError("a section that each has is not there")
        return import_eds(_in_order(text), node)
    except OSError as error:
        raise MachineFileError("daq.not_readable", place=place, reason=error.strerror) from None
    except (configparser.Error, ValueError, KeyError, IndexError, TypeError, AttributeError):
        raise MachineFileError("daq.no_eds", place=place) from None


def _in_order(text: str) -> io.StringIO:
    """Normalise a file to the standard, whatever its maker's habits; unused parts are left out.

    Sections and keys that are there twice, members before their object or in capitals, without a name, and mappings in
    compact lists (CiA 306, 4.6.3.2) are common, and canopen's reader stumbles over them.
    """
    read = configparser.RawConfigParser(strict=False, allow_no_value=True, inline_comment_prefixes=(";",))
    read.optionxform = str  # type: ignore[assignment,method-assign]
    read.read_string("\n".join(line.strip() for line in text.splitlines()))
    found: dict[tuple[int, int], dict[str, str]] = {}  # by index and subindex; -1 is the object itself
    for section in read.sections():
        place = _SECTION.fullmatch(section)
        if place is not None:
            key = int(place[1], 16), int(place[2], 16) if place[2] else -1
            found.setdefault(key, {}).update((k, v) for k, v in read.items(section) if v)
    for index, subindex in list(found):
        head = found.setdefault((index, -1), {"ObjectType": "0x9"})
        if subindex < 0 and "CompactSubObj" in head and 0x1800 <= index < 0x1C00:
            count, values = head.pop("CompactSubObj"), f"{index:04X}Value"
            own = {k: v for k, v in head.items() if k != "ObjectType"}
            found[index, 0] = {"DataType": "0x0005", "DefaultValue": count}
            for k in range(1, min(int(count, 0), _ENTRIES) + 1):
                value = read.get(values, str(k), fallback=None)
                found[index, k] = own | ({} if value is None else {"ParameterValue": value})
    written = configparser.RawConfigParser()
    written.optionxform = str  # type: ignore[assignment,method-assign]
    written["DeviceInfo"] = {k: v for k, v in read.items("DeviceInfo") if v}
    for (index, subindex), keys in sorted(found.items()):
        section = f"{index:04X}" + (f"sub{subindex:X}" if subindex >= 0 else "")
        written[section] = {"ParameterName": section, "DataType": "0x0007", "AccessType": "rw"} | keys
    made = io.StringIO()
    written.write(made)
    made.seek(0)
    return made


def value_of(dictionary: Any, index: int, subindex: int) -> int | None:
    """Return an object's value, else its default, else None."""
    variable = variable_of(dictionary, index, subindex)
    value = getattr(variable, "value", None)
    value = getattr(variable, "default", None) if value is None else value
    return value if isinstance(value, int) else None


def variable_of(dictionary: Any, index: int, subindex: int) -> ODVariable | None:
    """Return an object, or the part of one; None if it is not there."""
    held = dictionary.get(index)
    if isinstance(held, ODVariable):
        return held if subindex == 0 else None
    return None if held is None else held.subindices.get(subindex)
