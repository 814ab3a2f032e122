"""Parts of simulated machines: links of steel, cylinders' linkages in a machine file, channels."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import yaml

from daq.machine.machine_file import Machine, parse_machine
from sim_backends.plant.truth import CylinderTruth, Hydraulics, LinkTruth, Truth


def scattered(rng: np.random.Generator, size: float) -> Callable[..., float]:
    """Draw lengths about their values at this size of arm, ``spread`` to either side."""

    def near(value: float, spread: float = 0.05) -> float:
        return float(value * size * rng.uniform(1 - spread, 1 + spread))

    return near


def box_link(rng: np.random.Generator, mass: float, centre: tuple[float, ...], shape: tuple[float, ...]) -> LinkTruth:
    """Make a box of edge lengths ``shape`` (m), a little askew, off ``centre``, in its distal frame."""
    size = np.array(shape) * rng.uniform(0.85, 1.15, 3)
    c = np.array(centre) * rng.uniform(0.9, 1.1, 3) + rng.normal(0.0, 0.025, 3)
    tilt, _ = np.linalg.qr(np.eye(3) + rng.normal(0.0, 0.04, (3, 3)))
    principal = mass / 12 * (size @ size - size**2)
    about_origin = tilt @ np.diag(principal) @ tilt.T + mass * (c @ c * np.eye(3) - np.outer(c, c))
    i = about_origin
    moment = mass * c
    return LinkTruth(
        float(mass),
        (float(moment[0]), float(moment[1]), float(moment[2])),
        tuple(float(v) for v in (i[0, 0], i[0, 1], i[0, 2], i[1, 1], i[1, 2], i[2, 2])),  # type: ignore[arg-type]
    )


def usual_cylinder(bore: float) -> CylinderTruth:
    """Return what a cylinder of ``bore`` m usually has: seals rub with the bore's area."""
    area = float(np.pi * bore**2 / 4)
    f_c = 2.2e4 * area
    return CylinderTruth(m=0.9 + 1150.0 * area, K=1.1e5 * area, f_c=f_c, f_v=2.1e5 * area, f_s=0.7 * f_c)


def measured_machine(
    name: str,
    gravity: list[float],
    joints: Sequence[Mapping[str, Any]],
    laws: Sequence[CylinderTruth],
    links: Sequence[LinkTruth],
    hydraulics: Hydraulics | None = None,
) -> tuple[Machine, Truth]:
    """Build the machine of these joints (as in a machine file), both positions and both pressures of each."""
    channels: list[dict[str, Any]] = []
    for joint in joints:
        own = str(joint["name"])
        straight = joint.get("type") == "prismatic"
        channels += [
            {"name": f"{own}.{'extension' if straight else 'angle'}", "quantity": "joint_position", "joint": own,
             "unit": "m" if straight else "rad"},
            {"name": f"{own}.piston_position", "quantity": "piston_position", "joint": own, "unit": "m"},
            {"name": f"{own}.head_pressure", "quantity": "head_pressure", "joint": own, "unit": "Pa"},
            {"name": f"{own}.rod_pressure", "quantity": "rod_pressure", "joint": own, "unit": "Pa"},
        ]  # fmt: skip
    content = {
        "schema": "hilfit/machine/1",
        "name": name,
        "rate_hz": 50,
        "gravity": gravity,
        "joints": [dict(joint) for joint in joints],
        "channels": channels,
    }
    cylinders = {str(joint["name"]): law for joint, law in zip(joints, laws, strict=True)}
    return parse_machine(yaml.safe_dump(content)), Truth(tuple(links), cylinders, {}, hydraulics or Hydraulics())
