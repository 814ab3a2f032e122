"""Recordings of a running service and all files that belong to them."""

from __future__ import annotations

from daq.frames.events import events_path
from server.platform.files import DataDirectory
from server.recordings.recording_store import Recordings


class RecordingDesk:
    """What is done to recordings with all their files."""

    def __init__(self, recordings: Recordings, files: DataDirectory) -> None:
        self._recordings = recordings
        self._files = files

    def delete(self, id: str) -> None:
        """Delete a recording and its files; refused while it is in use."""
        row = self._recordings.get(id)
        self._recordings.delete(id)
        file = self._files.recordings / f"{id}.{row.format}"
        for path in (file, events_path(file)):
            path.unlink(missing_ok=True)
        if row.sha256 is not None:
            self._files.storage.forget(row.sha256)
        for kept in self._files.recordings.glob(f"{id}.*"):  # statistics, what plots are drawn from, findings
            kept.unlink(missing_ok=True)
