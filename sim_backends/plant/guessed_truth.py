"""Plant parameters to begin with, for a machine whose weights nobody has written down yet.

They are what an arm of that geometry with cylinders of that size usually has. They let the simulator stand in for a
machine before there is one; they say nothing about it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import yaml

from daq.machine.joints import Joint
from daq.machine.machine_file import Machine
from sim_backends.machines.parts import box_link, usual_cylinder
from sim_backends.plant.truth import DriveTruth, Hydraulics, LinkTruth, Truth

_PER_LENGTH = 1250.0  # kg/m of link per m of bore: steel booms of 35 to 100 kg/m with bores of 30 to 80 mm
_WITHOUT_BORE = 25.0  # kg/m of a link that no cylinder moves
_WIDTH = 0.15  # m, edge of a link's section
_SHORT = 0.2  # m: a link is at least that long (a slewing column, a wrist)

_HEAD = """\
# What the simulated machine really is: a guess from geometry and sizes of cylinders, to be changed at will. Only
# 'hilfit simulate' reads it; no fit does.
#   cylinders: m moving mass [kg], K stiffness [N/m]; friction: f_c Coulomb [N], f_v viscous [N s/m],
#     f_s cube root [N (s/m)^(1/3)]
#   drives (joints without a cylinder): f_c [N m or N], f_v [N m s/rad or N s/m], inertia [kg m^2 or kg]
#   links, base to tip, about the origin of the link's frame (standard convention: at its far end): mass [kg],
#     mass times centre of mass x y z [kg m], inertia tensor XX XY XZ YY YZ ZZ [kg m^2] with XY = -sum m x y
#   hydraulics: supply, tank, preload, head_floor [Pa], loss [Pa s^2/m^2], droop [Pa s/m^3], oil at power-on (ambient)
#     and its final rise (heating) [K], time constant of that rise (warm_up) [s]
"""


def guessed_truth(machine: Machine, seed: int = 0) -> Truth:
    """Guess a plausible plant for this machine file: steel boxes between joints, usual cylinders' friction.

    Parameters
    ----------
    machine : geometry and cylinders are used
    seed : how links are askew (no real one is symmetric)
    """
    rng = np.random.default_rng([seed, 31])
    links = tuple(_link(rng, machine, number) for number in range(len(machine.joints)))
    cylinders = {j.name: usual_cylinder(j.cylinder.bore) for j in machine.joints if j.cylinder is not None}
    drives = {
        joint.name: _drive(joint, link)
        for joint, link in zip(machine.joints, links, strict=True)
        if joint.cylinder is None
    }
    known, hydraulics = machine.hydraulics, Hydraulics()
    if known is not None:
        hydraulics = replace(hydraulics, supply=known.supply_pressure or hydraulics.supply, tank=known.tank_pressure)
    return Truth(links, cylinders, drives, hydraulics)


def guessed_truth_yaml(machine: Machine, seed: int = 0) -> str:
    """Write the same as a file for ``hilfit simulate --truth``, with a comment on each number."""
    tree = guessed_truth(machine, seed).to_dict()
    parts = {key: tree[key] for key in ("cylinders", "drives", "hydraulics")}
    rounded = {
        key: {name: _rounded(value) for name, value in own.items()} if isinstance(own, dict) else own
        for key, own in parts.items()
    }
    links = "\n".join("- [" + ", ".join(str(_rounded(value)) for value in link) + "]" for link in tree["links"])
    return f"{_HEAD}{yaml.safe_dump(rounded, sort_keys=False, default_flow_style=None, width=110)}links:\n{links}\n"


def _link(rng: np.random.Generator, machine: Machine, number: int) -> LinkTruth:
    """Make a box from the frame's origin to the joint at its other end."""
    joint = machine.joints[number]
    away = _other_end(machine, number)
    length = max(float(np.linalg.norm(away)), _SHORT)
    shape = np.maximum(np.abs(away), _WIDTH)
    per_length = _WITHOUT_BORE if joint.cylinder is None else _PER_LENGTH * joint.cylinder.bore
    return box_link(rng, per_length * length, tuple(away / 2), tuple(shape))


def _other_end(machine: Machine, number: int) -> npt.NDArray[np.float64]:
    """Locate the link's other joint in the link's own frame, m; a sliding joint is in mid-range."""
    joints = machine.joints
    if machine.convention == "modified":  # the frame is at the link's own joint, the next row leads to its far end
        if number + 1 == len(joints):
            return np.array([_SHORT, 0.0, 0.0])
        row, slide = joints[number + 1].dh, _mid(joints[number + 1])
        return np.array([row.a, -np.sin(row.alpha) * (row.d + slide), np.cos(row.alpha) * (row.d + slide)])
    row, slide = joints[number].dh, _mid(joints[number])
    return -np.array([row.a, np.sin(row.alpha) * (row.d + slide), np.cos(row.alpha) * (row.d + slide)])


def _mid(joint: Joint) -> float:
    return sum(joint.limits.position) / 2 if joint.type == "prismatic" else 0.0


def _drive(joint: Joint, link: LinkTruth) -> DriveTruth:
    """Guess a motor and its gear: friction a twentieth of the link's weight, inertia a tenth of its."""
    reach = float(np.linalg.norm(link.moment)) / link.mass if joint.type == "revolute" else 1.0
    weight = 9.81 * link.mass * max(reach, 0.1)
    inertia = link.mass if joint.type == "prismatic" else max(link.inertia[5], 0.01)
    return DriveTruth(f_c=0.05 * weight, f_v=0.05 * weight / joint.limits.velocity, inertia=0.1 * inertia)


def _rounded(value: object) -> object:
    """Round numbers to five digits, in mappings too."""
    if isinstance(value, dict):
        return {key: _rounded(own) for key, own in value.items()}
    return float(f"{value:.5g}") if isinstance(value, float) else value
