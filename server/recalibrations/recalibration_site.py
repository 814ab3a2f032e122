"""The machines and calibrations of a running service, as recalibrations see them."""

from __future__ import annotations

from dataclasses import dataclass

from daq import load_machine
from daq.errors import HilfitError
from server.excitations.excitation_job import ExcitationKind, MotionDelivery
from server.excitations.excitation_store import Excitations
from server.jobs.job_kinds import JobError
from server.machines.machine_store import Machines
from server.machines.simulation import SimulatedController
from server.platform.database.engine import Database
from server.platform.errors import ConflictError, NotFoundError
from server.platform.files import DataDirectory
from server.recordings.recording_sessions import Sessions
from server.recordings.recording_store import RecordingRow


@dataclass(eq=False)
class Site:
    """The machines of one service."""

    database: Database
    files: DataDirectory
    sessions: Sessions
    designs: ExcitationKind
    delivery: MotionDelivery

    def __post_init__(self) -> None:
        self._machines = Machines(self.database)
        self._excitations = Excitations(self.database)

    def start_recording(self, machine: str, role: str, label: str, seconds: float) -> RecordingRow:
        """Start recording."""
        return self.sessions.start(machine, role, label, seconds)

    def stop_recording(self, id: str) -> None:
        """Stop a recording; one that ended meanwhile is left as it is."""
        try:
            self.sessions.stop(id)
        except ConflictError:
            return

    def controller(self, machine: str) -> SimulatedController | None:
        """Return the simulated machine's controller; None: a real machine."""
        return self.delivery.controller(machine)

    def motion_seconds(self, excitation: str) -> float:
        """Return the length of a designed motion, s."""
        # Loads scipy, which takes as long as all the rest of the service.
        from daq.motion_files import read_motion

        try:
            self._excitations.get(excitation)
            return read_motion(self.designs.motion(excitation)).seconds
        except HilfitError as error:
            text = str(error).replace(f"{self.files.root}/", "")
            raise JobError("server.design_excitation_first_name", text=text) from None

    def rate_hz(self, machine: str) -> float:
        """Return cycles a second."""
        row = self._machines.get(machine)
        return load_machine(self.files.machine_file(machine, row.version)).rate_hz

    def now(self) -> str:
        """Return the time as the store writes it."""
        return self.database.now()

    def ready(self, machine: str) -> None:
        """Raise ConflictError if a machine is not being acquired: no slot can do anything then."""
        try:
            row = self._machines.get(machine)
        except NotFoundError as error:
            raise ConflictError(str(error)) from None
        if not row.acquire:
            raise ConflictError("server.machine_not_being_acquired", name=machine).about("not_acquired")
