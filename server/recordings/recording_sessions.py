"""Recordings in progress: one thread each, from the ring buffer of a running acquisition to a sealed file.

Rows that were counted are in the journal. Where the disk has no room to seal it, or the store takes no writes, the
thread waits until it does; if the service stops first, the next one goes on from there.
"""

from __future__ import annotations

import secrets
import sys
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import pyarrow.parquet
import structlog

from daq import Machine
from daq.acquisition.journal import journal_path
from daq.errors import HilfitError, StorageError
from daq.messages import Sentence
from daq.whole_files import digest_of
from server.machines.acquisition import Acquisition
from server.machines.machine_store import Machines
from server.platform.database.engine import Database
from server.platform.database.patience import Patience
from server.platform.errors import ConflictError, ServiceStopping, UnavailableError
from server.platform.files import DataDirectory, Free, require_room
from server.recordings.recording_store import RecordingRow, Recordings

#: With more free bytes than this, beyond what sealing takes, it is not the room that a journal lacks.
ROOM_BYTES = 16 * 2**20
#: Seconds between two tries to seal what the disk had no room for.
PAUSE_S = 2.0
#: Seconds that whoever stops a recording waits for its file.
SEALING_S = 60.0
_log = structlog.stdlib.get_logger(__name__)


@dataclass(frozen=True)
class RecordOrder:
    """Parameters of one recording.

    Attributes
    ----------
    path : the sealed file
    seconds : of machine time, None: until ``stop`` is set
    report : takes the statistics so far, now and then
    """

    machine: Machine
    ring_name: str
    role: str
    path: Path
    seconds: float | None
    stop: threading.Event
    report: Callable[[dict[str, Any]], None]


class Recorder(Protocol):
    """Records, and seals what a killed server left behind."""

    def record(self, order: RecordOrder) -> dict[str, Any]:
        """Record until the time is over, stopped, or the acquisition ends; then the sealed file is there.

        Returns
        -------
        Statistics of the recording.
        """

    def recover(self, directory: Path) -> Mapping[Path, int]:
        """Seal what a killed recorder left in ``directory``; the sealed files and their rows."""


@dataclass
class _Session:
    stop: threading.Event
    thread: threading.Thread
    statistics: dict[str, Any] = field(default_factory=dict)


@dataclass(eq=False)
class Sessions:
    """All recordings in progress."""

    database: Database
    files: DataDirectory
    acquisition: Acquisition
    recorder: Recorder
    free: Free = lambda: sys.maxsize

    def __post_init__(self) -> None:
        self._recordings = Recordings(self.database)
        self._machines = Machines(self.database)
        self._lock = threading.Lock()
        self._patience = Patience(threading.Event())
        self._sessions: dict[str, _Session] = {}

    def start(self, machine: str, role: str, label: str, seconds: float | None) -> RecordingRow:
        """Start recording; returns at once.

        Raises
        ------
        NotFoundError, ConflictError, UnavailableError
            If there is no such machine, it is not acquired, or it is being recorded already.
        """
        row = self._machines.get(machine)
        require_room(self.free())
        content, feed = self.acquisition.feed(machine)
        recording = RecordingRow(
            id=f"rec-{secrets.token_hex(8)}",
            machine=machine,
            machine_version=row.version,
            role=role,
            label=label or f"{machine} {role}",
            state="recording",
            origin="recorded",
            format="parquet",
            created=self.database.now(),
        )
        self._recordings.add(recording)
        stop = threading.Event()

        def report(statistics: dict[str, Any]) -> None:
            with self._lock:
                self._sessions[recording.id].statistics = statistics

        order = RecordOrder(content, feed.ring_name, role, self._path(recording.id), seconds, stop, report)
        self._begin(recording.id, stop, lambda: self._record(recording.id, order))
        return recording

    def _begin(self, id: str, stop: threading.Event, work: Callable[[], None]) -> None:
        thread = threading.Thread(target=self._run, args=(id, work), name=f"recording-{id}", daemon=True)
        with self._lock:
            self._sessions[id] = _Session(stop, thread)
        thread.start()

    def stop(self, id: str) -> RecordingRow:
        """Stop a recording and wait until its file is sealed.

        Raises
        ------
        NotFoundError, ConflictError
            If there is no such recording, or it has ended.
        UnavailableError
            If it ended and cannot be sealed at the moment.
        """
        state = self._recordings.get(id).state
        with self._lock:
            session = self._sessions.get(id)
        if session is None:
            raise ConflictError("server.recording_not_running", id=id, state=state).about("not_recording", recording=id)
        session.stop.set()
        session.thread.join(SEALING_S)
        if session.thread.is_alive():
            raise UnavailableError("server.recording_ended_rows_safe", id=id)
        return self._recordings.get(id)

    def statistics(self, id: str) -> dict[str, Any] | None:
        """Return what a recording in progress counted so far; None if it is not in progress."""
        with self._lock:
            session = self._sessions.get(id)
            return None if session is None else session.statistics

    def end_all(self) -> None:
        """Let everything that is being recorded be sealed; returns at once."""
        with self._lock:
            for session in self._sessions.values():
                session.stop.set()

    def stop_all(self) -> None:
        """Seal everything that is being recorded; what cannot be sealed now is sealed after the next start."""
        self._patience.stopping.set()
        self.end_all()
        with self._lock:
            sessions = list(self._sessions.values())
        for session in sessions:
            session.thread.join()

    def recover(self) -> None:
        """Seal what a killed server was recording; called before anything is recorded."""
        rows = self.recorder.recover(self.files.recordings)
        for row in self._recordings.list(500, state="recording").items:
            path = self._path(row.id)
            if path.is_file():
                # Not among those that were sealed now: killed when its file was whole, and the store did not know yet.
                found = rows[path] if path in rows else pyarrow.parquet.read_metadata(path).num_rows
                self._seal(row.id, path, {"rows": found, "recovered": True})
            elif journal_path(path).is_file():  # there is no room to seal it now
                self._begin(row.id, threading.Event(), partial(self._recover_later, row.id, path))
            else:
                self._recordings.fail(row.id, "the service ended before anything was recorded; record it again")
        known = self._recordings.ids()
        unnamed = [path.name for path in self.files.recordings.glob("rec-*") if path.name.split(".")[0] not in known]
        if unnamed:  # whole files, of uploads that were killed before the store knew them: somebody's data
            _log.warning("recordings_without_a_name", files=sorted(unnamed), do="upload them again, or delete them")

    def _path(self, id: str) -> Path:
        return self.files.recordings / f"{id}.parquet"

    def _run(self, id: str, work: Callable[[], None]) -> None:
        try:
            try:
                work()
            except HilfitError as error:
                self._fail(id, error)
            except Exception as error:
                _log.error("recording_failed", recording=id, exc_info=error)
                text = Sentence("server.recording_failed_unexpectedly")
                self._patience.patiently(lambda: self._recordings.fail(id, text))
        except ServiceStopping:
            _log.warning("recording_left", recording=id)  # the next start finds it
        finally:
            with self._lock:
                del self._sessions[id]

    def _record(self, id: str, order: RecordOrder) -> None:
        try:
            statistics = self.recorder.record(order)
        except StorageError as error:
            statistics = self._sealed_later(order.path, error) | {"ended_early": self._without_place(error)}
        self._seal(id, order.path, statistics)

    def _recover_later(self, id: str, path: Path) -> None:
        full = StorageError(Sentence("server.killed_not_sealed", path=path), "sealing")
        self._seal(id, path, self._sealed_later(path, full) | {"recovered": True})

    def _sealed_later(self, path: Path, error: StorageError) -> dict[str, Any]:
        """Seal a journal as soon as there is room; raises ``error`` if that is not what is wrong with it."""
        while journal_path(path).is_file():
            before = self.free()
            rows = self.recorder.recover(path.parent)
            if path.is_file():
                return {"rows": rows.get(path) or pyarrow.parquet.read_metadata(path).num_rows}
            if min(before, self.free()) > ROOM_BYTES:
                break
            self._patience.pause(PAUSE_S)
        raise error

    def _seal(self, id: str, path: Path, statistics: dict[str, Any]) -> None:
        sha256, size = digest_of(path), path.stat().st_size
        self._patience.patiently(lambda: self._recordings.seal(id, bytes=size, sha256=sha256, statistics=statistics))
        _log.info("recording_sealed", recording=id)

    def _without_place(self, error: HilfitError) -> str:
        return str(error).replace(f"{self.files.recordings}/", "")

    def _fail(self, id: str, error: HilfitError) -> None:
        text = self._without_place(error)
        _log.warning("recording_failed", recording=id, error=text)
        self._patience.patiently(lambda: self._recordings.fail(id, text))
