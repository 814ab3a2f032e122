"""What runs behind the routes, put together: store, files, jobs, acquisition, recordings, simulation."""

from __future__ import annotations

import asyncio
import os
import signal
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack, suppress
from dataclasses import dataclass
from datetime import datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import structlog
from fastapi.concurrency import run_in_threadpool
from sqlalchemy.exc import SQLAlchemyError

from daq.events import events_path
from server.access.desk import Access
from server.acquisition import Acquisition, Launch
from server.alarms import Alarms
from server.alarms.watch import Watch
from server.audit import Audit
from server.backups import Backups, DailyBackups
from server.calibrations import ByPolicy, Calibrations
from server.changes import Changes
from server.disk import free_bytes
from server.errors import ConflictError, UnavailableError
from server.executors import Presence, Silence
from server.files import DataDirectory
from server.formats.exports import Exports
from server.heavy import Heavy
from server.identify import Wish, order_identification
from server.jobs.excitation import PROGRAM as DESIGN
from server.jobs.excitation import ExcitationKind
from server.jobs.identification import IdentificationKind
from server.jobs.kinds import AT_MACHINES
from server.jobs.places import Results
from server.jobs.recalibration import PROGRAM as COMPARISON
from server.jobs.recalibration import Calibrations as CalibrationsOfJobs
from server.jobs.recalibration import RecalibrationKind, Surroundings, new_recalibration
from server.jobs.site import Site
from server.live import Hub, Revisions
from server.machine_reader import MachineReader
from server.monitor import Monitors
from server.replays import Replays
from server.resources import Status
from server.schedules.clock import ScheduleClock
from server.sessions import Recorder, Sessions
from server.settings import Settings
from server.shared_recordings import SharedRecordings
from server.simulation import simulated_machine
from server.stages import StageProgram
from server.store import Database, Identification, Identifications, Jobs, MachineRow, Machines, Recordings
from server.store.database import utc_now
from server.store.excitations import Excitation, Excitations
from server.store.recalibrations import Recalibrations
from server.store.schedules import Schedule, Schedules
from server.tls import Certificate, certificate
from server.uploads import MachineUploads, RecordingUploads
from server.workflows import EXECUTOR, QUEUES, JobRunner

_log = structlog.stdlib.get_logger(__name__)


def _by_policy(service: Service) -> CalibrationsOfJobs:
    return ByPolicy(service.calibrations, service.audit)


@dataclass(frozen=True)
class Parts:
    """What a service is made of beyond its settings; tests put fakes here. ``clock``: what schedules go by."""

    program: Callable[[], StageProgram]
    launch: Launch
    recorder: Recorder
    design: tuple[str, ...] = DESIGN
    comparison: tuple[str, ...] = COMPARISON
    calibrations: Callable[[Service], CalibrationsOfJobs] = _by_policy
    clock: Callable[[], datetime] = utc_now
    simulation: Callable[[Path, float], AbstractContextManager[Path]] = simulated_machine


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
        self._database = Database(
            settings.full_database_url or self.files.database, changed=self.changes.notify, backups=self.files.backups
        )
        self._resources.callback(self._database.close)
        self._resources.enter_context(self._database.alone())
        self.certificate = certificate(settings, self.files, utc_now)
        self.backups = Backups(self.files, self._database.url, utc_now, settings.backup_dir)
        self._daily_backups = DailyBackups(self.backups)
        self.audit = Audit(self._database)
        self.access = Access(self._database, self.audit, settings.access == "required", settings.token_days)
        self.replays = Replays()
        self.machines = Machines(self._database)
        self.recordings = Recordings(self._database)
        self.jobs = Jobs(self._database)
        self.identifications = Identifications(self._database)
        self.results = Results(self._database, self.files)
        self.calibrations = Calibrations(self._database, self.files, settings.approves_own)
        self.exports = Exports(self.files)
        self._shared = None if settings.recordings_url is None else SharedRecordings(settings.recordings_url)
        self.recording_uploads = RecordingUploads(self._database, self.files)
        self.machine_reader = MachineReader(self.files)
        self._resources.callback(self.machine_reader.close)
        self._machine_uploads = MachineUploads(self._database, self.files, self.machine_reader)
        self.heavy = Heavy()
        self._resources.callback(self.heavy.close)
        self.pairing = Heavy(slots=1, places=16, share=4)
        self._resources.callback(self.pairing.close)
        self._identification = IdentificationKind(self._database, self.files, parts.program)
        self.acquisition = Acquisition(parts.launch, self.changes.notify)
        self.hub = Hub(self.acquisition, lambda: self.changes.closed)
        self.revisions = Revisions(self.changes, self._read_revisions, own=self._database.own_revisions)
        self.sessions = Sessions(self._database, self.files, self.acquisition, parts.recorder, self.free_bytes)
        self.alarms = Alarms(self._database)
        self._watch = Watch(self.acquisition, self.alarms, self.free_bytes, self.sessions.end_all)
        self.excitations = Excitations(self._database)
        self.schedules = Schedules(self._database)
        self.recalibrations = Recalibrations(self._database)
        self.designs = ExcitationKind(self._database, self.files, parts.design)
        self._simulation = parts.simulation
        self._simulated: str | None = None
        self.site = Site(
            self._database, self.files, self.acquisition, self.sessions, self.designs, lambda: self._simulated
        )
        around = Surroundings(parts.calibrations(self), self.alarms, self.site, self.identify, self.jobs.request_cancel)
        self.monitors = Monitors(
            around.calibrations,
            self.acquisition,
            self.machines,
            self.files,
            self.results.identification,
            self.alarms,
            self._database.now,
            recalibrate=self.recalibrate_drifted if settings.recalibrate_on_drift else None,
        )
        recalibration = RecalibrationKind(self._database, self.files, around, parts.comparison)
        self.runner = JobRunner(
            self._database,
            self.files,
            [self._identification, self.designs, recalibration],
            stage_timeout_s=settings.stage_timeout_s,
            queues=tuple(QUEUES) if settings.local_jobs else (AT_MACHINES,),
        )
        self._silence = Silence(self._database)
        self._presence = Presence(self._database, EXECUTOR, self._take_over)
        self.schedule_clock = ScheduleClock(self._database, self.runner.enqueue, self.site.ready, parts.clock)
        self._started = self._database.now()
        self._version = version("hilfit")
        self._counting = asyncio.Lock()
        self._jobs_counted: tuple[int, dict[str, int]] = 0, {}

    def start(self) -> None:
        """Start jobs, the simulated machine if asked for, and acquisition."""
        self.sessions.recover()
        if self.settings.simulate:
            self._simulate()
        self.runner.start()
        for machine in self.machines.acquiring():
            self.acquisition.start(machine.name, self.files.machine_file(machine.name, machine.version))
        self._watch.start()
        self.monitors.start()
        self.schedule_clock.start()
        if not self._database.is_sqlite:  # else nobody shares it
            self._presence.start()
        self._daily_backups.start()
        _log.info("started", data_dir=str(self.files.root), simulate=self.settings.simulate)

    def stop(self) -> None:
        """Seal what is being recorded, end every child process, close the store."""
        self.changes.close()
        self.schedule_clock.stop()
        self._presence.stop()
        self._daily_backups.stop()
        self.runner.halt()
        self._watch.stop()
        self.monitors.stop()
        self.sessions.stop_all()
        self.acquisition.stop_all()
        self.runner.stop()
        self._resources.close()
        _log.info("stopped")

    def _take_over(self) -> None:
        """Let others go on with the jobs of workers that fell silent."""
        if not self._database.still_alone():
            _log.critical("another_server_has_the_database", database=self._database.name)
            os.kill(os.getpid(), signal.SIGTERM)
            return
        self._silence.look()
        self.runner.take_over(self._silence.silent)

    def _simulate(self) -> None:
        speed = self.settings.simulation_speed
        path = self._resources.enter_context(self._simulation(self.files.simulation, speed))
        row, _ = self._machine_uploads.add(path.read_bytes(), acquire=True, own=True)
        self.machines.set_acquire(row.name, True)
        self._simulated = row.name

    def check_machine(self, content: bytes, allowed: Callable[[str], bool]) -> tuple[str, int]:
        """A machine file's machine and the version that it would be; refuses what :meth:`upload_machine` would."""
        return self._machine_uploads.check(content, allowed, self._simulated)

    def upload_machine(
        self, content: bytes, allowed: Callable[[str], bool] = lambda name: True, expected: int | None = None
    ) -> tuple[MachineRow, bool]:
        """Store a machine file; a machine that is being acquired goes on with the new one.

        NotFoundError if the machine is not ``allowed``, PreconditionError if ``expected`` is not its version,
        ConflictError if it is the simulated one.
        """
        row, made = self._machine_uploads.add(content, allowed=allowed, protected=self._simulated, expected=expected)
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
        """Store an identification and queue its job; UnavailableError if workers could not get its recordings."""
        if self._shared is not None:
            for id, _ in wish.recordings:
                row = self.recordings.get(id)
                if row.state == "sealed":  # else the order is refused below
                    self._shared.put(row, self.files.recordings / f"{id}.{row.format}")
        identification = order_identification(self._database, wish, self._identification.stages, key)
        self.runner.enqueue(identification.job)
        return identification

    @property
    def fingerprint(self) -> str | None:
        """Of the certificate that only its fingerprint vouches for; None without such a one."""
        found: Certificate | None = self.certificate
        return found.fingerprint if found is not None and found.self_made else None

    def now(self) -> str:
        """The time as the store writes it."""
        return self._database.now()

    def design(self, machine: str, options: dict[str, Any], label: str, key: str | None) -> Excitation:
        """Store an excitation and queue its design."""
        excitation = self.designs.order(machine, options, label, key)
        self.runner.enqueue(excitation.job)
        return excitation

    def recalibrate(self, schedule: Schedule) -> str:
        """Do now what a schedule does; the job. ConflictError if the machine is being recalibrated."""
        self.site.ready(schedule.machine)
        new = new_recalibration(schedule.machine, schedule.id, schedule.label, schedule.plan, self._database.now())
        self.schedules.order(new)
        self.runner.enqueue(new.job)
        return new.job

    def recalibrate_drifted(self, machine: str, reason: str) -> None:
        """Do now what the machine's schedule does, because its residual drifts.

        Raises
        ------
        ConflictError
            If no schedule says how, or the machine is being recalibrated.
        """
        schedule = next((own for own in self.schedules.enabled() if own.machine == machine), None)
        if schedule is None:
            raise ConflictError(
                f"machine '{machine}' drifts and no enabled schedule says how to recalibrate it; make one"
            )
        _log.info("recalibration_ordered", machine=machine, job=self.recalibrate(schedule), reason=reason)

    def delete_recording(self, id: str) -> None:
        """Delete a recording and its file; refused while it is in use."""
        row = self.recordings.get(id)
        self.recordings.delete(id)
        file = self.files.recordings / f"{id}.{row.format}"
        for path in (file, events_path(file)):
            path.unlink(missing_ok=True)
        if self._shared is not None:
            self._shared.remove(row)
        self.exports.kept_statistics(id).unlink(missing_ok=True)

    def live(self, machine: str | None) -> dict[str, dict[str, Any]]:
        """The newest frame of one machine, or of each that has one at the moment."""
        if machine is not None:
            return {machine: self.acquisition.latest(machine)}
        found = {}
        for name in self.acquisition.names():
            with suppress(ConflictError, UnavailableError):  # starting, waiting, or stopped just now
                found[name] = self.acquisition.latest(name)
        return found

    async def _read_revisions(self) -> dict[str, int]:
        return await run_in_threadpool(self._database.revisions)

    def free_bytes(self) -> int:
        """Bytes that are free for recordings."""
        return free_bytes(self.files.recordings)

    async def status(self) -> Status:
        """The service at a glance."""
        revisions = await self.revisions.current()
        number = revisions.get("jobs", 0)  # 0: there never was one
        if self._jobs_counted[0] < number:
            async with self._counting:  # one of those who ask counts for all who asked before it began
                if self._jobs_counted[0] < number:
                    newest = (await self.revisions.current()).get("jobs", 0)
                    self._jobs_counted = newest, await run_in_threadpool(self.jobs.counts)
        return Status(
            version=self._version,
            started=self._started,
            revisions=dict(revisions),
            jobs=self._jobs_counted[1],
            acquisition={name: self.acquisition.statistics(name) for name in self.acquisition.names()},
        )

    def check(self) -> None:
        """Raise UnavailableError if the store cannot be read, or the data directory not be written."""
        self.files.check()
        if self._database.is_sqlite and not self.files.database.is_file():
            raise UnavailableError("the store's file is gone; restore a backup and restart the service")
        try:
            self._database.check()
        except SQLAlchemyError as error:
            _log.error("store_unavailable", exc_info=error)
            raise UnavailableError("the store cannot be read; the log of the service says why") from None
