"""Designs of motions as jobs of one stage, in a process of its own."""

from __future__ import annotations

import json
import secrets
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from daq import load_machine
from daq.messages import Sentence
from daq.whole_files import write_whole
from server.excitations.excitation_store import Excitation, Excitations
from server.jobs.job_kinds import NUMERICAL, JobError, StageRun
from server.jobs.job_places import kept_place
from server.jobs.job_store import Job, Jobs, Result, found_by
from server.machines.machine_store import Machines
from server.machines.simulation import SimulatedController
from server.platform.database.engine import Database
from server.platform.database.idempotency import IdempotencyKey
from server.platform.errors import ConflictError, InvalidError
from server.platform.files import DataDirectory
from server.platform.processes.children import ChildResult

STAGE = "design"
#: The program that designs: ``[*PROGRAM, REQUEST.json]``.
PROGRAM = (sys.executable, "-P", "-m", "server.excitations.excitation_child")


class ExcitationKind:
    """Designs a motion.

    Parameters
    ----------
    program : command that designs; it gets the request's path
    """

    name = "excitation"
    queue = NUMERICAL

    def __init__(self, database: Database, files: DataDirectory, program: Sequence[str] = PROGRAM) -> None:
        self._database = database
        self._files = files
        self._program = tuple(program)
        self._excitations = Excitations(database)
        self._jobs = Jobs(database)

    def order(self, machine: str, options: dict[str, Any], label: str, key: str | None) -> Excitation:
        """Check a wish and store it with its queued job.

        Raises
        ------
        NotFoundError, InvalidError, ConflictError
            If there is no such machine or joint, or the key came before with another wish.
        """
        row = Machines(self._database).get(machine)
        described = load_machine(self._files.machine_file(machine, row.version))
        known = [joint.name for joint in described.joints]
        for joint in options.get("joints") or ():
            if joint not in known:
                raise InvalidError("server.machine_no_joint", machine=machine, joint=joint, known=", ".join(known))
        if options.get("rods") == "unpinned" and all(joint.cylinder is None for joint in described.joints):
            raise InvalidError("server.machine_no_cylinder_nothing", machine=machine)
        new = Excitation(
            id=f"exc-{secrets.token_hex(8)}",
            job=f"job-{secrets.token_hex(8)}",
            machine=machine,
            machine_version=row.version,
            label=label or f"Motion of {machine}",
            options=options,
            created=self._database.now(),
        )
        request = IdempotencyKey.of(key, "excitation", machine, options, label)
        return self._jobs.order(self._excitations, new, self.name, (STAGE,), request)

    def motion(self, id: str) -> Path:
        """Locate the motion file once designed; NotFoundError if there is no such excitation."""
        job = self._excitations.get(id).job
        return kept_place(self._files, self._files.excitations / id, self._jobs, job) / "motion.csv"

    def words(self, stage: str) -> str:
        """Return what a person reads while it runs."""
        return Sentence("server.designing_motion")

    def directory(self, job: Job) -> Path:
        """Locate the design's place."""
        return self._files.excitations / job.subject

    def inputs(self, job: Job) -> tuple[Path, ...]:
        """Return the machine file."""
        excitation = self._excitations.get(job.subject)
        return (self._files.machine_file(excitation.machine, excitation.machine_version),)

    def run(self, run: StageRun) -> ChildResult:
        """Run the design."""
        (machine,) = self.inputs(run.job)
        request = {
            "machine": str(run.here(machine)),
            "output": str(run.place),
            "options": self._excitations.get(run.job.subject).options,
        }
        path = run.place / "request.json"
        write_whole(path, json.dumps(request, indent=1).encode())
        return run.child(self._program, [str(path)], run.place / "design.log")

    def result(self, job: Job, place: Path) -> Result:
        """Return what the design found."""
        try:
            result = json.loads((place / "result.json").read_bytes())
        except (OSError, ValueError):
            raise JobError("server.design_left_no_motion") from None
        return found_by(Excitation, job.subject, result=result)

    def ended(self, job: Job, state: str, error: str | None) -> None:
        """Pass: nobody waits for it here."""


@dataclass(frozen=True)
class MotionDelivery:
    """Sends designed motions to the simulated machine's controller.

    No request reaches an actuator: the controller gets a file, as it would from a person.

    Attributes
    ----------
    simulated : name of the simulated machine, None without one
    """

    files: DataDirectory
    excitations: Excitations
    designs: ExcitationKind
    simulated: Callable[[], str | None]

    def controller(self, machine: str) -> SimulatedController | None:
        """Return the simulated machine's controller; None: a real machine."""
        if machine != self.simulated():
            return None
        return SimulatedController(self.files.simulation, self.designs.motion)

    def send(self, excitation: str, name: str) -> None:
        """Send a designed motion to the simulated machine's controller.

        Raises
        ------
        NotFoundError, ConflictError
            If there is no such motion, or the machine is a real one.
        """
        row = self.excitations.get(excitation)
        if row.result is None:
            raise ConflictError("server.excitation_not_designed_yet", excitation=excitation, job=row.job)
        controller = self.controller(row.machine)
        if controller is None:
            raise ConflictError("server.machine_real_download_motion", machine=row.machine)
        controller.send(name, excitation)
