"""Simulated backends: a machine that stands in for hardware, offline and on real bus protocols.

Names are loaded when they are first used: the processes of the simulated buses share this package and must not load
the physics engine, which is also an extra (``sim``) of the distribution.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sim_backends.machines import default_machine, excavator_front, folding_arm, slewing_arm, telescopic_crane
    from sim_backends.plant.cases import Case, make_case, simulate_case
    from sim_backends.plant.motion import Motion, random_motion, read_motion, write_motion
    from sim_backends.plant.plant import Plant, record
    from sim_backends.plant.truth import SensorQuality, Truth, load_truth
    from sim_backends.simulated_machine import SimulatedMachine, SimulationError
    from sim_backends.undeclared import UNDECLARED, EffectSpec

__all__ = [
    "UNDECLARED",
    "Case",
    "EffectSpec",
    "Motion",
    "Plant",
    "SensorQuality",
    "SimulatedMachine",
    "SimulationError",
    "Truth",
    "default_machine",
    "excavator_front",
    "folding_arm",
    "load_truth",
    "make_case",
    "random_motion",
    "read_motion",
    "record",
    "simulate_case",
    "slewing_arm",
    "telescopic_crane",
    "write_motion",
]

_HOME = {
    "plant.cases": ("Case", "make_case", "simulate_case"),
    "machines": ("default_machine", "excavator_front", "folding_arm", "slewing_arm", "telescopic_crane"),
    "plant.motion": ("Motion", "random_motion", "read_motion", "write_motion"),
    "plant.plant": ("Plant", "record"),
    "simulated_machine": ("SimulatedMachine", "SimulationError"),
    "plant.truth": ("SensorQuality", "Truth", "load_truth"),
    "undeclared": ("UNDECLARED", "EffectSpec"),
}


def __getattr__(name: str) -> Any:
    for module, names in _HOME.items():
        if name in names:
            return getattr(importlib.import_module(f"{__name__}.{module}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
