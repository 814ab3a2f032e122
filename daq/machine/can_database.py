"""DBC files (also KCD, SYM, ARXML): which message and signal of a bus of plain CAN or J1939 a channel comes from.

Reading is by ``cantools``, the extra ``dbc``. J1939 (SAE J1939-21) puts a parameter group's number (PGN) and the
sender's address into the 29-bit identifier::

    identifier  priority (3)  data page (2)  PDU format PF (8)  PDU specific PS (8)  source address (8)
    PGN         PF >= 240: data page, PF, PS    PF < 240: data page, PF, 0 (PS is then the address it is sent to)
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from daq.errors import BadValueError, MachineFileError
from daq.machine.buses import CanSignalsBus, SignalSource
from daq.machine.device_files import check_device_file
from daq.machine.machine_file_errors import did_you_mean
from daq.messages import Sentence, named
from daq.units import conversion

if TYPE_CHECKING:
    from cantools.database.can import Database, Message, Signal

    from daq.machine.machine_file import Channel, Machine

SUFFIXES = (".dbc", ".kcd", ".sym", ".arxml")
_PDU2 = 240  # PDU formats from here on are for everybody: PS belongs to the PGN
_CAN_BYTES = 8


@dataclass(frozen=True)
class Wanted:
    """One channel (position in the driver's order) and its signal."""

    position: int
    signal: Signal


@dataclass
class Listed:
    """A message that channels come from.

    Attributes
    ----------
    message : as the file describes it
    j1939 : whether its PGN counts, and not the whole identifier
    source_address : of the device it has to come from; None: any, but only one
    wanted : its channels
    """

    message: Message
    j1939: bool
    source_address: int | None
    wanted: list[Wanted] = field(default_factory=list)

    @property
    def name(self) -> str:
        """Name in lines."""
        identifier = self.message.frame_id
        if not self.j1939:
            return f"message '{self.message.name}' (0x{identifier:X})"
        sender = "" if self.source_address is None else f" from 0x{self.source_address:02X}"
        return f"message '{self.message.name}' (PGN 0x{pgn_of(identifier):04X}{sender})"


def pgn_of(identifier: int) -> int:
    """Return the parameter group number of a 29-bit identifier."""
    pgn = identifier >> 8 & 0x3FFFF
    return pgn if pgn >> 8 & 0xFF >= _PDU2 else pgn & 0x3FF00


def not_available(signal: Signal, raw: float) -> bool:
    """Return whether a raw value means no measurement by J1939-71, 5.1.4 (not available, error, reserved)."""
    if signal.is_float or signal.is_signed or signal.length < 2:
        return False
    if signal.length % 8 == 0:
        return bool(raw >= 0xFB << (signal.length - 8))
    return bool(raw >= (1 << signal.length) - 2)


def decoded(message: Message, data: bytes) -> dict[str, Any] | None:
    """Decode raw values by signal, as many as there are; None for a multiplexed part the file does not know."""
    from cantools.database.errors import Error

    try:
        found = message.decode(data, decode_choices=False, scaling=False, allow_truncated=True)
    except (Error, ValueError, KeyError, IndexError):
        return None
    return found if isinstance(found, dict) else None


def listed_messages(bus: CanSignalsBus, channels: Sequence[Channel]) -> tuple[list[Listed], list[tuple[int, str]]]:
    """List messages of a bus that channels come from.

    Returns
    -------
    listed, problems
        The messages; and per channel that has none its position and a line.

    Raises
    ------
    MachineFileError
        If a file of the bus cannot be read.
    """
    return listed_in([read_database(path, bus.name) for path in bus.dbc], channels)


def listed_in(databases: Sequence[Database], channels: Sequence[Channel]) -> tuple[list[Listed], list[tuple[int, str]]]:
    """List the same as :func:`listed_messages`, from files that are read already."""
    found: dict[tuple[str, int | None, bool], Listed] = {}
    problems: list[tuple[int, str]] = []
    for position, channel in enumerate(channels):
        source = channel.source
        assert isinstance(source, SignalSource)
        try:
            message = _message(databases, source)
            j1939 = is_j1939(message, source)
        except ValueError as error:
            problems.append((position, named(channel.name, str(error))))
            continue
        key = (message.name, source.source_address, j1939)
        listed = found.setdefault(key, Listed(message, j1939, source.source_address))
        listed.wanted.append(Wanted(position, message.get_signal_by_name(source.signal)))
    return list(found.values()), problems


def unusual_units(machine: Machine, listed: Sequence[Listed], channels: Sequence[Channel]) -> list[tuple[int, str]]:
    """List channels (position, line) taken as they are, although the file has another unit."""
    unusual: list[tuple[int, str]] = []
    for wanted in (wanted for message in listed for wanted in message.wanted):
        channel, unit = channels[wanted.position], wanted.signal.unit
        source = channel.source
        if source is None or not unit or (source.scale, source.offset) != (1.0, 0.0):
            continue
        try:
            meant = conversion(unit, machine.si_unit(channel))
        except ValueError:  # a unit of another kind, or written in a way of its own: nobody knows
            continue
        if meant != machine.conversion(channel):
            text = Sentence(
                "daq.bus_file_channel_says",
                channel=channel.name,
                signal=wanted.signal.name,
                unit=unit,
                unit_2=channel.unit,
            )
            unusual.append((wanted.position, Sentence("daq.correct_unit_give_scale", text=text)))
    return unusual


def read_database(path: str, bus: str) -> Database:
    """Read a file that describes messages.

    Raises
    ------
    MachineFileError
        If it is not there, too large, or no such file; its text is not repeated.
    """
    try:
        from cantools.database import Database as CanDatabase
        from cantools.database import load_file
        from cantools.database.errors import Error
        from textparser import Error as TextError
    except ModuleNotFoundError as error:
        raise MachineFileError("daq.bus_needs", bus=bus, error=error.name) from None
    place = Sentence("daq.on_bus", bus=bus, advice=path)
    check_device_file(path, SUFFIXES, place)
    try:
        made = load_file(path, strict=False)  # overlapping signals are common, and read well
    except OSError as error:
        raise MachineFileError("daq.not_readable", place=place, reason=error.strerror) from None
    except (Error, TextError, ValueError, KeyError, IndexError, TypeError, AttributeError, SyntaxError):
        raise MachineFileError("daq.no_file", place=place, upper=Path(path).suffix[1:].upper()) from None
    if not isinstance(made, CanDatabase):
        raise MachineFileError("daq.describes_no_can_messages", place=place, suffixes=", ".join(SUFFIXES))
    return made


def _message(databases: Sequence[Database], source: SignalSource) -> Message:
    """Find the message of the source's signal; ValueError if there is none, or more than one."""
    messages = [message for database in databases for message in database.messages]
    named = list(_named(messages, source))
    if not named:
        if source.pgn is not None:
            raise BadValueError("daq.no_message_pgn_bus", pgn=f"{source.pgn:04X}")
        hint = did_you_mean(str(source.message), [message.name for message in messages])
        raise BadValueError("daq.no_message_bus_files", message=source.message, hint=hint or "; correct message")
    found = [message for message in named if any(signal.name == source.signal for signal in message.signals)]
    if not found:
        hint = did_you_mean(source.signal, sorted({signal.name for message in named for signal in message.signals}))
        where = "" if source.message is None and source.pgn is None else Sentence("daq.in_message", named=named[0].name)
        raise BadValueError("daq.no_signal", signal=source.signal, where=where, hint=hint or "; correct signal")
    if len(found) > 1:
        names = ", ".join(message.name for message in found[:4])
        raise BadValueError("daq.signal_messages", signal=source.signal, count=len(found), names=names)
    return found[0]


def _named(messages: Sequence[Message], source: SignalSource) -> Iterator[Message]:
    for message in messages:
        if message.is_container:
            continue
        if source.pgn is not None:
            if message.is_extended_frame and pgn_of(message.frame_id) == source.pgn:
                yield message
        elif source.message is None or message.name == source.message:
            yield message


def is_j1939(message: Message, source: SignalSource) -> bool:
    """Return whether a message is taken by PGN; ValueError (one line) if a channel cannot use it."""
    asked = source.pgn is not None or source.source_address is not None
    if asked and not message.is_extended_frame:
        raise BadValueError("daq.message_bits_no_j", message=message.name)
    j1939 = message.is_extended_frame and (asked or message.protocol == "j1939")
    if j1939 and message.length > _CAN_BYTES:
        raise BadValueError("daq.message_bytes_j_sends", message=message.name, length=message.length)
    return j1939
