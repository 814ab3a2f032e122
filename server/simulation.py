"""The simulated machine of ``hilfit serve --simulate``: a stand-in on real bus protocols, in processes of its own."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from server.errors import UnavailableError
from server.files import write_atomically


@contextmanager
def simulated_machine(directory: Path, speed: float) -> Iterator[Path]:
    """Simulated buses of the default machine, with an effect in the plant that its machine file does not know.

    Parameters
    ----------
    directory : gets ``machine.yaml``, the controller's ``inbox/`` for motion files, and logs
    speed : machine seconds per second

    Yields
    ------
    The machine file with the addresses that hold for this run.
    """
    from sim_backends import SimulatedMachine, default_machine

    machine, truth = default_machine()
    with SimulatedMachine(machine, truth, undeclared="demo", speed=speed, workdir=directory) as simulated:
        yield simulated.machine_path


class SimulatedController:
    """The arm's own controller of the simulated machine: motions are files in its inbox.

    Parameters
    ----------
    directory : of the simulated machine
    motion : where the motion file of an excitation is
    """

    def __init__(self, directory: Path, motion: Callable[[str], Path]) -> None:
        self._directory = directory
        self._motion = motion

    def send(self, name: str, excitation: str) -> None:
        """Hand it the motion of an excitation under a name."""
        write_atomically(self._directory / "inbox" / f"{name}.csv", self._motion(excitation).read_bytes())

    def follows(self, name: str) -> bool:
        """Whether it began to follow the motion.

        Raises
        ------
        UnavailableError
            If it refused the motion, or is not there.
        """
        status = self._status()
        if name in status["rejected"]:
            raise UnavailableError(f"the simulated controller refused the motion: {status['rejected'][name]}")
        return name in status["followed"]

    def _status(self) -> dict[str, Any]:
        try:
            return dict(json.loads((self._directory / "controller.json").read_text(encoding="utf-8")))
        except (OSError, ValueError):
            raise UnavailableError("the simulated machine's controller does not answer; restart the service") from None
