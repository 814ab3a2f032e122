"""Undeclared effects of the plant, by id: ``UNDECLARED``."""

from __future__ import annotations

import difflib
import math
from dataclasses import dataclass

from daq.errors import InputError
from daq.machine.linkages import ThreePin, reduced
from daq.machine.machine_file import Joint, Machine
from daq.messages import Sentence
from sim_backends.undeclared import forces, friction, mismatch, outside, outside_later, sensing
from sim_backends.undeclared.base import Block, Place, Readings, UndeclaredEffect

__all__ = [
    "MISMATCH",
    "OUTSIDE",
    "OUTSIDE_MISMATCH",
    "UNDECLARED",
    "Block",
    "EffectSpec",
    "Place",
    "Readings",
    "UndeclaredEffect",
    "check_spec",
    "obstacle",
    "parse_spec",
]

UNDECLARED: dict[str, type[UndeclaredEffect]] = {
    effect.id: effect
    for module in (friction, forces, sensing, outside, outside_later, mismatch)
    for effect in vars(module).values()
    if isinstance(effect, type) and issubclass(effect, UndeclaredEffect) and effect.__dict__.get("id")
}
#: Effects that stand in no catalogue, in the order in which they were written.
OUTSIDE = tuple(e for e, kind in UNDECLARED.items() if kind.__module__ in (outside.__name__, outside_later.__name__))
#: Shapes that flexibility and play have between two position sensors, and what bends one of those in no catalogue.
_BENDING = {e: kind for e, kind in UNDECLARED.items() if kind.__module__ == mismatch.__name__}
MISMATCH = tuple(e for e, kind in _BENDING.items() if kind.called)
OUTSIDE_MISMATCH = tuple(e for e, kind in _BENDING.items() if not kind.called)


@dataclass(frozen=True)
class EffectSpec:
    """An effect, its place and its size (in the effect's unit); ``joint`` is None for one of the whole base."""

    id: str
    joint: str | None
    size: float


def parse_spec(text: str, machine: Machine) -> EffectSpec:
    """Read ``EFFECT:JOINT:SIZE`` (or ``EFFECT:SIZE`` for an effect of the whole base)."""
    parts = text.split(":")
    if len(parts) not in (2, 3):
        raise InputError("sim_backends.undeclared_no_triple", text=text)
    try:
        size = float(parts[-1])
    except ValueError:
        raise InputError("sim_backends.undeclared_size_no_number", text=text, size=parts[-1]) from None
    return check_spec(EffectSpec(parts[0], (parts[1] or None) if len(parts) == 3 else None, size), machine)


def check_spec(spec: EffectSpec, machine: Machine) -> EffectSpec:
    """Return the same spec, if ``machine`` can have it.

    Raises
    ------
    InputError
        Unknown effect or joint, a joint that cannot have the effect, or a size that is not finite.
    """
    effect = UNDECLARED.get(spec.id)
    if effect is None:
        near = difflib.get_close_matches(spec.id, UNDECLARED, n=1)
        if near:
            raise InputError("sim_backends.undeclared_unknown_near", effect=spec.id, near=near[0])
        raise InputError("sim_backends.undeclared_unknown", effect=spec.id, names=sorted(UNDECLARED))
    if not math.isfinite(spec.size):
        raise InputError("sim_backends.undeclared_size_not_finite", effect=spec.id, unit=effect.unit)
    if effect.base_wide:
        if spec.joint is not None:
            raise InputError("sim_backends.undeclared_of_whole_base", effect=spec.id)
        return spec
    names = [joint.name for joint in machine.joints]
    if spec.joint not in names:
        raise InputError("sim_backends.undeclared_no_joint", effect=spec.id, joint=spec.joint, names=names)
    found = obstacle(effect, machine.joint(spec.joint))
    if found is not None:
        raise InputError(found)
    return spec


def obstacle(effect: type[UndeclaredEffect], joint: Joint) -> Sentence | None:
    """Explain why ``joint`` cannot have the effect; None if it can."""
    cylinder = joint.cylinder
    if effect.needs_cylinder and cylinder is None:
        return Sentence("sim_backends.undeclared_needs_cylinder", effect=effect.id, joint=joint.name)
    if effect.needs_three_pin and not (cylinder is not None and isinstance(reduced(cylinder.linkage), ThreePin)):
        return Sentence("sim_backends.undeclared_needs_three_pin", effect=effect.id, joint=joint.name)
    if effect.needs_rotation and joint.type == "prismatic":
        return Sentence("sim_backends.undeclared_needs_rotation", effect=effect.id, joint=joint.name)
    return None
