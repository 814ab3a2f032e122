"""Recordings as far as they can be read: what the strict reader refuses becomes a finding, and the checks go on.

:func:`daq.recordings.recording.read_recording` refuses a recording at its first problem, which is right for an
identification and too early for a search for the cause: values out of range are what a wrong unit looks like.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from daq.arrays import IntArray
from daq.errors import RecordingError
from daq.machine.machine_file import Channel, Machine
from daq.messages import Sentence
from daq.quality import MEASURED
from daq.recordings import recording_checks as gates
from daq.recordings.column_map import ColumnMap
from daq.recordings.encoder_wraps import unwrapped, wrap_text
from daq.recordings.foreign_files import is_foreign
from daq.recordings.recording import MINIMUM_SECONDS, ROLES, Recording
from daq.recordings.recording_files import read_table
from daq.recordings.recording_source import load_table
from daq.units import conversion
from fitting.arrays import FloatArray
from fitting.checks.findings import Finding, finding_of
from fitting.checks.time_axis import repaired_time, time_findings


@dataclass(frozen=True)
class Read:
    """A recording as far as it could be read (None: not at all), and what is wrong in its own file."""

    recording: Recording | None
    findings: tuple[Finding, ...]


def recorded_role(path: Path) -> str:
    """Return the recorded role that a file declares, else that of its name's beginning, else ``train``.

    Raises
    ------
    RecordingError
        If the file is no table.
    """
    named = path.stem.partition("-")[0]
    role = named if is_foreign(path) else read_table(path).metadata.get("hilfit.role", named)
    return role if role in ROLES else "train"


def read_leniently(
    path: Path, machine: Machine, role: str, columns: ColumnMap | None = None, *, resample: bool = False
) -> Read:
    """Read what can be read.

    Parameters
    ----------
    columns : which column is which channel, where names are ambiguous
    resample : whether another rate than the machine's is brought to it

    Raises
    ------
    RecordingError
        If the file is no table at all.
    """
    found: list[Finding] = []

    def gate(code: str, check: Callable[[], object]) -> None:
        try:
            check()
        except RecordingError as error:
            # A refusal has its cure in its text.
            found.append(Finding(code, error.args[0], "", recording=str(path), strength=1.0))

    try:
        table = load_table(path, machine, columns, resampled=resample, role=role)[0]
    except RecordingError:
        # Not these columns, or not this rate: what is there is looked at as it is.
        table = read_table(path)
        gate("columns", partial(gates.columns_fit, path, table, machine))
    code = "other_machine" if table.metadata.get("hilfit.machine", machine.name) != machine.name else "wrong_role"
    gate(code, partial(gates.metadata_fits, path, table.metadata, machine, role))
    if "time" not in table.columns or table.rows < 2:
        if table.rows < 2 and not found:
            found.append(finding_of("too_short", recording=str(path)))
        return Read(None, tuple(found))
    time = np.array(table.columns["time"], dtype=np.float64)
    units = _units(table.metadata)
    values: dict[str, FloatArray] = {}
    for channel in machine.channels:
        column = table.columns.get(channel.name)
        if column is None:
            continue
        raw = np.array(column, dtype=np.float64)
        flags = table.columns.get(f"{channel.name}.quality")
        if flags is None:
            gate("not_numbers", partial(gates.values_are_numbers, path, channel.name, raw, time, None))
        else:
            raw = np.where(np.isin(np.asarray(flags), MEASURED), raw, np.nan)
        try:
            to_si = conversion(units.get(channel.name, channel.unit), machine.si_unit(channel))
        except ValueError:
            to_si = machine.conversion(channel)
        value, wraps = unwrapped(machine, channel, np.where(np.isfinite(raw), to_si.to_si(raw), np.nan))
        if len(wraps):
            found.append(_wrapped(path, channel, wraps, time))
        values[channel.name] = value
    found += time_findings(machine, str(path), time, values)
    used = repaired_time(time, machine.rate_hz)
    recording = Recording(machine.name, role, str(path), table.sha256, machine.rate_hz, used, values)
    if len(values) == len(machine.channels):
        gate("too_short", partial(gates.long_enough, path, values, machine, MINIMUM_SECONDS))
    for channel in machine.channels:
        if channel.name in values:
            gate("saturated", partial(gates.not_saturated, path, channel, machine, values[channel.name], used))
    if len(values) == len(machine.channels):
        gate("constant", partial(gates.nothing_constant, path, machine, role, values))
    return Read(recording, tuple(found))


def _wrapped(path: Path, channel: Channel, rows: IntArray, time: FloatArray) -> Finding:
    """Report an encoder of one turn that begins anew within the motion, corrected on reading."""
    text, cure = wrap_text(path, channel.name, rows, time), Sentence("fitting.nothing_done_turns_put")
    return Finding("wrap", text, cure, channel.joint, channel.name, recording=str(path), severity="note")


def _units(metadata: Mapping[str, str]) -> dict[str, str]:
    """Read the units that the file itself carries; none if it has none, or they are damaged."""
    text = metadata.get("hilfit.units")
    try:
        units = json.loads(text) if text is not None else {}
    except ValueError:
        units = {}
    return {str(k): str(v) for k, v in units.items()} if isinstance(units, dict) else {}
