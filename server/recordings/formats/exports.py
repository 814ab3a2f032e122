"""The service's side of work on recordings' files: children that do it, and what they leave."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from daq.messages import Sentence
from server.platform.errors import ConflictError, InvalidError, NotFoundError, UnavailableError
from server.platform.files import DataDirectory
from server.platform.processes.file_children import FileChildren, refusal
from server.recordings.formats import IMPORTS, map_beside
from server.recordings.recording_store import RecordingRow

Format = Literal["parquet", "csv", "mdf4", "mcap"]
#: Per form its media type and its suffix.
FORMATS: dict[str, tuple[str, str]] = {
    "parquet": ("application/vnd.apache.parquet", ".parquet"),
    "csv": ("text/csv", ".csv"),
    "mdf4": ("application/x-mdf4", ".mf4"),
    "mcap": ("application/x-mcap", ".mcap"),
}
#: Seconds that one piece of work may take.
WORK_S = 300.0
#: The module that writes other forms.
CONVERSIONS = "server.recordings.formats.conversion_child"


class Exports:
    """Recordings in other forms, and what is made of them once and kept beside them."""

    def __init__(self, files: DataDirectory, children: FileChildren) -> None:
        self._files = files
        self._children = children

    def source(self, row: RecordingRow) -> Path:
        """Locate the file of a sealed recording.

        Raises
        ------
        ConflictError, NotFoundError
            If it is not sealed, or its file is gone.
        """
        if row.state != "sealed":
            raise ConflictError("server.recording_not_whole", row=row.id, state=row.state)
        path = self._files.recording(row.id, row.format)
        if not path.is_file():
            raise NotFoundError("server.file_recording_gone", row=row.id)
        return path

    def file(self, row: RecordingRow, format: str) -> Path:
        """Convert it to a new file in another form than it is kept in, to be removed after use."""
        return self.made(row, format, FORMATS[format][1], row.id)

    def statistics(self, row: RecordingRow) -> dict[str, Any]:
        """Compute what the recording holds; once, kept beside it."""
        self.source(row)
        kept = self.kept_statistics(row.id)
        if not kept.is_file():
            self.made(row, "statistics", kept.suffix, row.id).replace(kept)
        return dict(json.loads(kept.read_text(encoding="utf-8")))

    def kept_statistics(self, id: str) -> Path:
        """Locate the kept statistics of a recording."""
        return self._files.recordings / f"{id}.statistics.json"

    def imported(
        self, incoming: Path, machine: str, version: int, shown: str, columns: str | None, resample: bool
    ) -> Path:
        """Import another tool's file as Parquet beside it; the uploaded one is removed.

        Parameters
        ----------
        columns : text of a map of its columns (:mod:`daq.recordings.column_map`)
        resample : whether another rate is brought to the machine's
        """
        target = self._temporary(".parquet")
        try:
            if columns is not None:
                map_beside(incoming).write_text(columns, encoding="utf-8")
            self._work(IMPORTS[resample], incoming, target, machine, version, shown)
        finally:
            map_beside(incoming).unlink(missing_ok=True)
            incoming.unlink(missing_ok=True)
        return target

    def made(self, row: RecordingRow, what: str, suffix: str, shown: str, *rest: str, by: str = CONVERSIONS) -> Path:
        """Make a new file of a recording, to be moved or removed.

        Parameters
        ----------
        what, rest : is made, as ``by`` understands it
        shown : what the recording is called where it is refused
        by : module of the child that makes it

        Raises
        ------
        ConflictError, NotFoundError
            If the recording is not sealed, or its file is gone.
        InvalidError, UnavailableError
            If nothing can be made of it, or not now.
        """
        source, target = self.source(row), self._temporary(suffix)
        self._work(what, source, target, row.machine, row.machine_version, shown, *rest, by=by)
        return target

    def _temporary(self, suffix: str) -> Path:
        path = self._files.incoming()
        return path.with_name(path.name + suffix)

    def _work(
        self, what: str, source: Path, target: Path, machine: str, version: int, *rest: str, by: str = CONVERSIONS
    ) -> None:
        """Let a child write ``target``; there is none if that fails. The first of the ``rest`` names the source."""
        machine_file, shown = self._files.machine_file(machine, version), rest[0]
        log = self._files.recordings / "formats.log"
        try:
            result = self._children.run(by, what, source, target, machine_file, *rest, log=log, timeout_s=WORK_S)
        except BaseException:
            target.unlink(missing_ok=True)
            raise
        if result.outcome == "done":
            return
        target.unlink(missing_ok=True)
        error = (result.error or "").replace(str(source), shown)
        failed = UnavailableError(
            error
            if "pip install" in error
            else Sentence("server.could_not_written", shown=shown, what=what, error=error)
        )
        too_much = InvalidError("server.cannot_read_export", shown=shown) if what in IMPORTS else failed
        raise refusal(replace(result, error=error), too_much, failed)
