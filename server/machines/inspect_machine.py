"""Look at an uploaded machine file in a process of its own.

``python -m server.machines.inspect_machine SOURCE TARGET``, then more of the same orders on standard input.

A text from outside may be hostile; reading it must not cost the process that serves HTTP more than a child. The
validated machine is written to TARGET as JSON. Speaks the protocol of :mod:`server.platform.processes.children`, and
stays, since loading what reads a machine file takes longer than reading one.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from daq import InputError, parse_machine
from daq.machine.device_files import refuse_files_elsewhere
from server.platform.processes.child_limits import MACHINE_FILE_CPU_S, limit_child
from server.platform.processes.child_speech import say

#: What the file is called in errors: the name that it had is not known here.
SHOWN_NAME = "machine.yaml"


def look(source: Path, target: Path) -> dict[str, object]:
    """Read one machine file; the last line for the parent."""
    limit_child(MACHINE_FILE_CPU_S, source.stat().st_size)
    try:
        machine = parse_machine(source.read_bytes().decode("utf-8"), name=SHOWN_NAME)
        refuse_files_elsewhere(machine, SHOWN_NAME)
    except UnicodeDecodeError:
        return {"error": f"{SHOWN_NAME}: is not text in UTF-8; send the text of a machine file"}
    except InputError as error:
        return {"error": str(error)}
    target.write_text(machine.model_dump_json(by_alias=True, exclude_none=True), encoding="utf-8")
    return {"name": machine.name}


def main(arguments: list[str]) -> int:
    """Take orders until standard input ends; returns the exit code."""
    while True:
        source, target = arguments
        try:
            found = look(Path(source), Path(target))
        except (MemoryError, RecursionError):  # what is left of this process is not worth keeping
            say(error=f"{SHOWN_NAME}: takes too much memory to read; make it shorter")
            return 2
        say(summary=found, stays=True)
        line = sys.stdin.readline()
        if not line:
            return 0
        arguments = json.loads(line)["arguments"]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
