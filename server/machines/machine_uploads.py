"""Machine files that clients send: checked first, then stored whole."""

from __future__ import annotations

import hashlib
import re
import threading
from collections.abc import Callable

from daq import parse_machine
from daq.messages import Sentence
from daq.whole_files import write_whole
from server.machines.machine_reader import MachineReader, ReadMachine
from server.machines.machine_store import MachineRow, Machines
from server.platform.database.engine import Database
from server.platform.errors import (
    ConflictError,
    NotFoundError,
    PreconditionError,
)
from server.platform.files import DataDirectory
from server.platform.http.route_parameters import Tags

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
        machine, digest = self._parsed(content, allowed, own)
        with self._lock:
            version = self._machines.next_version(machine.name, digest)
            if expected is not None and version is not None and str(version - 1) not in expected:
                known = " or ".join(sorted(expected))
                raise PreconditionError(
                    Sentence("server.machine_version_now_not", machine=machine.name, version=version - 1, known=known)
                )
            if version is not None:
                _refuse_protected(machine.name, protected)
            if version is not None or own:  # our own, the same machine as before the restart: its buses are elsewhere
                current = version or self._machines.get(machine.name).version
                path = self._files.machine_file(machine.name, current)
                write_whole(path, content)
                self._reader.keep(path, machine.content)
            if version is not None:
                self._machines.add(machine.name, version, digest, acquire=acquire)
        return self._machines.get(machine.name), version is not None

    def check(self, content: bytes, allowed: Callable[[str], bool], protected: str | None = None) -> tuple[str, int]:
        """Check the text of a machine file; the machine's name, and the version that it would be.

        Raises
        ------
        What :meth:`add` raises for the same text.
        """
        machine, digest = self._parsed(content, allowed)
        version = self._machines.next_version(machine.name, digest)
        if version is None:
            return machine.name, self._machines.get(machine.name).version
        _refuse_protected(machine.name, protected)
        return machine.name, version

    def _parsed(self, content: bytes, allowed: Callable[[str], bool], own: bool = False) -> tuple[ReadMachine, str]:
        """Parse a text's machine, and its SHA-256; one of our own without its buses' places in this run."""
        machine = ReadMachine.of(parse_machine(content.decode())) if own else self._reader.read(content)
        if not allowed(machine.name):
            raise NotFoundError(Sentence("server.no_machine_you", machine=machine.name))
        return machine, hashlib.sha256(_ADDRESS.sub(b"", content) if own else content).hexdigest()


def _refuse_protected(name: str, protected: str | None) -> None:
    if name == protected:
        raise ConflictError(Sentence("server.machine_service_simulates_another", name=name))
