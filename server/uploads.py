"""Machine files and recordings that clients send: checked first, then stored whole."""

from __future__ import annotations

import hashlib
import secrets
import sys
import threading
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Literal, cast

from daq import ROLES, parse_machine
from server.children import run_child
from server.disk import free_bytes, require_room
from server.errors import (
    ConflictError,
    InvalidError,
    NotFoundError,
    PreconditionError,
    ServiceError,
    UnsupportedFormatError,
)
from server.files import DataDirectory, sync_directory, write_atomically
from server.formats.exports import Exports
from server.machine_reader import MachineReader, ReadMachine
from server.store import Database, MachineRow, Machines, RecordingRow, Recordings

#: Seconds that looking at a recording may take.
INSPECTION_S = 120.0
#: Kinds of files that are taken; all but the first two are kept as Parquet.
ENDINGS = (".csv", ".parquet", ".txt", ".tsv", ".mf4", ".mat", ".db3", ".mcap")


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
        expected: int | None = None,
    ) -> tuple[MachineRow, bool]:
        """Check and store the text of a machine file.

        Parameters
        ----------
        own : whether it was written by this service, so that it can be read here
        protected : machine whose file no upload may change
        expected : the version that the writer knows as the current one (0: none), None where that does not matter

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
            if expected is not None and version is not None and version != expected + 1:
                raise PreconditionError(
                    f"machine '{machine.name}' has version {version - 1} by now, not {expected}; read it and put both "
                    "changes together"
                )
            if version is not None:
                _refuse_protected(machine.name, protected)
                path = self._files.machine_file(machine.name, version)
                write_atomically(path, content)
                self._reader.keep(path, machine.content)
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
        """The machine of a text, and the text's SHA-256."""
        machine = ReadMachine.of(parse_machine(content.decode())) if own else self._reader.read(content)
        if not allowed(machine.name):
            raise NotFoundError(f"there is no machine '{machine.name}' for you; ask an admin to bind you to it")
        return machine, hashlib.sha256(content).hexdigest()


def _refuse_protected(name: str, protected: str | None) -> None:
    if name == protected:
        raise ConflictError(
            f"machine '{name}' is the one that this service simulates: with another file it would look for its buses "
            "elsewhere, and be acquired no more. Recordings of it can be uploaded as they are; for a machine of your "
            "own change name: in the file, or serve without --simulate"
        )


class RecordingUploads:
    """Takes recordings as CSV, Parquet, and as other tools write them (which is kept as Parquet)."""

    def __init__(self, database: Database, files: DataDirectory) -> None:
        self._database = database
        self._recordings = Recordings(database)
        self._machines = Machines(database)
        self._exports = Exports(files)
        self._files = files

    def incoming(self, machine: str, role: str, name: str) -> Path:
        """Where to stream an upload that is named ``name``, before a byte of it is read.

        Raises
        ------
        NotFoundError, InvalidError, UnsupportedFormatError
            If the machine, the role or the kind of file is unknown.
        """
        self._machines.get(machine)
        if role not in ROLES:
            raise InvalidError(f"role '{role}' is unknown; use one of {', '.join(ROLES)}")
        suffix = Path(name).suffix.lower()
        if suffix not in ENDINGS:
            raise UnsupportedFormatError(
                f"'{name}' is none of {', '.join(ENDINGS)}; export the recording as one of them"
            )
        if suffix == ".mf4" and find_spec("asammdf") is None:
            raise UnsupportedFormatError(
                f"'{name}': this service reads no MDF4 (hilfit[export] is not installed); upload .csv or .parquet"
            )
        require_room(free_bytes(self._files.recordings))
        incoming = self._files.incoming()
        return incoming.with_name(incoming.name + suffix)

    def add(
        self,
        incoming: Path,
        machine: str,
        role: str,
        label: str,
        columns: str | None = None,
        resample: bool = False,
    ) -> RecordingRow:
        """Check the file at ``incoming`` and move it into the store; it is gone from there whatever happens.

        Parameters
        ----------
        columns : text of a map of the file's columns (:mod:`daq.column_map`)
        resample : whether another rate is brought to the machine's

        Raises
        ------
        InvalidError
            One line: what is wrong with the recording and what to do.
        """
        try:
            version = self._machines.get(machine).version
            if incoming.suffix not in (".csv", ".parquet") or columns is not None or resample:
                incoming = self._exports.imported(incoming, machine, version, label, columns, resample)
            machine_file = self._files.machine_file(machine, version)
            result = run_child(
                [sys.executable, "-P", "-m", "server.inspect_recording", str(incoming), str(machine_file), role],
                log=self._files.recordings / "inspect.log",
                timeout_s=INSPECTION_S,
            )
            if result.outcome == "input":
                raise InvalidError((result.error or "").replace(str(incoming), label))
            if result.outcome == "failed" and result.error is not None and "ended by" in result.error:
                raise InvalidError(f"{label}: cannot be read; export it again")
            if result.outcome != "done":
                raise ServiceError(f"{label}: looking at it failed; {result.error}")
            id = f"rec-{secrets.token_hex(8)}"
            format = cast(Literal["parquet", "csv"], incoming.suffix.removeprefix("."))
            target = self._files.recordings / f"{id}.{format}"
            size = incoming.stat().st_size
            try:
                incoming.replace(target)
                sync_directory(target.parent)
            except OSError as error:
                raise ConflictError(f"the upload cannot be stored ({error.strerror}); free some space") from None
            row = RecordingRow(
                id=id,
                machine=machine,
                machine_version=version,
                role=role,
                label=label,
                state="sealed",
                origin="uploaded",
                format=format,
                created=self._database.now(),
                bytes=size,
                sha256=result.summary["sha256"],
                statistics=result.summary["statistics"],
                ended=self._database.now(),
            )
            self._recordings.add(row)
            return row
        finally:
            incoming.unlink(missing_ok=True)
