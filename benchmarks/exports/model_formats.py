"""The formats that other programs run, against the model: MATLAB under Octave, both FMUs through fmpy, tables.

Octave and fmpy are processes and libraries of others; the tables are interpolated by scipy, as a controller would.
"""

from __future__ import annotations

import csv
import shutil
import subprocess
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.interpolate import RegularGridInterpolator

from benchmarks.targets import Check
from fitting.model import motion
from fitting.model.arm_model import ArmModel
from fitting.model.export import export_model
from fitting.model.export.functions import identifier

FloatArray = npt.NDArray[np.float64]
#: States of a motion, each (N, n), and times (N,).
States = tuple[FloatArray, FloatArray, FloatArray, FloatArray]
EXACT = 1e-9
_STEP = 0.02  # s between the FMUs' samples
_TABLE_POINTS = 4000


def formats(name: str, model: ArmModel, folder: Path, state: States, expected: FloatArray) -> list[Check]:
    """A check for each format; ``expected`` (N, n) are the model's efforts in these states."""
    return [
        _matlab(name, model, folder, state, expected),
        *_units(name, model, folder / "fmu", state),
        *_tables(name, model, folder / "csv"),
    ]


def _against(name: str, what: str, found: FloatArray, right: FloatArray) -> Check:
    share = float(np.max(np.abs(found - right)) / np.max(np.abs(right)))
    return Check(f"{name}: {what} against the model", share, f"{share:.1e}", "at most", EXACT, f"{EXACT:.0e}")


def _matlab(name: str, model: ArmModel, folder: Path, state: States, expected: FloatArray) -> Check:
    octave = shutil.which("octave-cli") or shutil.which("octave")
    if octave is None:
        return Check(f"{name}: MATLAB", None, "there is no GNU Octave (apt-get install octave)")
    function, n = identifier(model.machine.name), expected.shape[1]
    export_model(model, "matlab", folder / f"{function}.m")
    np.savetxt(folder / "states.csv", np.column_stack(state), delimiter=",", fmt="%.17g")
    columns = [f"m(:, {k * n + 1}:{(k + 1) * n})" for k in range(3)]
    (folder / "ask.m").write_text(
        f"m = csvread('states.csv');\ntau = {function}('inverse_dynamics', {', '.join(columns)}, m(:, {3 * n + 1}));\n"
        "dlmwrite('tau.csv', tau, 'precision', 17);\n",
        encoding="utf-8",
    )
    subprocess.run([octave, "--no-gui", "--norc", "ask.m"], cwd=folder, check=True, capture_output=True)
    return _against(name, "MATLAB under Octave", np.loadtxt(folder / "tau.csv", delimiter=","), expected)


def _units(name: str, model: ArmModel, folder: Path, state: States) -> list[Check]:
    if find_spec("fmpy") is None:
        return [Check(f"{name}: FMU", None, "fmpy is not installed (pip install fmpy)")]
    done = export_model(model, "fmu", folder)
    if shutil.which("cc") is None:
        return [Check(f"{name}: FMU", None, "there is no compiler (cc)")]
    return [
        _unit(f"FMU {version}.0, {kind}", name, model, path, kind, state)
        for path, version in zip(done.files, (3, 2), strict=True)
        for kind in ("ModelExchange", "CoSimulation")
    ]


def _unit(what: str, name: str, model: ArmModel, path: Path, kind: str, state: States) -> Check:
    """Efforts and gravity of one unit, at the inputs that fmpy says it gave."""
    from fmpy import simulate_fmu

    q, qd, qdd, _ = state
    n, words = q.shape[1], ("q", "qd", "qdd")
    names = [f"{word}[{joint + 1}]" for word in words for joint in range(n)]
    inputs = np.zeros(len(q), dtype=[("time", float), *((own, float) for own in names)])
    inputs["time"] = _STEP * np.arange(len(q))
    for own, values in zip(names, np.column_stack([q, qd, qdd]).T, strict=True):
        inputs[own] = values
    outputs = [f"{word}[{joint + 1}]" for word in ("effort", "gravity") for joint in range(n)]
    found = simulate_fmu(
        str(path),
        fmi_type=kind,
        input=inputs,
        output=[*names, *outputs],
        start_time=0.0,
        stop_time=float(inputs["time"][-1]),
        output_interval=_STEP,
        step_size=_STEP,
        solver="Euler",
    )

    def columns(word: str) -> FloatArray:
        return np.column_stack([found[f"{word}[{joint + 1}]"] for joint in range(n)])

    given, time = [columns(word) for word in words], np.asarray(found["time"])
    q, qd, qdd = given
    efforts = motion.on_motion(model, q, qd, qdd, time)
    right = {"effort": efforts.joint_effort(0), "gravity": motion.gravity(model, q)}
    shares = [float(np.max(np.abs(columns(word) - values)) / np.max(np.abs(values))) for word, values in right.items()]
    worst = max(shares)
    shown = f"{worst:.1e} (efforts {shares[0]:.1e}, gravity {shares[1]:.1e})"
    return Check(f"{name}: {what} against the model", worst, shown, "at most", EXACT, f"{EXACT:.0e}")


def _tables(name: str, model: ArmModel, folder: Path) -> list[Check]:
    """Friction of every drive by its table between the rows: share of the largest value, and of the stated error."""
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
    return [Check(f"{name}: friction by tables between their rows", max(stated), shown, "at most", 1.2, "1.2 of it")]


def _interpolated(path: Path) -> RegularGridInterpolator:
    rows = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)
    axes = [np.unique(column) for column in rows[:, :-1].T]
    return RegularGridInterpolator(axes, rows[:, -1].reshape([len(axis) for axis in axes]))
