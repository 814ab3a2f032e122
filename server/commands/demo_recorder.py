"""The demonstration's machine makes a motion that the identification asks for."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from daq.recordings.recording import Recording
    from fitting.loop.closing import Asked
    from sim_backends.simulated_machine import SimulatedMachine


class DemoRecorder:
    """Records motions on a simulated machine, over its buses (a :class:`fitting.loop.closing.Recorder`).

    Acquisition runs while a motion is recorded and not in between, so machine time stands still meanwhile.

    Parameters
    ----------
    simulated : the machine, switched on
    output : gets ``motions/resolve-N.csv`` and ``recordings/resolve-N.parquet``
    """

    def __init__(self, simulated: SimulatedMachine, output: Path) -> None:
        self._simulated, self._output = simulated, output

    def __call__(self, asked: Asked, number: int) -> Recording:
        """Let the arm follow the motion and read what was recorded of it."""
        from daq.acquisition.acquisition import AcquisitionProcess
        from daq.recordings.recording import read_recording
        from server.commands.demo_command import record_motion, save_motion

        name = f"resolve-{number}"
        save_motion(self._output / "motions" / f"{name}.csv", asked.motion)
        path = self._output / "recordings" / f"{name}.parquet"
        with AcquisitionProcess(self._simulated.machine_path) as acquisition:
            record_motion(self._simulated, acquisition, asked.motion, (name, asked.role), path)
            machine = acquisition.machine
        return read_recording(path, machine, asked.role)
