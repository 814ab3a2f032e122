"""Machine files from outside are read by a child with limits, never by the process that serves HTTP."""

from __future__ import annotations

import json
import sys
from collections import OrderedDict
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from daq import Machine
from daq.errors import MachineFileError
from server.machines.inspect_machine import SHOWN_NAME
from server.platform.errors import InvalidError, UnavailableError
from server.platform.files import DataDirectory
from server.platform.processes.children import Child

PROGRAM = (sys.executable, "-P", "-m", "server.machines.inspect_machine")
#: Seconds that the child has for one file, when it has to share its core with everybody.
READING_S = 60.0
#: Machines whose content is kept; versions of a file never change.
KEPT = 64


@dataclass(frozen=True)
class ReadMachine:
    """A machine file that was read: the machine's name, and all that it says, as JSON knows it."""

    name: str
    content: dict[str, Any]

    @classmethod
    def of(cls, machine: Machine) -> ReadMachine:
        """A machine that was read in this process."""
        return cls(machine.name, machine.model_dump(mode="json", by_alias=True, exclude_none=True))


class MachineReader:
    """Reads machine files one at a time.

    Parameters
    ----------
    program : of the child (a test passes its own)
    """

    def __init__(self, files: DataDirectory, program: tuple[str, ...] = PROGRAM) -> None:
        self._files = files
        self._program = program
        self._child = Child()
        # One at a time, and always the same thread: the kernel ends a child with the thread that started it.
        self._thread = ThreadPoolExecutor(1, "machine-reader")
        self._known: OrderedDict[Path, dict[str, Any]] = OrderedDict()

    def read(self, text: bytes) -> ReadMachine:
        """Read the text of a machine file.

        Raises
        ------
        MachineFileError
            One line: line, key, what to do.
        InvalidError
            If reading it took more time or memory than any machine file does.
        """
        source = self._files.incoming()
        target = source.with_name(source.name + ".json")
        try:
            source.write_bytes(text)
            return self._thread.submit(self._read, source, target).result()
        finally:
            source.unlink(missing_ok=True)
            target.unlink(missing_ok=True)

    def content(self, path: Path) -> dict[str, Any]:
        """The content of a version that is stored; kept, since it never changes."""
        known = self.known(path)
        if known is None:
            known = self.read(path.read_bytes()).content
            self.keep(path, known)
        return known

    def known(self, path: Path) -> dict[str, Any] | None:
        """The content of a stored version if it was read before; never waits."""
        return self._known.get(path)

    def keep(self, path: Path, content: dict[str, Any]) -> None:
        """Keep the content of a version that was stored now."""
        self._known[path] = content
        while len(self._known) > KEPT:
            self._known.popitem(last=False)

    def close(self) -> None:
        """End the child."""
        self._thread.submit(self._child.__exit__).result()
        self._thread.shutdown()

    def _read(self, source: Path, target: Path) -> ReadMachine:
        log = self._files.recordings / "inspect.log"
        result = self._child.run(self._program, (str(source), str(target)), log=log, timeout_s=READING_S)
        if result.outcome == "done" and "name" in result.summary:
            return ReadMachine(str(result.summary["name"]), json.loads(target.read_text(encoding="utf-8")))
        refused = result.summary.get("error") or (result.error if result.outcome == "input" else None)
        if refused is not None:
            raise MachineFileError(str(refused))
        if result.error is not None and ("ended by" in result.error or "longer than" in result.error):
            raise InvalidError(f"{SHOWN_NAME}: takes too long to read; make it shorter")
        raise UnavailableError(f"{SHOWN_NAME}: could not be read; {result.error}; try again")
