"""What runs behind the routes, put together: store, files, jobs, acquisition, recordings, simulation."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any

import structlog
from sqlalchemy.exc import SQLAlchemyError

from server.acquisition import Acquisition, Launch
from server.changes import Changes
from server.errors import ConflictError, UnavailableError
from server.files import DataDirectory
from server.identify import Wish, order_identification
from server.resources import Status
from server.sessions import Recorder, Sessions
from server.settings import Settings
from server.stages import StageProgram
from server.store import Database, Identification, Identifications, Jobs, MachineRow, Machines, Recordings
from server.uploads import MachineUploads, RecordingUploads
from server.workflows import JobRunner

_log = structlog.stdlib.get_logger(__name__)


@dataclass(frozen=True)
class Parts:
    """What a service is made of beyond its settings; tests put fakes here."""

    program: Callable[[], StageProgram]
    launch: Launch
    recorder: Recorder


class Service:
    """A running service; call :meth:`start` once, then :meth:`stop`, also when starting failed."""

    def __init__(self, settings: Settings, parts: Parts) -> None:
        self.settings = settings
        self.changes = Changes()
        self.files = DataDirectory(settings.data_dir)
        self._resources = ExitStack()
        # Before the database is touched: two servers must not even open one.
        self._resources.enter_context(self.files.locked())
        self.files.clean()
        self._database = Database(self.files.database, changed=self.changes.notify)
        self._resources.callback(self._database.close)
        self.machines = Machines(self._database)
        self.recordings = Recordings(self._database)
        self.jobs = Jobs(self._database)
        self.identifications = Identifications(self._database)
        self.recording_uploads = RecordingUploads(self._database, self.files)
        self._machine_uploads = MachineUploads(self._database, self.files)
        self.runner = JobRunner(self._database, self.files, parts.program, stage_timeout_s=settings.stage_timeout_s)
        self.acquisition = Acquisition(parts.launch, self.changes.notify)
        self.sessions = Sessions(self._database, self.files, self.acquisition, parts.recorder)
        self._started = self._database.now()

    def start(self) -> None:
        """Start jobs, the simulated machine if asked for, and acquisition."""
        self.sessions.recover()
        self.runner.start()
        if self.settings.simulate:
            self._simulate()
        for machine in self.machines.acquiring():
            self.acquisition.start(machine.name, self.files.machine_file(machine.name, machine.version))
        _log.info("started", data_dir=str(self.files.root), simulate=self.settings.simulate)

    def stop(self) -> None:
        """Seal what is being recorded, end every child process, close the store."""
        self.changes.close()
        self.sessions.stop_all()
        self.acquisition.stop_all()
        self.runner.stop()
        self._resources.close()
        _log.info("stopped")

    def _simulate(self) -> None:
        from server.simulation import simulated_machine

        path = self._resources.enter_context(simulated_machine(self.files.simulation, self.settings.simulation_speed))
        row, _ = self._machine_uploads.add(path.read_bytes(), acquire=True)
        self.machines.set_acquire(row.name, True)

    def upload_machine(self, content: bytes) -> tuple[MachineRow, bool]:
        """Store a machine file; a machine that is being acquired goes on with the new one."""
        row, made = self._machine_uploads.add(content)
        if made and row.acquire:
            self.acquisition.start(row.name, self.files.machine_file(row.name, row.version))
        return row, made

    def set_acquisition(self, name: str, enabled: bool) -> None:
        """Start or stop acquiring a machine; ConflictError if its file names no bus or it is recorded."""
        row = self.machines.get(name)
        if enabled:
            path = self.files.machine_file(name, row.version)
            self.acquisition.check(path)
            self.machines.set_acquire(name, True)
            if name not in self.acquisition.names():
                self.acquisition.start(name, path)
            return
        recorded = self.recordings.list(1, machine=name, state="recording").items
        if recorded:
            raise ConflictError(f"machine '{name}' is being recorded as {recorded[0].id}; stop that recording first")
        self.machines.set_acquire(name, False)
        self.acquisition.stop(name)

    def identify(self, wish: Wish, key: str | None) -> Identification:
        """Store an identification and queue its job."""
        identification = order_identification(self._database, wish, self.runner.stages, key)
        self.runner.enqueue(identification.job)
        return identification

    def delete_recording(self, id: str) -> None:
        """Delete a recording and its file; refused while it is in use."""
        format = self.recordings.get(id).format
        self.recordings.delete(id)
        (self.files.recordings / f"{id}.{format}").unlink(missing_ok=True)

    def live(self, machine: str | None) -> dict[str, dict[str, Any]]:
        """The newest frame of one machine, or of each whose acquisition runs."""
        if machine is not None:
            self.machines.get(machine)
            return {machine: self.acquisition.latest(machine)}
        names = [name for name in self.acquisition.names() if self.acquisition.running(name)]
        return {name: self.acquisition.latest(name) for name in names}

    def status(self) -> Status:
        """The service at a glance."""
        return Status(
            version=version("hilfit"),
            started=self._started,
            revisions=self._database.revisions(),
            jobs=self.jobs.counts(),
            acquisition={name: self.acquisition.statistics(name) for name in self.acquisition.names()},
        )

    def check(self) -> None:
        """Raise UnavailableError if the store cannot be read."""
        try:
            self._database.check()
        except SQLAlchemyError as error:
            _log.error("store_unavailable", exc_info=error)
            raise UnavailableError("the store cannot be read; the log of the service says why") from None
