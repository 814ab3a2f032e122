"""Tables against the model: interpolated by scipy, as a controller would."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from benchmarks.targets import Check, figure
from fitting.model import motion
from fitting.model.arm_model import ArmModel
from fitting.model.export import export_model

_TABLE_POINTS = 4000


def tables(name: str, model: ArmModel, folder: Path) -> list[Check]:
    """Check drives' friction by table between rows: share of the largest value, and of the stated error."""
    done = export_model(model, "csv", folder)
    with (folder / "tables.csv").open(encoding="utf-8") as file:
        index = {row["value"]: row for row in csv.DictReader(file)}
    rng, limits = np.random.default_rng(7), np.array([joint.limits.position for joint in model.machine.joints])
    q = rng.uniform(limits[:, 0], limits[:, 1], (_TABLE_POINTS, len(limits)))
    lever = motion.levers(model, q)
    shares, stated = [], []
    for k, joint in enumerate(model.joints):
        row = index.get(f"friction_{joint}")
        if row is None:
            continue
        table = _interpolated(folder / row["file"])
        speed = rng.uniform(-1.0, 1.0, _TABLE_POINTS) * float(np.max(table.grid[0]))
        qd = np.zeros_like(q)
        qd[:, k] = speed / lever[:, k]
        right = motion.friction(model, q, qd)[:, k] / lever[:, k]
        points = np.column_stack([speed, q[:, k]])[:, : len(table.grid)]
        error = float(np.max(np.abs(table(points) - right)))
        shares.append(error / float(np.max(np.abs(right))))
        stated.append(error / float(row["interpolation_error"]))
    shown = f"{max(shares):.1e} of the largest value, {max(stated):.2f} of the error that tables.csv states"
    shown += f" ({len(index)} tables, {len(done.left_out)} left out, {sum(p.stat().st_size for p in done.files)} bytes)"
    return [figure(f"{name}: friction by tables between their rows", max(stated), "{:g} of it", most=1.2, shown=shown)]


def _interpolated(path: Path) -> RegularGridInterpolator:
    rows = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)
    axes = [np.unique(column) for column in rows[:, :-1].T]
    return RegularGridInterpolator(axes, rows[:, -1].reshape([len(axis) for axis in axes]))
