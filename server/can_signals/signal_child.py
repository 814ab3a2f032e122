"""Read the DBC files of a machine in a process of its own (:mod:`server.platform.processes.file_children`).

Anybody may have written them. It is told ``MACHINE_FILE TARGET [NAME INCOMING]``; the machine's buses with their
signals are written to TARGET as JSON, with INCOMING as if that file had come in place of NAME. Paths in errors begin at
the machine file's folder.
"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path

from daq import Machine, parse_machine
from daq.machine.buses import CanSignalsBus
from daq.machine.device_files import LARGEST, named_files, refuse_files_elsewhere
from daq.messages import Sentence
from server.can_signals.signal_listing import offered_signals
from server.platform.processes.child_limits import DBC_CPU_S, limit_child
from server.platform.processes.child_speech import ended


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
