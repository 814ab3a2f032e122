"""The machines and calibrations of a running service, as recalibrations see them."""

from __future__ import annotations

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


class Site:
    """The machines of one service."""

    def __init__(
        self,
        database: Database,
        files: DataDirectory,
        sessions: Sessions,
        excitations: ExcitationKind,
        delivery: MotionDelivery,
    ) -> None:
        self._database = database
        self._files = files
        self._sessions = sessions
        self._designs = excitations
        self._delivery = delivery
        self._machines = Machines(database)
        self._excitations = Excitations(database)

    def start_recording(self, machine: str, role: str, label: str, seconds: float) -> RecordingRow:
        """Start recording."""
        return self._sessions.start(machine, role, label, seconds)

    def stop_recording(self, id: str) -> None:
        """Stop a recording; one that ended meanwhile is left as it is."""
        try:
            self._sessions.stop(id)
        except ConflictError:
            return

    def controller(self, machine: str) -> SimulatedController | None:
        """Return the simulated machine's controller; None: a real machine."""
        return self._delivery.controller(machine)

    def motion_seconds(self, excitation: str) -> float:
        """Return the length of a designed motion, s."""
        # Loads scipy, which takes as long as all the rest of the service.
        from daq.motion_files import read_motion

        try:
            self._excitations.get(excitation)
            return read_motion(self._designs.motion(excitation)).seconds
        except HilfitError as error:
            text = str(error).replace(f"{self._files.root}/", "")
            raise JobError("server.design_excitation_first_name", text=text) from None

    def rate_hz(self, machine: str) -> float:
        """Return cycles a second."""
        row = self._machines.get(machine)
        return load_machine(self._files.machine_file(machine, row.version)).rate_hz

    def now(self) -> str:
        """Return the time as the store writes it."""
        return self._database.now()

    def ready(self, machine: str) -> None:
        """Raise ConflictError if a machine is not being acquired: no slot can do anything then."""
        try:
            row = self._machines.get(machine)
        except NotFoundError as error:
            raise ConflictError(str(error)) from None
        if not row.acquire:
            raise ConflictError("server.machine_not_being_acquired", name=machine).about("not_acquired")
