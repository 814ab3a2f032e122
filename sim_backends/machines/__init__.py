"""Simulated machines: arms drawn at random, and the committed one of the demonstration.

``folding_arm.yaml`` is a whole machine file with buses and sources; ``folding_arm.truth.yaml`` holds the plant's own
parameters, which only the plant reads.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import numpy as np

from daq.machine.machine_file import Machine, load_machine
from sim_backends.machines.heavy import excavator_front, telescopic_crane
from sim_backends.machines.parts import box_link, measured_machine, usual_cylinder
from sim_backends.plant.truth import CylinderTruth, LinkTruth, Truth, load_truth

__all__ = ["ARMS", "ArmKind", "default_machine", "excavator_front", "folding_arm", "slewing_arm", "telescopic_crane"]

ArmKind = Literal["folding", "slewing", "excavator", "telescope"]

TRAVEL = (-0.65, 0.65)  # rad
LIMITS = {"position": list(TRAVEL), "velocity": 0.6, "acceleration": 1.5}
BORES = (0.080, 0.080, 0.063, 0.050, 0.040, 0.040)  # m, standard sizes (ISO 3320)
ROD_RATIO = 0.56
STROKE = 0.30  # m


def default_machine() -> tuple[Machine, Truth]:
    """Return the demonstration's folding arm with its buses, and its truth."""
    folder = Path(__file__).parent
    return load_machine(folder / "folding_arm.yaml"), load_truth(folder / "folding_arm.truth.yaml")


def folding_arm(seed: int) -> tuple[Machine, Truth]:
    """Make six parallel horizontal axes that fold in a vertical plane, six cylinders; sizes by ``seed``."""
    rng = np.random.default_rng([seed, 1])
    lengths = np.array([0.95, 0.78, 0.58, 0.45, 0.36, 0.27]) * rng.uniform(0.88, 1.12, 6)
    rows = [{"a": float(a), "alpha": 0.0, "d": 0.0, "theta": 0.0} for a in lengths]
    masses = np.array([98.0, 74.0, 45.0, 28.0, 16.0, 8.5]) * rng.uniform(0.8, 1.2, 6)
    links = [
        box_link(rng, mass, (-0.5 * a, 0.0, 0.0), (a, 0.18, 0.14)) for mass, a in zip(masses, lengths, strict=True)
    ]
    return _machine("folding-arm", [0.0, -9.81, 0.0], rows, links, rng)


def slewing_arm(seed: int) -> tuple[Machine, Truth]:
    """Make a vertical slewing axis, a boom of two parallel axes and a wrist; sizes drawn with ``seed``."""
    rng = np.random.default_rng([seed, 2])
    half = float(np.pi / 2)
    column, boom, stick, wrist = np.array([0.16, 1.15, 0.88, 0.33]) * rng.uniform(0.9, 1.1, 4)
    rows = [
        {"a": float(column), "alpha": half, "d": float(0.6 * rng.uniform(0.9, 1.1)), "theta": 0.0},
        {"a": float(boom), "alpha": 0.0, "d": 0.0, "theta": 0.0},
        {"a": float(stick), "alpha": 0.0, "d": 0.0, "theta": 0.0},
        {"a": float(wrist), "alpha": half, "d": 0.0, "theta": 0.0},
        {"a": 0.0, "alpha": half, "d": 0.0, "theta": half},
        {"a": 0.0, "alpha": 0.0, "d": float(0.3 * rng.uniform(0.9, 1.1)), "theta": 0.0},
    ]
    masses = np.array([120.0, 86.0, 46.0, 20.0, 14.0, 10.0]) * rng.uniform(0.8, 1.2, 6)
    centres = [(-0.5 * column, -0.25, 0.0), (-0.52 * boom, 0.0, 0.0), (-0.55 * stick, 0.0, 0.0),
               (-0.5 * wrist, 0.0, 0.0), (0.0, 0.0, 0.08), (0.0, 0.0, -0.12)]  # fmt: skip
    shapes = [(0.35, 0.6, 0.35), (boom, 0.2, 0.16), (stick, 0.18, 0.14), (wrist, 0.14, 0.14),
              (0.15, 0.15, 0.2), (0.14, 0.14, 0.28)]  # fmt: skip
    links = [box_link(rng, m, c, s) for m, c, s in zip(masses, centres, shapes, strict=True)]
    return _machine("slewing-arm", [0.0, 0.0, -9.81], rows, links, rng)


def _machine(
    name: str, gravity: list[float], rows: list[dict[str, float]], links: list[LinkTruth], rng: np.random.Generator
) -> tuple[Machine, Truth]:
    joints: list[dict[str, Any]] = []
    laws: list[CylinderTruth] = []
    for k, row in enumerate(rows):
        cylinder, law = _cylinder(BORES[k], 0.35 * (0.9 if k else 1.0), rng)
        joints.append({"name": f"joint{k + 1}", "dh": row, "limits": LIMITS, "cylinder": cylinder})
        laws.append(law)
    return measured_machine(name, gravity, joints, laws, links)


def _cylinder(bore: float, spread: float, rng: np.random.Generator) -> tuple[dict[str, Any], CylinderTruth]:
    """Make a cylinder of ``bore`` m with a linkage that its stroke can serve, and its friction."""
    usual = usual_cylinder(bore)

    def around(value: float) -> float:
        return float(value * rng.uniform(1 - spread, 1 + spread))

    b = float((0.04 + 1.45 * bore) * rng.uniform(0.94, 1.06))
    a = float((0.12 + 4.2 * bore) * rng.uniform(0.94, 1.06))
    offset = float(rng.uniform(1.42, 1.75))
    q = np.linspace(*TRAVEL, 101)
    lengths = np.sqrt(a**2 + b**2 - 2 * a * b * np.cos(q + offset))
    retracted = float(lengths.min() - rng.uniform(0.010, 0.020))
    f_c = around(usual.f_c)
    declared = {
        "bore": bore,
        "rod": round(bore * ROD_RATIO, 4),
        "stroke": STROKE,
        "damping": around(4.5e4 * np.pi * bore**2 / 4),
        "linkage": {"type": "three_pin", "a": a, "b": b, "offset": offset, "retracted": retracted},
    }
    law = CylinderTruth(
        m=around(usual.m), K=around(usual.K), f_c=f_c, f_v=around(usual.f_v), f_s=float(f_c * rng.uniform(0.45, 0.95))
    )
    return declared, law


#: Arms drawn at random, by kind; each is made from a seed.
ARMS: dict[ArmKind, Callable[[int], tuple[Machine, Truth]]] = {
    "folding": folding_arm,
    "slewing": slewing_arm,
    "excavator": excavator_front,
    "telescope": telescopic_crane,
}
