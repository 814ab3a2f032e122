"""The simulated machine of ``hilfit serve --simulate``: a stand-in on real bus protocols, in processes of its own."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any

import structlog

from daq.messages import put_together
from daq.whole_files import write_whole
from server.platform.errors import InvalidError, StartError, UnavailableError

#: s that the simulated buses have to end.
LEAVING_S = 15.0
_log = structlog.stdlib.get_logger(__name__)


class Simulation:
    """The process of the simulated machine; it loads from the moment it is made, and waits for :meth:`machine`.

    Parameters
    ----------
    faults : a fault file, what breaks while it runs
    """

    def __init__(self, faults: Path | None = None) -> None:
        self._faults = None if faults is None else str(faults.resolve())
        self._ordering = threading.Lock()  # an answer belongs to the order before it
        self._runs = False
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "server.machines.simulation_child", str(os.getpid())],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,  # Ctrl-C is for the service, which ends it in its turn
        )

    def close(self) -> None:
        """End it, and the buses with it."""
        process = self._process
        assert process.stdin is not None and process.stdout is not None
        with suppress(BrokenPipeError):
            process.stdin.close()
        try:
            process.wait(LEAVING_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        process.stdout.close()

    @contextmanager
    def machine(self, directory: Path, speed: float) -> Iterator[Path]:
        """Simulate the default machine's buses, with a plant effect that its machine file does not know.

        Parameters
        ----------
        directory : gets ``machine.yaml``, the controller's ``inbox/`` for motion files, and logs
        speed : machine seconds per second

        Yields
        ------
        The machine file with the addresses that hold for this run.

        Raises
        ------
        StartError
            If they do not start; one line.
        """
        with closing(self):
            reply = self._asked(directory=str(directory), speed=speed, faults=self._faults)
            if reply is None:
                raise StartError("server.simulation_ended")
            if "error" in reply:
                raise StartError("server.simulation_not_started", error=reply["error"])
            self._runs = True
            threading.Thread(target=self._watch, daemon=True).start()
            try:
                yield Path(reply["machine"])
            finally:
                self._runs = False

    def _watch(self) -> None:
        """End the service when the simulation ends by itself: without a machine it has to start anew as a whole."""
        self._process.wait()
        if self._runs:
            _log.critical("simulated_machine_ended", code=self._process.returncode)
            os.kill(os.getpid(), signal.SIGTERM)

    def order(self, order: str, **details: Any) -> Any:
        """Order something of it (:mod:`server.machines.simulation_child`) and wait for the answer.

        Raises
        ------
        InvalidError
            If it refuses the order, in one line.
        UnavailableError
            If it does not answer.
        """
        with self._ordering:
            if not self._runs:
                raise UnavailableError("server.simulated_machine_not_run")
            reply = self._asked(order=order, **details)
        if reply is None:
            raise UnavailableError("server.simulated_machine_not_answer")
        if "error" in reply:
            raise InvalidError(reply["error"])
        return reply["result"]

    def _asked(self, **order: Any) -> dict[str, Any] | None:
        """Send its process an order; return the answer, None if it has ended."""
        process = self._process
        assert process.stdin is not None and process.stdout is not None
        with suppress(OSError):
            process.stdin.write(json.dumps(order) + "\n")
            process.stdin.flush()
        line = process.stdout.readline()
        return dict(put_together(json.loads(line))) if line else None


@contextmanager
def simulated_machine(directory: Path, speed: float) -> Iterator[Path]:
    """Run :meth:`Simulation.machine` in a process that is made now."""
    with Simulation().machine(directory, speed) as path:
        yield path


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
        """Send it the motion of an excitation under a name."""
        write_whole(self._directory / "inbox" / f"{name}.csv", self._motion(excitation).read_bytes())

    def follows(self, name: str) -> bool:
        """Test whether it began to follow the motion.

        Raises
        ------
        UnavailableError
            If it refused the motion, or is not there.
        """
        status = self._status()
        if name in status["rejected"]:
            raise UnavailableError("server.simulated_controller_refused_motion", statu=status["rejected"][name])
        return name in status["followed"]

    def _status(self) -> dict[str, Any]:
        try:
            return dict(json.loads((self._directory / "controller.json").read_text(encoding="utf-8")))
        except (OSError, ValueError):
            raise UnavailableError("server.simulated_machine_controller_not") from None
