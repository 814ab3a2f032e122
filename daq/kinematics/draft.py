"""The draft of a machine file from a chain: complete as it stands, with what a person has to add as TODO comments."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from daq.errors import HilfitError, InputError
from daq.kinematics.chain import Axis, Chain
from daq.kinematics.mjcf import mjcf_chain
from daq.kinematics.table import Table, table_of
from daq.kinematics.urdf import expanded, urdf_chain

SUFFIXES = (".urdf", ".xacro", ".xml")
_POSITION = {"revolute": (-np.pi, np.pi), "prismatic": (0.0, 1.0)}
_VELOCITY = 1.0
_SPEED_UP = 0.5  # s to the largest speed: files of kinematics have no accelerations
_AGREES = 1e-6  # m and 1: the table's poses against the chain's own


def read_chain(path: Path, tip: str | None = None) -> Chain:
    """Read the serial chain of a URDF, xacro or MJCF file; ``tip`` names its last link or body.

    Raises
    ------
    InputError
        One line that names file, joint or link, and gives the cure.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise InputError("daq.chain_unknown_kind_file", path=path, suffix=path.suffix)
    if not path.is_file():
        raise InputError("daq.no_chain_file", path=path)
    try:
        text = expanded(path) if path.suffix.lower() == ".xacro" else path.read_text(encoding="utf-8")
        root = ET.fromstring(text)
    except (ET.ParseError, UnicodeDecodeError, ValueError) as error:
        raise InputError("daq.chain_not_xml", path=path, error=error) from None
    if root.tag == "robot":
        return urdf_chain(root, path, tip)
    if root.tag == "mujoco":
        return mjcf_chain(path, tip)
    raise InputError("daq.chain_other_root", path=path, tag=root.tag)


def draft_machine(chain: Chain, source: str) -> str:
    """Write a machine file with the chain's kinematics.

    Joints without limits get wide ones, accelerations are guessed from speeds, and every joint has a position and an
    effort channel in SI; each such line carries a TODO.

    Raises
    ------
    HilfitError
        If the table does not move as the chain does.
    """
    table = table_of(chain)
    _agree(chain, table)
    names = _names(chain)
    origin, turned = _place(table.base)
    gravity = ", ".join(_number(value) for value in table.gravity(chain.gravity))
    lines = [
        f"# Kinematics of {source}, from '{chain.base}' to '{chain.tip}'; made by 'hilfit machine import'.",
        f"# Frame 0 stands at {origin} m of '{chain.base}'{turned}.",
        *(f"# {note}" for note in chain.notes),
        "# TODO: add what drives each joint (cylinder: with bore, rod, stroke and linkage, or drive: with its ratio).",
        "schema: hilfit/machine/1",
        f"name: {_name(chain.name)}",
        "rate_hz: 50                           # TODO: the rate of your recordings",
        f"gravity: [{gravity}]",
        "joints:",
    ]
    for axis, row, name in zip(chain.axes, table.rows, names, strict=True):
        lines += _joint(axis, row, name)
    lines.append("channels:                             # TODO: what is measured: quantities, units, sources")
    for axis, name in zip(chain.axes, names, strict=True):
        position, effort = ("rad", "N m") if axis.type == "revolute" else ("m", "N")
        lines.append(f"  - {{name: {name}.position, quantity: joint_position, joint: {name}, unit: {position}}}")
        lines.append(f"  - {{name: {name}.effort, quantity: joint_effort, joint: {name}, unit: {effort}}}")
    return "\n".join(lines) + "\n"


def _joint(axis: Axis, row: np.ndarray, name: str) -> list[str]:
    a, alpha, d, theta = (_number(value) for value in row)
    low, high = axis.position or _POSITION[axis.type]
    velocity = axis.velocity or _VELOCITY
    missing = [what for what, known in (("position", axis.position), ("velocity", axis.velocity)) if known is None]
    guessed = ", ".join([*missing, "acceleration"])
    limits = f"position: [{_number(low)}, {_number(high)}], velocity: {_number(velocity)}"
    return [
        f"  - name: {name}",
        f"    type: {axis.type}",
        f"    dh: {{a: {a}, alpha: {alpha}, d: {d}, theta: {theta}}}",
        f"    limits: {{{limits}, acceleration: {_number(velocity / _SPEED_UP)}}}  # TODO: {guessed} guessed",
    ]


def _number(value: float) -> str:
    """Format a number with as many digits as matter: a micrometre in a km."""
    text = repr(float(f"{value:.10g}") + 0.0)
    return text if "e" not in text or "." in text else text.replace("e", ".0e")  # YAML reads 1e-05 as a text


def _name(text: str) -> str:
    """Make a name that machine files allow."""
    made = re.sub(r"[^A-Za-z0-9_.\-]+", "_", text).strip("_")[:60]
    return made if re.match(r"[A-Za-z_]", made) else f"_{made}"


def _names(chain: Chain) -> list[str]:
    """Return the joints' names, as in the file as far as they can be."""
    names = list[str]()
    for axis in chain.axes:
        name, number = _name(axis.name), 2
        while name in names:
            name, number = f"{_name(axis.name)}_{number}", number + 1
        names.append(name)
    return names


def _place(base: np.ndarray) -> tuple[str, str]:
    """Word the place of frame 0."""
    origin = "(" + ", ".join(_number(round(value, 9)) for value in base[:3, 3]) + ")"
    if np.allclose(base[:3, :3], np.eye(3), atol=1e-12):
        return origin, ", turned as that is"
    x, _, z = (", ".join(f"{value:.4g}" for value in column + 0.0) for column in np.round(base[:3, :3].T, 9))
    return origin, f", its x along ({x}), its z along ({z}); gravity is given in it"


def _agree(chain: Chain, table: Table) -> None:
    """Check that table and chain agree on the tip at random joint positions."""
    rng = np.random.default_rng(0)
    scale = 1.0 + max(float(np.abs(axis.point).max()) for axis in chain.axes)
    for _ in range(8):
        q = rng.uniform(-1.0, 1.0, len(chain.axes))
        off = float(np.abs(chain.pose(q) - table.pose(q)).max())
        # Axes that were made parallel may be off by their sine over the arm's length.
        if off > (_AGREES + 1e-4 * len(chain.axes)) * scale:
            raise HilfitError("daq.table_off_its_joints", chain=chain.name, off=off)
