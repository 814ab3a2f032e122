"""Recordings as plots need them: columns are made readable one by one at the first look, and kept for the next."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from daq.arrays import BoolArray, FloatArray
from server.platform.errors import InvalidError
from server.platform.files import DataDirectory
from server.recordings.formats.exports import Exports
from server.recordings.recording_store import RecordingRow
from server.traces.extremes import Extremes, at_most

#: Recordings whose columns are kept; a day at 50 Hz of 24 channels takes half a gigabyte.
KEPT = 8
#: Values of a spectrum, and the rows of the window that it is averaged over.
SPECTRUM_ROWS = 4096


@dataclass(frozen=True)
class About:
    """Names and units of the columns, and what stands beside them.

    Attributes
    ----------
    channels, units : in the order of the columns
    first_utc : s since 1970 of the first row, if the recording says so
    events : as :class:`daq.recordings.recorded_events.RecordedEvent`
    """

    channels: list[str]
    units: list[str]
    first_utc: float | None
    events: list[dict[str, Any]]


class RecordedSignals:
    """Looks at recordings.

    Parameters
    ----------
    exports : finds their files, and makes others of them
    """

    def __init__(self, files: DataDirectory, exports: Exports) -> None:
        self._files = files
        self._exports = exports

    def read(
        self, row: RecordingRow, start: float | None, end: float | None, moments: int, wanted: Sequence[str] | None
    ) -> tuple[About, list[int], Extremes, tuple[float, float]]:
        """Read channels over time.

        Parameters
        ----------
        start, end : s since the first row; None: its beginning, its end
        wanted : names of channels; None for all

        Returns
        -------
        what the columns are, which of them were read, their extremes, and the range

        Raises
        ------
        InvalidError, ConflictError, NotFoundError
            If a channel is unknown, or there is no whole file.
        """
        with np.load(self._signals(row), allow_pickle=False) as kept:
            about = _about(kept)
            columns = _columns(about, about.channels if wanted is None else wanted, row)
            time = kept["time"]
            first = 0.0 if start is None else start
            last = float(time[-1]) if end is None and len(time) else (end or 0.0)
            part = slice(*np.searchsorted(time, [first, np.nextafter(last, np.inf)]))
            values = np.stack([kept[f"value{n}"][part] for n in columns], axis=1)
            flagged = np.stack([kept[f"doubtful{n}"][part] for n in columns], axis=1)
        found = at_most(Extremes(time[part], values, values, flagged, 0.0), first, max(last, first + 1e-9), moments)
        return about, columns, found, (first, last)

    def spectrum(
        self, row: RecordingRow, channel: str, start: float, end: float | None
    ) -> tuple[str, float, FloatArray, FloatArray]:
        """Compute unit, seconds, frequencies (Hz), power spectral density (unit^2/Hz) by Welch's method.

        Of the longest part without a gap; Hann windows that overlap by half, the mean of each taken off
        (P. D. Welch 1967, IEEE Trans. Audio Electroacoust. 15).
        """
        with np.load(self._signals(row), allow_pickle=False) as kept:
            about = _about(kept)
            (column,) = _columns(about, [channel], row)
            time = kept["time"]
            part = slice(*np.searchsorted(time, [start, np.inf if end is None else end]))
            values, time = kept[f"value{column}"][part].astype(np.float64), time[part]
        whole = _longest(time, np.isfinite(values))
        values, time = values[whole], time[whole]
        if len(values) < 16:
            raise InvalidError("server.recording_fewer_rows_without", row=row.id, channel=channel)
        rate = (len(time) - 1) / float(time[-1] - time[0])
        window = min(SPECTRUM_ROWS, max(16, len(values) // 4))
        from scipy import signal  # the service starts without it

        frequency, density = signal.welch(values, fs=rate, nperseg=window)
        return about.units[column], len(values) / rate, frequency[1:], density[1:]

    def events(self, row: RecordingRow) -> list[dict[str, Any]]:
        """List what happened to devices while it was recorded."""
        with np.load(self._signals(row), allow_pickle=False) as kept:
            return _about(kept).events

    def findings(self, row: RecordingRow) -> list[dict[str, Any]]:
        """Return what ``hilfit check`` finds in it; computed once, kept beside it."""
        kept = self._files.recordings / f"{row.id}.findings.json"
        if not kept.is_file():
            self._made(row, "findings", kept.suffix, row.role).replace(kept)
        return list(json.loads(kept.read_text(encoding="utf-8")))

    def cut(self, row: RecordingRow, start: float, end: float) -> Path:
        """Cut a part of it to a new file, to be stored or removed."""
        return self._made(row, "cut", f".{row.format}", repr(start), repr(end))

    def _signals(self, row: RecordingRow) -> Path:
        self._exports.source(row)  # refuses what is not sealed, or gone
        kept = self._files.recordings / f"{row.id}.signals.npz"
        if kept.is_file():
            kept.touch()
        else:
            self._made(row, "signals", kept.suffix).replace(kept)
            known = sorted(self._files.recordings.glob("*.signals.npz"), key=_used)
            for old in known[:-KEPT]:
                old.unlink(missing_ok=True)
        return kept

    def _made(self, row: RecordingRow, what: str, suffix: str, *rest: str) -> Path:
        return self._exports.made(row, what, suffix, row.label or row.id, *rest, by="server.traces.recording_child")


def _used(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except FileNotFoundError:  # another look has removed it
        return 0.0


def _about(kept: Any) -> About:
    return About(**json.loads(kept["about"].tobytes()))


def _columns(about: About, wanted: Sequence[str], row: RecordingRow) -> list[int]:
    for name in wanted:
        if name not in about.channels:
            raise InvalidError("server.channel_recording_none_name", name=name, row=row.id)
    return [about.channels.index(name) for name in wanted]


def _longest(time: FloatArray, finite: BoolArray) -> slice:
    """Find the longest run of rows with a value and without a gap in time."""
    if len(time) < 2:
        return slice(0, 0)
    steps = np.diff(time)
    breaks = np.flatnonzero((steps > 1.5 * np.median(steps)) | ~finite[1:] | ~finite[:-1]) + 1
    ends = np.concatenate([[0], breaks, [len(time)]])
    longest = int(np.argmax(np.diff(ends)))
    return slice(int(ends[longest]), int(ends[longest + 1]))
