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

from daq import Machine, parse_machine
from daq.errors import MachineFileError
from daq.machine.buses import CanSignalsBus, SignalSource
from daq.machine.can_database import is_j1939, listed_in, pgn_of, read_database, unusual_units
from daq.machine.device_files import LARGEST, named_files, refuse_files_elsewhere
from daq.messages import Sentence, messages_in
from server.can_signals.can_signals_schemas import CanBus, CanFile, CanSignal
from server.platform.http.bodies import finite
from server.platform.processes.child_limits import DBC_CPU_S, limit_child
from server.platform.processes.child_speech import ended

if TYPE_CHECKING:
    from cantools.database.can import Database, Message, Signal

    from daq.machine.machine_file import Machine

#: Signals of a bus that are listed, and characters of a name; the largest files in use have less of both.
MOST, LONGEST = 20_000, 128
#: Values of a multiplexer that are listed for one signal, and characters of a unit.
MOST_VALUES, LONGEST_UNIT = 32, 40


class OfferedBus(CanBus):
    """A bus with its files, whose digests are the reader's to add, and their signals."""

    signals: list[CanSignal]


def offered_signals(machine: Machine) -> list[OfferedBus]:
    """List every signal of the machine's buses of plain CAN or J1939; an unreadable file's entry is its error."""
    return [_bus(machine, bus) for bus in machine.buses if isinstance(bus, CanSignalsBus)]


def _bus(machine: Machine, bus: CanSignalsBus) -> OfferedBus:
    files = [_file(path, bus.name) for path in bus.dbc]
    databases = [(file.name, database) for file, database in files if database is not None]
    errors = [file.sentence("error") for file, _ in files if file.error is not None]
    channels = [c for c in machine.channels if isinstance(c.source, SignalSource) and c.source.bus == bus.name]
    listed, wrong = listed_in([database for _, database in databases], channels)
    # A channel's message may be in a file that cannot be read.
    problems = errors or [line for _, line in (*wrong, *unusual_units(machine, listed, channels))]
    used: dict[tuple[str, str], list[str]] = {}
    for one in listed:
        for wanted in one.wanted:
            used.setdefault((one.message.name, wanted.signal.name), []).append(channels[wanted.position].name)
    signals, left_out = _signals(bus.name, databases, used)
    return OfferedBus(
        name=bus.name,
        files=[file for file, _ in files],
        signals=signals,
        problems=problems,
        messages=messages_in([*problems, *errors]),
        left_out=left_out,
    )


def _file(path: str, bus: str) -> tuple[CanFile, Database | None]:
    """Count what is in a file that a bus names, or note why it cannot be read."""
    try:
        database = read_database(path, bus)
    except MachineFileError as error:
        return CanFile(name=path, sha256=None, messages=0, signals=0, error=str(error)), None
    signals = sum(len(message.signals) for message in database.messages)
    return CanFile(name=path, sha256=None, messages=len(database.messages), signals=signals, error=None), database


def _signals(
    bus: str, databases: Sequence[tuple[str, Database]], used: dict[tuple[str, str], list[str]]
) -> tuple[list[CanSignal], int]:
    """List signals of a bus, those that channels ``used`` first, and count those that are not listed."""
    signals: list[CanSignal] = []
    left_out = 0
    every = list(_every(databases))
    named = Counter((message.name, signal.name) for _, message, signal in every)
    grouped = Counter((pgn_of(m.frame_id), s.name) for _, m, s in every if m.is_extended_frame)
    # Those in use are never left out.
    for file, message, signal in sorted(every, key=lambda one: (one[1].name, one[2].name) not in used):
        if len(signals) >= MOST or max(len(message.name), len(signal.name)) > LONGEST:
            left_out += 1
            continue
        keys, refusal = _source(message, signal, named, grouped)
        j1939 = message.is_extended_frame and message.protocol == "j1939"
        signals.append(
            CanSignal(
                bus=bus, file=file, message=message.name, signal=signal.name,
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
                source=None if keys is None else {"bus": bus, **keys}, refusal=refusal,
            )
        )  # fmt: skip
    return signals, left_out


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
