"""The machines and calibrations of a running service, as recalibrations see them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from daq import load_machine
from daq.errors import HilfitError
from fitting.motion import read_motion
from server.acquisition import Acquisition
from server.errors import ConflictError, NotFoundError
from server.files import DataDirectory
from server.jobs.excitation import ExcitationKind
from server.jobs.kinds import JobError
from server.sessions import Sessions
from server.simulation import SimulatedController
from server.store import Database, Machines, RecordingRow
from server.store.excitations import Excitations

if TYPE_CHECKING:
    from server.jobs.recording import Controller


class Site:
    """The machines of one service (:class:`server.jobs.recording.Machines`).

    Parameters
    ----------
    simulated : name of the simulated machine, None without one
    """

    def __init__(
        self,
        database: Database,
        files: DataDirectory,
        acquisition: Acquisition,
        sessions: Sessions,
        excitations: ExcitationKind,
        simulated: Callable[[], str | None],
    ) -> None:
        self._database = database
        self._files = files
        self._acquisition = acquisition
        self._sessions = sessions
        self._designs = excitations
        self._simulated = simulated
        self._machines = Machines(database)
        self._excitations = Excitations(database)

    def start_recording(self, machine: str, role: str, label: str, seconds: float) -> RecordingRow:
        """Start recording."""
        return self._sessions.start(machine, role, label, seconds)

    def stop_recording(self, id: str) -> None:
        """Stop a recording; one that ended meanwhile stays as it is."""
        try:
            self._sessions.stop(id)
        except ConflictError:
            return

    def controller(self, machine: str) -> Controller | None:
        """The simulated machine's controller; None: a real machine."""
        if machine != self._simulated():
            return None
        return SimulatedController(self._files.simulation, self._designs.motion)

    def motion_seconds(self, excitation: str) -> float:
        """Length of a designed motion, s."""
        try:
            self._excitations.get(excitation)
            return read_motion(self._designs.motion(excitation)).seconds
        except HilfitError as error:
            text = str(error).replace(f"{self._files.root}/", "")
            raise JobError(f"{text}; design the excitation first and name it in the schedule") from None

    def rate_hz(self, machine: str) -> float:
        """Cycles a second."""
        row = self._machines.get(machine)
        return load_machine(self._files.machine_file(machine, row.version)).rate_hz

    def now(self) -> str:
        """The time as the store writes it."""
        return self._database.now()

    def ready(self, machine: str) -> None:
        """Raise ConflictError if a machine is not being acquired: no slot can do anything then."""
        try:
            row = self._machines.get(machine)
        except NotFoundError as error:
            raise ConflictError(str(error)) from None
        if not row.acquire:
            raise ConflictError(f"machine '{machine}' is not being acquired; enable its acquisition")

    def send(self, excitation: str, name: str) -> None:
        """Hand a designed motion to the simulated machine's controller.

        Raises
        ------
        NotFoundError, ConflictError
            If there is no such motion, or the machine is a real one.
        """
        row = self._excitations.get(excitation)
        if row.result is None:
            raise ConflictError(f"excitation '{excitation}' is not designed yet; wait for its job {row.job}")
        controller = self.controller(row.machine)
        if controller is None:
            raise ConflictError(
                f"machine '{row.machine}' is a real one: download motion.csv and load it into the arm's own controller"
            )
        controller.send(name, excitation)
