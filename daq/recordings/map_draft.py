"""A draft of the map that a foreign file needs: what is known of its columns is filled in, the rest is asked."""

from __future__ import annotations

import difflib
import json
from collections.abc import Sequence
from pathlib import Path

from daq.errors import InputError, RecordingError
from daq.machine.machine_file import Machine
from daq.recordings.column_map import named_columns


class UnknownColumnsError(RecordingError):
    """Another tool's file whose columns do not tell which channels they are: a map has to say it."""

    def __init__(self, text: str, path: Path, columns: Sequence[str]) -> None:
        super().__init__(text)
        self.path, self.columns = path, tuple(columns)


def write_draft(error: UnknownColumnsError, machine: Machine) -> Path:
    """Write the draft beside the file that was refused, under a free name (``log.map.yaml``, ``log.map-2.yaml``).

    Raises
    ------
    InputError
        If the folder cannot be written.
    """
    text = draft(error.path, error.columns, machine)
    for number in range(1, 100):
        place = error.path.with_name(f"{error.path.stem}.map{'' if number == 1 else f'-{number}'}.yaml")
        try:
            with place.open("x", encoding="utf-8") as file:
                file.write(text)
        except FileExistsError:
            continue
        except OSError as failed:
            raise InputError("daq.draft_of_map_not_written", error=error, place=place, reason=failed.strerror) from None
        return place
    raise InputError("daq.drafts_of_map_many", error=error, folder=error.path.parent)


def draft(path: Path, columns: Sequence[str], machine: Machine) -> str:
    """Write the draft: valid YAML, in which what has to be looked at is commented out."""
    known = named_columns(columns, machine)
    free = [column for column in columns if column not in known.values()]
    lines = [
        f"# Which column of {_quoted(path.name)} is which channel of '{machine.name}'. Correct the lines with '#',",
        "# remove the '#', add unit:, scale: and offset: where they are needed (channel = scale * column + offset, in",
        f"# unit), and give the file with --map. Columns: {', '.join(map(_quoted, columns))}",
    ]
    for channel in ("time", *(own.name for own in machine.channels)):
        if channel in known:
            lines.append(f"{channel}: {_quoted(known[channel])}")
            continue
        near = difflib.get_close_matches(channel, free, n=1, cutoff=0.3)
        unit = "s" if channel == "time" else next(own.unit for own in machine.channels if own.name == channel)
        lines.append(f"# {channel}: {{column: {_quoted(near[0] if near else '')}}}   # in {unit}")
    return "\n".join(lines) + "\n"


def _quoted(column: str) -> str:
    """Quote a YAML scalar that a header of any signs fits into."""
    return json.dumps(column, ensure_ascii=not column.isprintable())
