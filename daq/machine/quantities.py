"""Quantities of channels, and what each belongs to."""

from __future__ import annotations

from typing import Literal

Quantity = Literal[
    "joint_position", "joint_velocity", "piston_position", "head_pressure", "rod_pressure", "cylinder_force",
    "joint_effort", "motor_position", "motor_velocity", "motor_effort", "external_force", "oil_temperature",
    "supply_pressure", "tank_pressure", "base_roll", "base_pitch", "command", "spool_position", "head_port_pressure",
    "rod_port_pressure",
]  # fmt: skip
#: Quantities of a motor, on its own side of the gear.
MOTOR_QUANTITIES = frozenset({"motor_position", "motor_velocity", "motor_effort"})
#: Quantities of a joint whatever drives it.
_ANY_JOINT = frozenset({"joint_position", "joint_velocity", "joint_effort"})
#: Quantities of a valve in its amplifier's unit: as they are sent and answered.
SENT_QUANTITIES = frozenset({"command", "spool_position"})
#: Quantities of a cylinder's valve; pressures of its ports are measured at the valve, not in the chambers.
VALVE_QUANTITIES = SENT_QUANTITIES | {"head_port_pressure", "rod_port_pressure"}
#: Quantities of a joint's cylinder.
CYLINDER_QUANTITIES = (
    frozenset({"piston_position", "head_pressure", "rod_pressure", "cylinder_force", "external_force"})
    | VALVE_QUANTITIES
)
#: Quantities that belong to a joint; all others belong to the machine.
JOINT_QUANTITIES = _ANY_JOINT | CYLINDER_QUANTITIES | MOTOR_QUANTITIES
