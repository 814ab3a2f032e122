"""Recordings that clients send: checked first, then stored whole; and deleted with all their files."""

from __future__ import annotations

import secrets
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal, cast

from daq import ROLES
from daq.frames.events import events_path
from daq.messages import Sentence
from daq.whole_files import sync_directory
from server.machines.machine_store import Machines
from server.platform.database.engine import Database
from server.platform.errors import ConflictError, InvalidError, UnavailableError, UnsupportedFormatError
from server.platform.files import DataDirectory, Free, require_room
from server.platform.processes.children import ChildResult
from server.platform.processes.file_children import FileChildren, refusal
from server.recordings.formats.exports import Exports
from server.recordings.recording_store import RecordingRow, Recordings

#: Seconds that looking at a recording may take, beside whatever else the computer does.
INSPECTION_S = 300.0
#: Kinds of files that are taken; all but the first two are kept as Parquet.
ENDINGS = (".csv", ".parquet", ".txt", ".tsv", ".mf4", ".mat", ".db3", ".mcap")


class RecordingUploads:
    """Takes recordings as CSV, Parquet, and as other tools write them (which is kept as Parquet)."""

    def __init__(self, database: Database, files: DataDirectory, children: FileChildren, free: Free) -> None:
        self._database = database
        self._recordings = Recordings(database)
        self._machines = Machines(database)
        self._exports = Exports(files, children)
        self._files = files
        self._children = children
        self._free = free

    def incoming(self, machine: str, role: str, name: str, length: int = 0) -> Path:
        """Return where to stream an upload that is named ``name``, before a byte of it is read.

        Parameters
        ----------
        length : bytes that it declares; 0 if it does not

        Raises
        ------
        NotFoundError, InvalidError, UnsupportedFormatError
            If the machine, the role or the kind of file is unknown.
        ConflictError
            If the disk has no room for it.
        """
        self._machines.get(machine)
        if role not in ROLES:
            raise InvalidError("server.role_unknown", role=role, roles=", ".join(ROLES))
        suffix = Path(name).suffix.lower()
        if suffix not in ENDINGS:
            raise UnsupportedFormatError("server.file_kind_unknown", name=name, endings=", ".join(ENDINGS))
        if suffix == ".mf4" and find_spec("asammdf") is None:
            raise UnsupportedFormatError("server.service_reads_no_mdf", name=name)
        require_room(self._free(), length)
        incoming = self._files.incoming()
        return incoming.with_name(incoming.name + suffix)

    def room(self) -> None:
        """Raise ConflictError if an upload that is being received has to end."""
        require_room(self._free())

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
        columns : text of a map of the file's columns (:mod:`daq.recordings.column_map`)
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
            result = self._inspected(incoming, machine, version, role, label)
            id = f"rec-{secrets.token_hex(8)}"
            format = cast(Literal["parquet", "csv"], incoming.suffix.removeprefix("."))
            target = self._files.recording(id, format)
            size = incoming.stat().st_size
            _moved(incoming, target)
            statistics = result.summary["statistics"]
            alike = self._recordings.with_digest(machine, result.summary["sha256"])
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
                statistics={**statistics, "findings": [*statistics["findings"], *_same_file(alike)]},
                ended=self._database.now(),
            )
            self._recordings.add(row)
            return row
        finally:
            incoming.unlink(missing_ok=True)

    def delete(self, id: str) -> None:
        """Delete a recording and all its files; ConflictError while it is in use."""
        row = self._recordings.get(id)
        self._recordings.delete(id)
        file = self._files.recording(id, row.format)
        for path in (file, events_path(file)):
            path.unlink(missing_ok=True)
        if row.sha256 is not None:
            self._files.storage.forget(row.sha256)
        for kept in self._files.recordings.glob(f"{id}.*"):  # statistics, what plots are drawn from, findings
            kept.unlink(missing_ok=True)

    def _inspected(self, file: Path, machine: str, version: int, role: str, label: str) -> ChildResult:
        """Inspect a file in a process of its own; InvalidError if it is no good recording."""
        machine_file = self._files.machine_file(machine, version)
        log = self._files.recordings / "inspect.log"
        result = self._children.run(
            "server.recordings.inspect_recording", file, machine_file, role, log=log, timeout_s=INSPECTION_S
        )
        if result.outcome == "done":
            return result
        raise refusal(
            replace(result, error=(result.error or "").replace(str(file), label)),
            InvalidError("server.cannot_read_export", shown=label),
            UnavailableError("server.looking_failed", label=label, error=result.error),
        )


def _same_file(other: str | None) -> list[dict[str, Any]]:
    """Report a file that is there already, in the form of what the checks find."""
    if other is None:
        return []
    texts = {"text": Sentence("server.same_file", other=other), "cure": Sentence("server.delete_one_of_two")}
    made_of = {f"{name}_message": text.to_json() for name, text in texts.items()}
    place = {"code": "same_file", "severity": "note", "joint": None, "channel": None, "recording": None}
    return [place | texts | made_of]


def _moved(incoming: Path, target: Path) -> None:
    try:
        incoming.replace(target)
        sync_directory(target.parent)
    except OSError as error:
        raise ConflictError("server.upload_cannot_stored_free", reason=error.strerror) from None
