"""What a channel can measure, and to what each quantity belongs."""

from __future__ import annotations

from typing import Literal

Quantity = Literal[
    "joint_position", "joint_velocity", "piston_position", "head_pressure", "rod_pressure", "cylinder_force",
    "joint_effort", "motor_position", "motor_velocity", "motor_effort", "external_force", "oil_temperature",
    "supply_pressure", "tank_pressure", "base_roll", "base_pitch",
]  # fmt: skip
#: Quantities of a motor, on its own side of the gear.
MOTOR_QUANTITIES = frozenset({"motor_position", "motor_velocity", "motor_effort"})
#: Quantities of a joint whatever drives it.
_ANY_JOINT = frozenset({"joint_position", "joint_velocity", "joint_effort"})
#: Quantities of a joint's cylinder.
CYLINDER_QUANTITIES = frozenset(
    {"piston_position", "head_pressure", "rod_pressure", "cylinder_force", "external_force"}
)
#: Quantities that belong to a joint; all others belong to the machine.
JOINT_QUANTITIES = _ANY_JOINT | CYLINDER_QUANTITIES | MOTOR_QUANTITIES
