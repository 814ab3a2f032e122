"""Machines of a running service: their files, whether they are acquired, and which of them is simulated."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path

from server.machines.acquisition import Acquisition
from server.machines.machine_store import MachineRow, Machines
from server.machines.machine_uploads import MachineUploads
from server.platform.errors import ConflictError
from server.platform.files import DataDirectory
from server.platform.http.route_parameters import Tags
from server.platform.resource import PartName

#: Id of the recording that is being made of a machine; None without one.
BEING_RECORDED: PartName[Callable[[str], str | None]] = PartName("which recording is being made of a machine")
#: Starts the simulated machine in a directory, at a speed; leaving the context ends it.
Simulate = Callable[[Path, float], AbstractContextManager[Path]]


@dataclass(eq=False)
class MachineDesk:
    """Operations on machines.

    Attributes
    ----------
    recorded : see :data:`BEING_RECORDED`
    """

    machines: Machines
    uploads: MachineUploads
    acquisition: Acquisition
    files: DataDirectory
    recorded: Callable[[str], str | None]
    #: Name of the simulated machine, None without one.
    simulated: str | None = field(default=None, init=False)

    def add_simulated(self, machine_file: Path) -> None:
        """Take the file that the simulated machine has written; it is acquired from now on."""
        row, _ = self.uploads.add(machine_file.read_bytes(), acquire=True, own=True)
        self.machines.set_acquire(row.name, True)
        self.simulated = row.name

    def start_acquisition(self) -> None:
        """Acquire all machines that should be."""
        for machine in self.machines.acquiring():
            path = self.files.machine_file(machine.name, machine.version)
            self.acquisition.start(machine.name, path, own=machine.name == self.simulated)

    def check(self, content: bytes, allowed: Callable[[str], bool]) -> tuple[str, int]:
        """Check a machine file: its machine and version to be; refuse what :meth:`upload` would."""
        return self.uploads.check(content, allowed, self.simulated)

    def upload(
        self, content: bytes, allowed: Callable[[str], bool] = lambda name: True, expected: Tags = None
    ) -> tuple[MachineRow, bool]:
        """Store a machine file; a machine that is being acquired goes on with the new one.

        NotFoundError if the machine is not ``allowed``, PreconditionError if its version is not ``expected``,
        ConflictError if it is the simulated one.
        """
        row, made = self.uploads.add(content, allowed=allowed, protected=self.simulated, expected=expected)
        if made and row.acquire:
            self.acquisition.start(row.name, self.files.machine_file(row.name, row.version))
        return row, made

    def set_acquisition(self, name: str, enabled: bool) -> None:
        """Start or stop acquiring a machine; ConflictError if its file names no bus or it is recorded."""
        row = self.machines.get(name)
        if enabled:
            path = self.files.machine_file(name, row.version)
            own = name == self.simulated
            self.acquisition.check(path, own)
            self.machines.set_acquire(name, True)
            if name not in self.acquisition.names():
                self.acquisition.start(name, path, own)
            return
        recording = self.recorded(name)
        if recording is not None:
            refusal = ConflictError("server.machine_being_recorded", machine=name, recording=recording)
            raise refusal.about("being_recorded")
        self.machines.set_acquire(name, False)
        self.acquisition.stop(name)
