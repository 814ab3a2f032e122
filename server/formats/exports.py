"""The service's side of files in other forms: children that do the work, and what they leave."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any, Literal

from server.children import run_child
from server.errors import ConflictError, InvalidError, NotFoundError, UnavailableError
from server.files import DataDirectory
from server.store import RecordingRow

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


class Exports:
    """Recordings in other forms."""

    def __init__(self, files: DataDirectory) -> None:
        self._files = files

    def source(self, row: RecordingRow) -> Path:
        """The file of a sealed recording.

        Raises
        ------
        ConflictError, NotFoundError
            If it is not sealed, or its file is gone.
        """
        if row.state != "sealed":
            raise ConflictError(f"recording '{row.id}' is {row.state}; there is no whole file to read")
        path = self._files.recordings / f"{row.id}.{row.format}"
        if not path.is_file():
            raise NotFoundError(f"the file of recording '{row.id}' is gone; record or upload it again")
        return path

    def file(self, row: RecordingRow, format: str) -> tuple[Path, bool]:
        """A file in the form asked for, and whether it is to be removed after use."""
        path = self.source(row)
        if format == row.format:
            return path, False
        target = self._temporary(FORMATS[format][1])
        self._work(format, path, target, row.machine, row.machine_version, row.id)
        return target, True

    def statistics(self, row: RecordingRow) -> dict[str, Any]:
        """What the recording holds; computed once, kept beside it."""
        path = self.source(row)
        kept = self.kept_statistics(row.id)
        if not kept.is_file():
            target = self._temporary(".json")
            try:
                self._work("statistics", path, target, row.machine, row.machine_version, row.id)
                target.replace(kept)
            finally:
                target.unlink(missing_ok=True)
        return dict(json.loads(kept.read_text(encoding="utf-8")))

    def kept_statistics(self, id: str) -> Path:
        """Where the statistics of a recording are kept."""
        return self._files.recordings / f"{id}.statistics.json"

    def from_mdf4(self, incoming: Path, machine: str, version: int, shown: str) -> Path:
        """An uploaded MDF file as Parquet beside it; the uploaded one is removed."""
        target = incoming.with_suffix(".parquet")
        try:
            self._work("read-mdf4", incoming, target, machine, version, shown)
        except BaseException:
            target.unlink(missing_ok=True)
            raise
        finally:
            incoming.unlink(missing_ok=True)
        return target

    def _temporary(self, suffix: str) -> Path:
        path = self._files.incoming()
        return path.with_name(path.name + suffix)

    def _work(self, what: str, source: Path, target: Path, machine: str, version: int, shown: str) -> None:
        machine_file = self._files.machine_file(machine, version)
        result = run_child(
            [sys.executable, "-P", "-m", "server.formats.work", what, *map(str, (source, target, machine_file)), shown],
            log=self._files.recordings / "formats.log",
            timeout_s=WORK_S,
        )
        if result.outcome == "done":
            return
        target.unlink(missing_ok=True)
        error = (result.error or "").replace(str(source), shown)
        if result.outcome == "input" or (what == "read-mdf4" and "ended by" in error):
            raise InvalidError(error if result.outcome == "input" else f"{shown}: cannot be read; export it again")
        raise UnavailableError(error if "pip install" in error else f"{shown}: could not be written as {what}; {error}")
