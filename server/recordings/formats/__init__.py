"""Recordings in the forms that other tools read, over HTTP; and their statistics.

:mod:`daq.recordings.recording_exports` writes them. Everything that opens a file from outside runs in a child process
with bounded memory (:mod:`server.recordings.formats.conversion_child`).

- :mod:`server.recordings.formats.conversion_child`: what a recording holds, channel by channel
- :mod:`server.recordings.formats.exports`: the service's side: starts the children, names the files

Nothing of these is imported here: the children load what their piece of work needs, and not the store.
"""

from __future__ import annotations

from pathlib import Path

#: The child's work when a file of another tool is taken in: as it is, and brought to the machine's rate.
IMPORTS = ("import", "import-resampled")


def map_beside(source: Path) -> Path:
    """Locate the map of a file's columns, if it has one."""
    return source.with_name(f"{source.name}.map")
