"""Agreement of the service and its child for when a file of another tool is taken in."""

from __future__ import annotations

from pathlib import Path

#: The child's work: reading such a file as it is, and brought to the machine's rate.
IMPORTS = ("import", "import-resampled")


def map_beside(source: Path) -> Path:
    """Locate the map of a file's columns, if it has one."""
    return source.with_name(f"{source.name}.map")
