"""Undeclared effects of the plant, by id: ``UNDECLARED``."""

from __future__ import annotations

import difflib
import math
from dataclasses import dataclass

from daq.errors import InputError
from daq.machine.linkages import ThreePin, reduced
from daq.machine.machine_file import Joint, Machine
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
        raise InputError(f"--undeclared {text}: write EFFECT:JOINT:SIZE, as in position_dependent_friction:joint2:75")
    try:
        size = float(parts[-1])
    except ValueError:
        raise InputError(f"--undeclared {text}: size '{parts[-1]}' is no number") from None
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
        hint = f"; did you mean '{near[0]}'?" if near else f"; one of {', '.join(sorted(UNDECLARED))}"
        raise InputError(f"undeclared effect '{spec.id}' is not known{hint}")
    if not math.isfinite(spec.size):
        raise InputError(f"undeclared {spec.id}: size must be a finite number of {effect.unit}")
    if effect.base_wide:
        if spec.joint is not None:
            raise InputError(f"undeclared {spec.id}: belongs to the whole base; leave the joint out: {spec.id}:SIZE")
        return spec
    names = [joint.name for joint in machine.joints]
    if spec.joint not in names:
        raise InputError(f"undeclared {spec.id}: there is no joint '{spec.joint}'; one of {', '.join(names)}")
    found = obstacle(effect, machine.joint(spec.joint))
    if found is not None:
        raise InputError(f"undeclared {spec.id}: {spec.joint} {found}")
    return spec


def obstacle(effect: type[UndeclaredEffect], joint: Joint) -> str | None:
    """Explain why ``joint`` cannot have the effect, as the end of a sentence; None if it can."""
    cylinder = joint.cylinder
    if effect.needs_cylinder and cylinder is None:
        return "has no cylinder; choose a joint that has one"
    if effect.needs_three_pin and not (cylinder is not None and isinstance(reduced(cylinder.linkage), ThreePin)):
        return "has no three-pin linkage; choose a joint that has one"
    if effect.needs_rotation and joint.type == "prismatic":
        return "slides; choose a joint that turns"
    return None
