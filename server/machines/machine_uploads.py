"""Machine files that clients send: read by a child with limits, checked, then stored whole."""

from __future__ import annotations

import hashlib
import json
import re
import threading
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import Any

from daq.machine.machine_file import machine_content, parse_machine
from daq.whole_files import write_whole
from server.machines.inspect_machine import SHOWN_NAME
from server.machines.machine_store import MachineRow, Machines
from server.platform.database.engine import Database
from server.platform.errors import ConflictError, InvalidError, NotFoundError, PreconditionError, UnavailableError
from server.platform.files import DataDirectory
from server.platform.http.route_parameters import Tags
from server.platform.processes.file_children import FileChildren, refusal

#: Seconds that the child has for one file, when it has to share its core with everybody.
READING_S = 60.0
#: Machines whose content is kept; versions of a file never change.
KEPT = 64


class MachineReader:
    """Reads machine files, each in a process of its own."""

    def __init__(self, files: DataDirectory, children: FileChildren) -> None:
        self._files = files
        self._children = children
        self._known: OrderedDict[Path, dict[str, Any]] = OrderedDict()

    def read(self, text: bytes) -> dict[str, Any]:
        """Read the text of a machine file; all that it says, as JSON knows it.

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
                return dict(json.loads(target.read_text(encoding="utf-8")))
        finally:
            source.unlink(missing_ok=True)
            target.unlink(missing_ok=True)
        raise refusal(
            result,
            InvalidError("server.takes_too_long_read", shown_name=SHOWN_NAME),
            UnavailableError("server.could_not_read", shown_name=SHOWN_NAME, error=result.error),
        )

    def content(self, path: Path) -> dict[str, Any]:
        """Return the content of a version that is stored; cached, since it never changes."""
        known = self.known(path)
        if known is None:
            known = self.read(path.read_bytes())
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


#: Where a simulated bus is: other ports and pseudo-terminals at each start, and nothing that the machine is.
_ADDRESS = re.compile(rb"^\s*port: \S+\n", re.MULTILINE)


class MachineUploads:
    """Takes machine files; every change of a machine's file is a version of its own."""

    def __init__(self, database: Database, files: DataDirectory, reader: MachineReader) -> None:
        self._machines = Machines(database)
        self._files = files
        self._reader = reader
        self._lock = threading.Lock()  # two uploads of one machine must not take the same version number

    def add(
        self,
        content: bytes,
        *,
        acquire: bool = False,
        own: bool = False,
        allowed: Callable[[str], bool] = lambda name: True,
        protected: str | None = None,
        expected: Tags = None,
    ) -> tuple[MachineRow, bool]:
        """Check and store the text of a machine file.

        Parameters
        ----------
        own : whether it was written by this service, so that it can be read here
        protected : machine whose file no upload may change
        expected : the versions that the writer knows (0: none), None where that does not matter

        Returns
        -------
        The machine, and whether a version was made (False: the file is the current version already).

        Raises
        ------
        InvalidError, daq.errors.MachineFileError
            One line: line, key, what to do.
        PreconditionError
            If another version than ``expected`` is the current one.
        ConflictError
            If it would change the ``protected`` machine.
        """
        name, machine, digest = self._parsed(content, allowed, own)
        with self._lock:
            version = self._machines.next_version(name, digest)
            if expected is not None and version is not None and str(version - 1) not in expected:
                known = " or ".join(sorted(expected))
                raise PreconditionError(
                    "server.machine_version_now_not", machine=name, version=version - 1, known=known
                )
            if version is not None:
                _refuse_protected(name, protected)
            if version is not None or own:  # our own, the same machine as before the restart: its buses are elsewhere
                current = version or self._machines.get(name).version
                path = self._files.machine_file(name, current)
                write_whole(path, content)
                self._reader.keep(path, machine)
            if version is not None:
                self._machines.add(name, version, digest, acquire=acquire)
        return self._machines.get(name), version is not None

    def check(self, content: bytes, allowed: Callable[[str], bool], protected: str | None = None) -> tuple[str, int]:
        """Check the text of a machine file; the machine's name, and the version that it would be.

        Raises
        ------
        What :meth:`add` raises for the same text.
        """
        name, _, digest = self._parsed(content, allowed)
        version = self._machines.next_version(name, digest)
        if version is None:
            return name, self._machines.get(name).version
        _refuse_protected(name, protected)
        return name, version

    def _parsed(
        self, content: bytes, allowed: Callable[[str], bool], own: bool = False
    ) -> tuple[str, dict[str, Any], str]:
        """Parse a text: the machine's name, all that it says, and its SHA-256, of our own without its buses' places."""
        machine = machine_content(parse_machine(content.decode())) if own else self._reader.read(content)
        name = str(machine["name"])
        if not allowed(name):
            raise NotFoundError("server.no_machine_you", machine=name)
        return name, machine, hashlib.sha256(_ADDRESS.sub(b"", content) if own else content).hexdigest()


def _refuse_protected(name: str, protected: str | None) -> None:
    if name == protected:
        raise ConflictError("server.machine_service_simulates_another", name=name)
