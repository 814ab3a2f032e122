"""MATLAB's MAT files (version 5, by scipy): a variable per column, and what they are.

A channel's name is no variable's name: ``boom.head_pressure`` becomes ``boom_head_pressure``. The names as they are
stand in ``hilfit_columns``, in the order of ``hilfit_variables``, with ``hilfit_units``; the rest of what the file says
about itself in ``hilfit_metadata``, as JSON.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import scipy

from daq.recordings.recording_files import Table

LONGEST = 63  # characters of a variable's name in MATLAB


def write(table: Table, units: dict[str, str], target: Path) -> None:
    """Write a recording's table.

    Parameters
    ----------
    units : per column, for those that have one
    """
    names = variables(table.columns)
    content = {names[column]: np.asarray(values)[:, None] for column, values in table.columns.items()}
    cells = {
        "hilfit_columns": list(names),
        "hilfit_variables": list(names.values()),
        "hilfit_units": [units.get(column, "") for column in names],
    }
    for name, texts in cells.items():
        content[name] = np.array(texts, dtype=object)[:, None]
    content["hilfit_metadata"] = np.array(json.dumps(dict(table.metadata)))
    scipy.io.savemat(str(target), content, appendmat=False, long_field_names=True, do_compression=True)


def variables(columns: Iterable[str]) -> dict[str, str]:
    """Make names of variables for names of columns, all different."""
    made: dict[str, str] = {}
    for column in columns:
        plain = re.sub(r"[^A-Za-z0-9_]", "_", column)
        plain = (plain if re.match(r"[A-Za-z]", plain) else f"x{plain}")[:LONGEST]
        name, number = plain, 2
        while name in made.values():
            end = f"_{number}"
            name, number = plain[: LONGEST - len(end)] + end, number + 1
        made[column] = name
    return made
