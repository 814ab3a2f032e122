"""Gravity and friction as tables over their variables, for controllers that interpolate (a PLC).

Which variables a value has is tried out on the model (:mod:`fitting.model.export.grids`). How far linear interpolation
is off is measured on points between those of the grid, and said in ``tables.csv`` beside units and ranges. What needs
more than two variables is no table, and is said.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fitting.model import motion
from fitting.model.arm_model import ArmModel
from fitting.model.export.functions import written
from fitting.model.export.grids import Table, grid_points, tabled
from fitting.model.export.table_quantities import friction_quantities, gravity_quantities
from fitting.model.export.words import Written, refitted, require_folder, said_of


def write(model: ArmModel, path: Path, possible: bool = False) -> Written:
    """Write a folder of tables, and ``tables.csv`` that says what each is.

    Raises
    ------
    InputError
        If the folder is a file.
    """
    require_folder(path)
    reasons = {
        "belongs to the sensors": motion.left_out(model),
        "needs the motion before a moment": motion.histories(model),
        "needs the oil's temperature": motion.heated(model),
    }
    left_out = [f"{model.terms[k].id}: it {why}" for why, numbers in reasons.items() for k in sorted(numbers)]
    lost = motion.histories(model) | motion.heated(model)
    rest = model.rest(lost) if lost else None
    left_out += [] if rest is None else refitted(model, rest)
    whole, model = model, motion.at_rest(rest or model, cold=True)
    rng = np.random.default_rng(0)
    tables = []
    for quantity in (*gravity_quantities(model), *friction_quantities(model)):
        found = tabled(quantity, rng)
        if found is None:
            continue
        if isinstance(found, Table):
            tables.append(found)
        else:
            left_out.append(found)
    files = {f"{own.quantity.name}.csv": _text(own) for own in tables} | {"tables.csv": _index(tables)}
    files["card.txt"] = "\n".join([*said_of(whole, left_out), ""])
    return written(path, files, left_out)


def _text(table: Table) -> str:
    variables = [table.quantity.variables[k] for k in table.chosen]
    header = [*(f"{name} [{unit}]" for name, unit, _, _ in variables), f"{table.quantity.name} [{table.quantity.unit}]"]
    rows = np.column_stack([grid_points(table.axes), table.values.ravel()])
    return _csv([header, *([repr(value) for value in row] for row in rows.tolist())])


def _index(tables: Sequence[Table]) -> str:
    header = ["file", "value", "unit", "variables", "points", "largest", "interpolation_error", "says"]
    rows = []
    for own in tables:
        names = ["{} [{}] {!r} to {!r}".format(*own.quantity.variables[k]) for k in own.chosen]
        points = " x ".join(str(len(axis)) for axis in own.axes)
        largest = repr(float(np.max(np.abs(own.values))))
        name, unit = own.quantity.name, own.quantity.unit
        error = f"{own.error:.3g}"
        rows.append([f"{name}.csv", name, unit, "; ".join(names), points, largest, error, own.quantity.says])
    return _csv([header, *rows])


def _csv(rows: Sequence[Sequence[str]]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()
