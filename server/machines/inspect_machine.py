"""Look at an uploaded machine file in a process of its own (:mod:`server.platform.processes.file_children`).

A text from outside may be hostile; reading it must not cost the process that serves HTTP more than a child. It takes
``SOURCE TARGET``; the validated machine is written to TARGET as JSON.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from daq import parse_machine
from daq.machine.device_files import refuse_files_elsewhere
from daq.messages import Sentence
from server.platform.processes.child_limits import MACHINE_FILE_CPU_S, limit_child
from server.platform.processes.child_speech import ended, send

#: What the file is called in errors: the name that it had is not known here.
SHOWN_NAME = "machine.yaml"


def look(source: Path, target: Path) -> dict[str, str]:
    """Read one machine file; the summary. MachineFileError, one line, if it is none."""
    machine = parse_machine(source.read_bytes().decode("utf-8"), name=SHOWN_NAME)
    refuse_files_elsewhere(machine, SHOWN_NAME)
    target.write_text(machine.model_dump_json(by_alias=True, exclude_none=True), encoding="utf-8")
    return {"name": machine.name}


def main(arguments: Sequence[str]) -> int:
    """Run :func:`look`, with this process limited to what such a file may take; return the exit code."""
    source, target = map(Path, arguments)
    limit_child(MACHINE_FILE_CPU_S, source.stat().st_size)
    too_much = Sentence("server.machine_file_too_large", name=SHOWN_NAME)
    try:
        return ended(lambda: look(source, target), too_much)
    except UnicodeDecodeError:
        send(error=Sentence("server.machine_file_no_text", name=SHOWN_NAME))
        return 2
