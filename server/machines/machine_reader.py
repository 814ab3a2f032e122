"""Machine files from outside are read by a child with limits, never by the process that serves HTTP."""

from __future__ import annotations

import json
from collections import OrderedDict
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from daq import Machine
from daq.messages import Sentence
from server.machines.inspect_machine import SHOWN_NAME
from server.platform.errors import InvalidError, UnavailableError
from server.platform.files import DataDirectory
from server.platform.processes.file_children import FileChildren, refusal

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
        """Describe a machine that was read in this process."""
        return cls(machine.name, machine.model_dump(mode="json", by_alias=True, exclude_none=True))


class MachineReader:
    """Reads machine files, each in a process of its own."""

    def __init__(self, files: DataDirectory, children: FileChildren) -> None:
        self._files = files
        self._children = children
        self._known: OrderedDict[Path, dict[str, Any]] = OrderedDict()

    def read(self, text: bytes) -> ReadMachine:
        """Read the text of a machine file.

        Raises
        ------
        InvalidError
            One line: line, key, what to do; or that reading it took more time or memory than any machine file does.
        """
        source = self._files.incoming()
        target = source.with_name(source.name + ".json")
        log = self._files.recordings / "inspect.log"
        try:
            source.write_bytes(text)
            result = self._children.run("server.machines.inspect_machine", source, target, log=log, timeout_s=READING_S)
            if result.outcome == "done":
                return ReadMachine(result.summary["name"], json.loads(target.read_text(encoding="utf-8")))
        finally:
            source.unlink(missing_ok=True)
            target.unlink(missing_ok=True)
        raise refusal(
            result,
            InvalidError(Sentence("server.takes_too_long_read", shown_name=SHOWN_NAME)),
            UnavailableError(Sentence("server.could_not_read", shown_name=SHOWN_NAME, error=result.error)),
        )

    def content(self, path: Path) -> dict[str, Any]:
        """Return the content of a version that is stored; cached, since it never changes."""
        known = self.known(path)
        if known is None:
            known = self.read(path.read_bytes()).content
            self.keep(path, known)
        return known

    def known(self, path: Path) -> dict[str, Any] | None:
        """Return the content of a stored version if it was read before; never wait."""
        return self._known.get(path)

    def keep(self, path: Path, content: dict[str, Any]) -> None:
        """Keep the content of a version that was stored now."""
        self._known[path] = content
        while len(self._known) > KEPT:
            self._known.popitem(last=False)
