"""Arms that the tests of kinematics, dynamics and excitation share."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import yaml

from daq.machine.machine_file import Machine, load_machine, parse_machine
from fitting.arm.dynamics import COUPLED_PARAMETERS, JOINT_PARAMETERS, rigid_body_regressor
from fitting.arm.geometry import Geometry, geometry_of

RIGHT = np.pi / 2
SHARED = Path(__file__).parents[2].parent / "shared"


def sample_machine(case: str) -> Machine:
    """The machine file of a sample case; skips where the samples are absent."""
    path = SHARED / "samples" / case / "machine.yaml"
    if not path.exists():
        pytest.skip(f"sample {case} is not there")
    return load_machine(path)


def chain(kinds: str, alpha: list[float], a: list[float], d: list[float], gravity: list[float]) -> Geometry:
    """A chain from a string like ``RPR`` and its Denavit-Hartenberg columns."""
    n = len(kinds)
    return Geometry(
        revolute=np.array([kind == "R" for kind in kinds]),
        a=np.array(a),
        alpha=np.array(alpha),
        d=np.array(d),
        theta=np.zeros(n),
        gravity=np.array(gravity),
        position_limits=np.tile([-2.5, 2.5], (n, 1)),
        velocity_limits=np.full(n, 2.0),
        acceleration_limits=np.full(n, 5.0),
        names=tuple(f"joint{i + 1}" for i in range(n)),
    )


def random_chain(kinds: str, rng: np.random.Generator, *, square: bool = False) -> Geometry:
    """A chain with random lengths and twists (multiples of 90 degrees with ``square``), and gravity askew."""
    n = len(kinds)
    alpha = rng.choice([0.0, RIGHT, -RIGHT], n) if square else rng.uniform(-np.pi, np.pi, n)
    arm = chain(
        kinds, alpha.tolist(), rng.uniform(-1, 1, n).tolist(), rng.uniform(-1, 1, n).tolist(), rng.normal(size=3) * 6
    )
    return replace(arm, theta=rng.uniform(-np.pi, np.pi, n))


def puma_560() -> Geometry:
    """PUMA 560 with the lengths of Corke and Armstrong-Helouvry (ICRA 1994), standard convention, base upright."""
    return chain(
        "RRRRRR",
        [RIGHT, 0.0, -RIGHT, RIGHT, -RIGHT, 0.0],
        [0.0, 0.4318, 0.0203, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.15005, 0.4318, 0.0, 0.0],
        [0.0, 0.0, -9.81],
    )


def planar_arm(n: int, gravity: tuple[float, float, float] = (0.0, -9.81, 0.0)) -> Geometry:
    """``n`` parallel horizontal axes."""
    return chain("R" * n, [0.0] * n, np.linspace(0.9, 0.3, n).tolist(), [0.0] * n, list(gravity))


def physical_links(n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Masses (n,), centres (n, 3) and central inertias (n, 3, 3) of bodies made of eight point masses each."""
    masses, centres, inertias = np.zeros(n), np.zeros((n, 3)), np.zeros((n, 3, 3))
    for i in range(n):
        m, points = rng.uniform(0.5, 5, 8), rng.uniform(-0.4, 0.4, (8, 3))
        masses[i] = m.sum()
        centres[i] = m @ points / m.sum()
        r = points - centres[i]
        inertias[i] = np.einsum("k,kab->ab", m, np.einsum("ka,ka->k", r, r)[:, None, None] * np.eye(3)) - (m * r.T) @ r
    return masses, centres, inertias


def standard_parameters(masses: np.ndarray, centres: np.ndarray, inertias: np.ndarray) -> np.ndarray:
    """``[m, mx, my, mz, Ixx, Ixy, Ixz, Iyy, Iyz, Izz]`` about the frame's origin, per link: (n, 10)."""
    rows = []
    for m, c, central in zip(masses, centres, inertias, strict=True):
        about_origin = central + m * (c @ c * np.eye(3) - np.outer(c, c))
        rows.append([m, *(m * c), *about_origin[np.triu_indices(3)]])
    return np.array(rows)


def driven_arm(n: int, *, twisted: bool = False) -> Machine:
    """``n`` revolute joints with three-pin cylinders."""
    joints: list[dict[str, Any]] = []
    channels: list[dict[str, Any]] = []
    for i in range(n):
        name = f"joint{i + 1}"
        joints.append(
            {
                "name": name,
                "dh": {
                    "a": 0.8 - 0.1 * i,
                    "alpha": RIGHT * (i % 2) if twisted else 0.0,
                    "d": 0.1 * twisted,
                    "theta": 0.0,
                },
                "limits": {"position": [-0.6, 0.6], "velocity": 0.6, "acceleration": 1.5},
                "cylinder": {
                    "bore": 0.08,
                    "rod": 0.045,
                    "stroke": 0.3,
                    "linkage": {"type": "three_pin", "a": 0.45, "b": 0.16, "offset": 1.7, "retracted": 0.37},
                },
            }
        )
        channels += [
            {"name": f"{name}.x", "quantity": "piston_position", "joint": name, "unit": "m"},
            {"name": f"{name}.p1", "quantity": "head_pressure", "joint": name, "unit": "Pa"},
            {"name": f"{name}.p2", "quantity": "rod_pressure", "joint": name, "unit": "Pa"},
        ]
    content = {
        "schema": "hilfit/machine/1",
        "name": "test-arm",
        "gravity": [0.0, -9.81, 0.0] if not twisted else [0.0, 0.0, -9.81],
        "joints": joints,
        "channels": channels,
    }
    return parse_machine(yaml.safe_dump(content))


def standard_names(machine: Machine | Geometry) -> tuple[str, ...]:
    """Names of the ``13 n + 3 c`` standard parameters, per joint ten inertial, ``f_c f_v J``; then motors."""
    geometry = geometry_of(machine)
    own = tuple(f"{name}{i + 1}" for i in range(geometry.joints) for name in JOINT_PARAMETERS)
    return (*own, *(f"{name}{i + 1}" for i in geometry.coupled for name in COUPLED_PARAMETERS))


def inverse_dynamics(
    machine: Machine | Geometry,
    pi: npt.ArrayLike,
    q: npt.ArrayLike,
    qd: npt.ArrayLike,
    qdd: npt.ArrayLike,
    *,
    gravity: npt.ArrayLike | None = None,
) -> npt.NDArray[np.float64]:
    """Joint efforts that a motion takes, shape (N, n), in N m (N).

    Parameters
    ----------
    machine, q, qd, qdd, gravity
        As in :func:`rigid_body_regressor`.
    pi
        Inertial parameters, (10 n,) or (n, 10), or standard parameters, (13 n,) or (n, 13).

    Raises
    ------
    ValueError
        If a shape does not fit the machine.
    """
    n = geometry_of(machine).joints
    parameters = np.asarray(pi, dtype=float).ravel()
    if parameters.size not in (10 * n, 13 * n):
        raise ValueError(f"pi has {parameters.size} numbers; {n} joints take {10 * n} or {13 * n}")
    table = parameters.reshape(n, -1)
    used = np.flatnonzero(table[:, :10].ravel())
    Y = rigid_body_regressor(machine, q, qd, qdd, columns=used, gravity=gravity)
    tau = np.asarray(Y @ table[:, :10].ravel()[used])
    if table.shape[1] == 13:
        speed = np.asarray(qd, dtype=float)
        tau += table[:, 10] * np.sign(speed) + table[:, 11] * speed + table[:, 12] * np.asarray(qdd, dtype=float)
    return tau


def link_map(root: np.ndarray) -> np.ndarray:
    """Ten parameters of a link per entry of ``X``, (10, 16), of the pseudo-inertia ``root X root'``: by definition."""
    columns = []
    for unit in np.eye(16):
        J = root @ unit.reshape(4, 4) @ root.T
        J = (J + J.T) / 2
        inertia = np.trace(J[:3, :3]) * np.eye(3) - J[:3, :3]
        columns.append(np.concatenate([[J[3, 3]], J[:3, 3], inertia[np.triu_indices(3)]]))
    return np.array(columns).T
