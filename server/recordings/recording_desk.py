"""Recordings of a running service and all files that belong to them."""

from __future__ import annotations

from collections.abc import Callable

import sqlalchemy as sa

from daq.frames.events import events_path
from server.platform.files import DataDirectory
from server.platform.parts import PartName
from server.recordings.recording_store import Recordings

#: What was made of a recording, ``identification 'idn-1'``, read in a transaction; None: nothing, it may go.
UsedBy = Callable[[sa.Connection, str], str | None]
USED_BY: PartName[UsedBy] = PartName("what was made of a recording")


class RecordingDesk:
    """What is done to recordings with all their files.

    Parameters
    ----------
    used_by : see :data:`USED_BY`
    """

    def __init__(
        self,
        recordings: Recordings,
        files: DataDirectory,
        used_by: UsedBy,
    ) -> None:
        self._used_by = used_by
        self._recordings = recordings
        self._files = files

    def delete(self, id: str) -> None:
        """Delete a recording and its files; refused while it is in use."""
        row = self._recordings.get(id)
        self._recordings.delete(id, self._used_by)
        file = self._files.recordings / f"{id}.{row.format}"
        for path in (file, events_path(file)):
            path.unlink(missing_ok=True)
        if row.sha256 is not None:
            self._files.storage.forget(row.sha256)
        for kept in self._files.recordings.glob(f"{id}.*"):  # statistics, what plots are drawn from, findings
            kept.unlink(missing_ok=True)
