"""The simulated machine of ``hilfit serve --simulate``: a stand-in on real bus protocols, in processes of its own."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


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
