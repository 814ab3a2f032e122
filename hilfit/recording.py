"""Recordings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from daq.recordings.recording import Recording as RecordingFile
from daq.recordings.recording import read_recording
from hilfit.machine import Machine


@dataclass(frozen=True)
class Recording:
    """A recording of a machine that passed every check.

    Attributes
    ----------
    path : the file
    content : what it holds, SI
    """

    path: Path
    content: RecordingFile

    @classmethod
    def load(cls, path: str | Path, machine: Machine, role: str = "operation") -> Recording:
        """Read a recording: Parquet, CSV, MDF4, MAT or a ROS 2 bag.

        Raises
        ------
        InputError
            One line: file, channel, place, what to do.
        """
        return cls(Path(path), read_recording(path, machine.content, role))

    @property
    def time(self) -> npt.NDArray[np.float64]:
        """Machine time (N,), s."""
        return self.content.time

    @property
    def values(self) -> Mapping[str, npt.NDArray[np.float64]]:
        """Per channel (N,), SI; NaN where nothing was measured."""
        return self.content.values
