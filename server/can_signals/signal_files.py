"""The DBC files beside a machine's file: read by a child with limits, given out, and replaced."""

from __future__ import annotations

import hashlib
import json
import threading
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import Any

from daq.machine.can_database import SUFFIXES
from daq.messages import Sentence, with_messages
from daq.whole_files import write_whole
from server.machines.acquisition import Acquisition
from server.machines.machine_reader import MachineReader
from server.machines.machine_store import MachineRow, Machines
from server.platform.errors import (
    ConflictError,
    InvalidError,
    NotFoundError,
    PreconditionError,
    UnavailableError,
    UnsupportedFormatError,
)
from server.platform.files import DataDirectory
from server.platform.http.route_parameters import NONE_YET, Tags
from server.platform.processes.file_children import FileChildren, refusal

#: Seconds that the child has, when it has to share its core with everybody.
READING_S = 180.0
#: Machines whose signals are kept.
KEPT = 8
_Key = tuple[Path, tuple[tuple[str, int, int], ...]]


class SignalFiles:
    """DBC files of machines.

    Parameters
    ----------
    recorded : id of the recording that is being made of a machine, None without one
    """

    def __init__(
        self,
        files: DataDirectory,
        machines: Machines,
        reader: MachineReader,
        acquisition: Acquisition,
        recorded: Callable[[str], str | None],
        children: FileChildren,
    ) -> None:
        self._files = files
        self._children = children
        self._machines = machines
        self._reader = reader
        self._acquisition = acquisition
        self._recorded = recorded
        self._kept: OrderedDict[_Key, list[dict[str, Any]]] = OrderedDict()
        self._replacing = threading.Lock()  # two uploads must not both be the next one

    def buses(self, machine: str) -> tuple[MachineRow, list[dict[str, Any]]]:
        """Return a machine, and its buses of plain CAN or J1939 as :class:`.signal_listing.OfferedBus`.

        Raises
        ------
        InvalidError
            If reading them took more time or memory than any DBC file does.
        """
        row = self._machines.get(machine)
        path = self._files.machine_file(machine, row.version)
        names = self._names(row)
        key = (path, tuple(_state(path.parent / name) for name in names))
        found = self._kept.get(key)
        if found is None:
            found = self._read(path, None) if names else []
            self._kept[key] = found
            while len(self._kept) > KEPT:
                self._kept.popitem(last=False)
        return row, found

    def digest(self, machine: str, name: str) -> str | None:
        """Compute SHA-256 of a file, None if it is not there."""
        path = self._files.machines / machine / name
        return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else None

    def path(self, machine: str, name: str) -> Path:
        """Locate a file that the machine's file names; NotFoundError if it names no such file."""
        row = self._machines.get(machine)
        if name not in self._names(row):
            raise NotFoundError(Sentence("server.file_machine_names_no", machine=machine))
        return self._files.machines / machine / name

    def incoming(self, machine: str, name: str) -> Path:
        """Return a new name for an upload that is to replace a file.

        Raises
        ------
        NotFoundError
            If the machine's file does not name it.
        UnsupportedFormatError
            If its name has no ending of a DBC file.
        """
        path = self.path(machine, name)
        if path.suffix.lower() not in SUFFIXES:
            raise UnsupportedFormatError(Sentence("server.file_name_not_end", suffixes=", ".join(SUFFIXES)))
        made = self._files.incoming()
        return made.with_name(made.name + path.suffix)

    def replace(self, incoming: Path, machine: str, name: str, expected: Tags) -> str:
        """Put an upload in the place of a file; its SHA-256. The upload is gone afterwards.

        Parameters
        ----------
        expected : SHA-256 of files that the sender knows ("0": none), None where that does not matter

        Raises
        ------
        InvalidError
            If it is no such file, or channels could not come from it; one line.
        PreconditionError
            If another file is there by now.
        ConflictError
            If the machine is being recorded.
        """
        try:
            row = self._machines.get(machine)
            path = self.path(machine, name)
            self._refuse_unusable(row, name, incoming)
            with self._replacing:
                if expected is not None and not expected & {self.digest(machine, name) or NONE_YET}:
                    raise PreconditionError(Sentence("server.somebody_replaced_meanwhile", name=name))
                recording = self._recorded(machine)
                if recording is not None:
                    raise ConflictError(Sentence("server.machine_being_recorded", machine=machine, recording=recording))
                write_whole(path, incoming.read_bytes())
            if row.acquire:
                self._acquisition.start(machine, self._files.machine_file(machine, row.version))
            return str(self.digest(machine, name))
        finally:
            incoming.unlink(missing_ok=True)

    def _refuse_unusable(self, row: MachineRow, name: str, incoming: Path) -> None:
        """Raise InvalidError if a file cannot be read, or takes signals from channels that had them."""
        path = self._files.machine_file(row.name, row.version)
        before = {line for bus in self.buses(row.name)[1] for line in bus["problems"]}
        for bus in self._read(path, (name, incoming)):
            errors = [file["error"] for file in bus["files"] if file["name"] == name and file["error"] is not None]
            worse = [line for line in bus["problems"] if line not in before]
            if errors or worse:
                raise InvalidError(with_messages((errors or worse)[0], bus["messages"]))

    def _names(self, row: MachineRow) -> list[str]:
        """List DBC files that a machine's file names, each once."""
        path = self._files.machine_file(row.name, row.version)
        if not path.is_file():
            raise NotFoundError(Sentence("server.file_machine_gone", row=row.name))
        buses = self._reader.content(path).get("buses", ())
        return list(dict.fromkeys(name for bus in buses if bus["type"] == "can_signals" for name in bus["dbc"]))

    def _read(self, machine_file: Path, change: tuple[str, Path] | None) -> list[dict[str, Any]]:
        target, log = self._files.incoming(), self._files.recordings / "inspect.log"
        arguments = (machine_file, target, *(change or ()))
        try:
            result = self._children.run("server.can_signals.signal_child", *arguments, log=log, timeout_s=READING_S)
            if result.outcome == "done":
                content: list[dict[str, Any]] = json.loads(target.read_text(encoding="utf-8"))
                return content
        finally:
            target.unlink(missing_ok=True)
        if result.outcome == "input":
            raise InvalidError(Sentence("server.dbc_files", error=result.error))
        raise refusal(
            result,
            InvalidError(Sentence("server.dbc_files_take_too")),
            UnavailableError(Sentence("server.dbc_files_could_not", error=result.error)),
        )


def _state(path: Path) -> tuple[str, int, int]:
    """Return what changes when a file is replaced."""
    try:
        found = path.stat()
    except OSError:
        return str(path), 0, 0
    return str(path), found.st_mtime_ns, found.st_size
