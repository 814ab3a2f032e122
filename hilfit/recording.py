"""Recordings."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import numpy.typing as npt

from daq.errors import InputError
from daq.machine.machine_file import Machine as MachineFile
from daq.quality import Quality
from daq.recordings.recording import Recording as RecordingFile
from daq.recordings.recording import read_recording
from daq.recordings.recording_files import arrow_table, write_table
from hilfit.machine import Machine

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, repr=False)
class Recording:
    """Channels of a machine over time: a file that passed every check, or arrays, which are checked when they are used.

    Attributes
    ----------
    time : machine time (N,), s
    values : per channel (N,), SI (of arrays: in ``units``, where they say another); NaN where nothing was measured
    path, content : the file, and what it holds; None of arrays
    units : units of arrays that are not SI, by channel
    """

    time: FloatArray
    values: Mapping[str, FloatArray]
    path: Path | None = None
    content: RecordingFile | None = None
    units: Mapping[str, str] | None = None

    @classmethod
    def load(cls, path: str | Path, machine: Machine, role: str = "operation") -> Recording:
        """Read a recording: Parquet, CSV, MDF4, MAT or a ROS 2 bag.

        Parameters
        ----------
        path : of the file, or of a bag's folder
        machine : whose channels it has to hold
        role : what it was made for (``train``, ``validate``, ..): some checks are of one role alone

        Raises
        ------
        InputError
            One line: file, channel, place, what to do.
        """
        content = read_recording(path, machine.content, role)
        return cls(content.time, content.values, Path(path), content)

    @classmethod
    def from_arrays(
        cls, time: npt.ArrayLike, values: Mapping[str, npt.ArrayLike], *, units: Mapping[str, str] | None = None
    ) -> Recording:
        """Make a recording of arrays.

        Parameters
        ----------
        time : (N,) s, rising in steps of the machine's rate
        values : per channel of the machine file (N,), SI; NaN where nothing was measured
        units : units of the channels that are not SI, ``{"boom.angle": "deg"}``

        Raises
        ------
        InputError
            One line: the channel, and what is wrong with its array.
        """
        clock = _one_dimensional("time", time)
        columns = {name: _one_dimensional(name, column) for name, column in values.items()}
        for name, column in columns.items():
            if len(column) != len(clock):
                raise InputError("daq.array_other_length", name=name, count=len(column), times=len(clock))
        unknown = sorted(set(units or {}) - set(columns))
        if unknown:
            raise InputError("daq.unit_without_array", name=unknown[0])
        return cls(clock, columns, units=units or {})

    @classmethod
    def from_pandas(cls, frame: Any, *, units: Mapping[str, str] | None = None) -> Recording:
        """Make a recording of a pandas table: one column per channel, ``time`` in a column of that name or the index.

        Times are seconds, or moments (made relative to the first). Errors as of :meth:`from_arrays`.

        Parameters
        ----------
        frame : table, SI; NaN where nothing was measured
        units : units of the channels that are not SI
        """
        moments = frame["time"] if "time" in frame.columns else frame.index.to_series()
        if moments.dtype.kind in "mM":
            moments = (moments - moments.iloc[0]).dt.total_seconds()
        columns = {str(name): frame[name].to_numpy() for name in frame.columns if name != "time"}
        return cls.from_arrays(moments.to_numpy(), columns, units=units)

    def of(self, machine: MachineFile, role: str = "operation") -> RecordingFile:
        """Read what it holds, checked against a machine; errors as of :meth:`load`.

        Parameters
        ----------
        machine, role : as of :meth:`load`, the machine as its file says
        """
        if self.content is not None:
            return self.content
        with TemporaryDirectory(prefix="hilfit-") as folder:
            return read_recording(self.file(machine, Path(folder) / "arrays.parquet"), machine, role)

    def file(self, machine: MachineFile, place: Path) -> Path:
        """Return its file; of arrays one that is written.

        Parameters
        ----------
        machine : what its file says; gives the units of arrays
        place : where arrays are written to, as Parquet
        """
        if self.path is not None:
            return self.path
        columns: dict[str, npt.NDArray[np.generic]] = {"time": self.time}
        for name, column in self.values.items():
            columns[name] = column
            if np.isnan(column).any():
                columns[f"{name}.quality"] = np.where(np.isnan(column), int(Quality.MISSING), int(Quality.FRESH))
        si = {own.name: machine.si_unit(own) for own in machine.channels if own.name in self.values}
        units = json.dumps({**si, **(self.units or {})})
        write_table(place, arrow_table(columns).replace_schema_metadata({"hilfit.units": units}))
        return place

    def __repr__(self) -> str:
        seconds = float(self.time[-1] - self.time[0]) if len(self.time) else 0.0
        origin = "arrays" if self.path is None else self.path.name
        return f"Recording({origin}: {len(self.values)} channels, {len(self.time)} rows, {seconds:g} s)"


def _one_dimensional(name: str, values: npt.ArrayLike) -> FloatArray:
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError("daq.array_no_numbers", name=name) from None
    if array.ndim != 1:
        raise InputError("daq.array_other_dimensions", name=name, count=array.ndim)
    return array
