"""Read the DBC files of a machine in a process of its own (:mod:`server.platform.processes.file_children`).

Anybody may have written them. It takes ``MACHINE_FILE TARGET [NAME INCOMING]``; the machine's buses with their
signals are written to TARGET as JSON, with INCOMING as if that file had come in place of NAME. Paths in errors begin at
the machine file's folder.
"""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel, Field

from daq import Machine, parse_machine
from daq.errors import MachineFileError
from daq.machine.buses import CanSignalsBus, SignalSource
from daq.machine.can_database import is_j1939, listed_in, pgn_of, read_database, unusual_units
from daq.machine.device_files import LARGEST, named_files, refuse_files_elsewhere
from daq.messages import Sentence, message_of, messages_in
from server.can_signals.can_signals_schemas import CanSignal
from server.platform.http.bodies import finite
from server.platform.processes.child_limits import DBC_CPU_S, limit_child
from server.platform.processes.child_speech import ended

if TYPE_CHECKING:
    from cantools.database.can import Database, Message, Signal

    from daq.machine.machine_file import Channel, Machine

#: Signals of a bus that are listed, and characters of a name; the largest files in use have less of both.
MOST, LONGEST = 20_000, 128
#: Values of a multiplexer that are listed for one signal, and characters of a unit.
MOST_VALUES, LONGEST_UNIT = 32, 40


class OfferedFile(BaseModel):
    """A file that a bus names: how many messages and signals it has, or why it cannot be read (one line)."""

    name: str
    messages: int = 0
    signals: int = 0
    error: str | None = None
    error_message: dict[str, Any] | None = None


class OfferedBus(BaseModel):
    """A bus: its files, their signals, what is wrong with channels (lines), and how many signals are not listed.

    ``messages``: what problems and errors of files were made of, by their text.
    """

    name: str
    files: list[OfferedFile] = Field(default_factory=list)
    signals: list[CanSignal] = Field(default_factory=list)
    problems: list[str] = Field(default_factory=list)
    messages: dict[str, Any] = Field(default_factory=dict)
    left_out: int = 0


def offered_signals(machine: Machine) -> list[OfferedBus]:
    """List every signal of the machine's buses of plain CAN or J1939; an unreadable file's entry is its error."""
    return [_bus(machine, bus) for bus in machine.buses if isinstance(bus, CanSignalsBus)]


def _bus(machine: Machine, bus: CanSignalsBus) -> OfferedBus:
    offered = OfferedBus(name=bus.name)
    databases: list[tuple[str, Database]] = []
    for path in bus.dbc:
        file = OfferedFile(name=path)
        offered.files.append(file)
        try:
            database = read_database(path, bus.name)
        except MachineFileError as error:
            file.error, file.error_message = str(error), message_of(str(error))
            continue
        databases.append((path, database))
        file.messages = len(database.messages)
        file.signals = sum(len(message.signals) for message in database.messages)
    channels = [c for c in machine.channels if isinstance(c.source, SignalSource) and c.source.bus == bus.name]
    used = _used(machine, [database for _, database in databases], channels, offered)
    _list(offered, databases, used)
    offered.messages = messages_in([*offered.problems, *(file.error for file in offered.files)])
    return offered


def _used(
    machine: Machine, databases: Sequence[Database], channels: Sequence[Channel], offered: OfferedBus
) -> dict[tuple[str, str], list[str]]:
    """Map message and signal to channels; what is wrong with them goes into ``offered``."""
    if len(databases) < len(offered.files):  # a channel's message may be in the file that cannot be read
        offered.problems += [file.error for file in offered.files if file.error is not None]
    listed, problems = listed_in(databases, channels)
    if len(databases) == len(offered.files):
        offered.problems += [line for _, line in (*problems, *unusual_units(machine, listed, channels))]
    used: dict[tuple[str, str], list[str]] = {}
    for one in listed:
        for wanted in one.wanted:
            used.setdefault((one.message.name, wanted.signal.name), []).append(channels[wanted.position].name)
    return used


def _list(
    offered: OfferedBus, databases: Sequence[tuple[str, Database]], used: dict[tuple[str, str], list[str]]
) -> None:
    every = list(_every(databases))
    named = Counter((message.name, signal.name) for _, message, signal in every)
    grouped = Counter((pgn_of(m.frame_id), s.name) for _, m, s in every if m.is_extended_frame)
    # Those in use are never left out.
    for file, message, signal in sorted(every, key=lambda one: (one[1].name, one[2].name) not in used):
        if len(offered.signals) >= MOST or max(len(message.name), len(signal.name)) > LONGEST:
            offered.left_out += 1
            continue
        keys, refusal = _source(message, signal, named, grouped)
        j1939 = message.is_extended_frame and message.protocol == "j1939"
        offered.signals.append(
            CanSignal(
                bus=offered.name, file=file, message=message.name, signal=signal.name,
                frame_id=message.frame_id, extended=message.is_extended_frame,
                pgn=pgn_of(message.frame_id) if j1939 else None, message_bytes=message.length,
                start_bit=signal.start, bits=signal.length,
                byte_order="big" if signal.byte_order == "big_endian" else "little",
                signed=signal.is_signed, is_float=signal.is_float,
                factor=finite(signal.scale), offset=finite(signal.offset), unit=(signal.unit or "")[:LONGEST_UNIT],
                minimum=finite(signal.minimum), maximum=finite(signal.maximum),
                selects=signal.is_multiplexer, multiplexer=signal.multiplexer_signal,
                multiplexer_values=list(signal.multiplexer_ids or ())[:MOST_VALUES],
                cycle_ms=message.cycle_time or None, channels=used.get((message.name, signal.name), []),
                source=None if keys is None else {"bus": offered.name, **keys}, refusal=refusal,
            )
        )  # fmt: skip


def _every(databases: Sequence[tuple[str, Database]]) -> Iterator[tuple[str, Message, Signal]]:
    for file, database in databases:
        for message in database.messages:
            if not message.is_container:
                for signal in message.signals:
                    yield file, message, signal


def _source(
    message: Message, signal: Signal, named: Counter[tuple[str, str]], grouped: Counter[tuple[int, str]]
) -> tuple[dict[str, Any] | None, str | None]:
    """Return keys that mean a signal and no other, or why there are none."""
    source = SignalSource(bus="any", signal=signal.name, message=message.name)
    try:
        j1939 = is_j1939(message, source)
    except ValueError as error:
        return None, str(error)
    pgn = pgn_of(message.frame_id)
    if j1939 and grouped[pgn, signal.name] == 1:
        return {"pgn": pgn, "signal": signal.name}, None
    if named[message.name, signal.name] == 1:
        return {"message": message.name, "signal": signal.name}, None
    return None, Sentence("server.signal_more_than_once", signal=signal.name, message=message.name)


def look(machine_file: Path, target: Path, name: str | None = None, incoming: Path | None = None) -> None:
    """Read a machine's files, and write what is in them.

    Raises
    ------
    MachineFileError
        If the machine file cannot be read or names files elsewhere; what is wrong with a DBC file is written.
    """
    machine = parse_machine(machine_file.read_text(encoding="utf-8"))
    refuse_files_elsewhere(machine, "machine.yaml")
    os.chdir(machine_file.parent)
    paths = [Path(path) for _, path in named_files(machine)]
    limit_child(DBC_CPU_S, LARGEST + sum(path.stat().st_size for path in paths if path.is_file()))
    text = json.dumps([bus.model_dump(mode="json") for bus in offered_signals(_replaced(machine, name, incoming))])
    if name is not None and incoming is not None:
        text = text.replace(json.dumps(str(incoming))[1:-1], json.dumps(name)[1:-1])
    target.write_text(text, encoding="utf-8")


def _replaced(machine: Machine, name: str | None, incoming: Path | None) -> Machine:
    """Replace a file of the machine by another one."""
    if name is None or incoming is None:
        return machine
    buses = [
        bus.model_copy(update={"dbc": tuple(str(incoming) if path == name else path for path in bus.dbc)})
        if isinstance(bus, CanSignalsBus)
        else bus
        for bus in machine.buses
    ]
    return machine.model_copy(update={"buses": tuple(buses)})


def main(arguments: Sequence[str]) -> int:
    """Read what the arguments name; returns the exit code."""
    machine_file, target, *change = arguments
    name, incoming = (change[0], Path(change[1])) if change else (None, None)
    too_much = Sentence("server.takes_too_much_memory")
    return ended(lambda: look(Path(machine_file), Path(target), name, incoming), too_much)
