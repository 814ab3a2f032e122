"""Designed motions for the simulated machine's controller.

No request reaches an actuator: the controller gets a file, as it would from a person.
"""

from __future__ import annotations

from collections.abc import Callable

from daq.messages import Sentence
from server.excitations.excitation_job import ExcitationKind
from server.excitations.excitation_store import Excitations
from server.machines.simulation import SimulatedController
from server.platform.errors import ConflictError
from server.platform.files import DataDirectory


class MotionDelivery:
    """Hands motions to a controller.

    Parameters
    ----------
    simulated : name of the simulated machine, None without one
    """

    def __init__(
        self,
        files: DataDirectory,
        excitations: Excitations,
        designs: ExcitationKind,
        simulated: Callable[[], str | None],
    ) -> None:
        self._files = files
        self._excitations = excitations
        self._designs = designs
        self._simulated = simulated

    def controller(self, machine: str) -> SimulatedController | None:
        """Return the simulated machine's controller; None: a real machine."""
        if machine != self._simulated():
            return None
        return SimulatedController(self._files.simulation, self._designs.motion)

    def send(self, excitation: str, name: str) -> None:
        """Send a designed motion to the simulated machine's controller.

        Raises
        ------
        NotFoundError, ConflictError
            If there is no such motion, or the machine is a real one.
        """
        row = self._excitations.get(excitation)
        if row.result is None:
            raise ConflictError(Sentence("server.excitation_not_designed_yet", excitation=excitation, job=row.job))
        controller = self.controller(row.machine)
        if controller is None:
            raise ConflictError(Sentence("server.machine_real_download_motion", machine=row.machine))
        controller.send(name, excitation)
