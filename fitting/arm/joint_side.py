"""Recordings as the fitting wants them: motion and efforts at the joints, and a pressure for every chamber.

A machine file may have motors that are measured instead of joints. Motors are at ``q_motor = R q``, and by virtual
work (``tau dq = tau_motor dq_motor``) their efforts act on the joints as ``tau = R' tau_motor``. ``R`` is the
diagonal of gear ratios, with a further entry in a row where a motor turns with another joint too (a coupled wrist:
Khalil and Dombre, *Modeling, Identification and Control of Robots*, 2002, section 9.4).
A chamber that is open to the air has the gauge pressure 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from daq.machine.machine_file import Channel, Joint, Machine, Quantity
from daq.machine.quantities import MOTOR_QUANTITIES
from daq.recordings.recording import Recording
from fitting.arm.linkage import joint_position
from fitting.arrays import FloatArray


def at_joints(machine: Machine, recordings: Sequence[Recording]) -> tuple[Machine, tuple[Recording, ...]]:
    """Replace motor channels by joint channels in a machine and its recordings.

    Parameters
    ----------
    machine : as the machine file has it
    recordings : of that machine; what a joint channel measures is kept, what only motors show is computed. A row in
        which one of the motors is missing is missing at every joint that the motor turns with

    Returns
    -------
    tuple
        Both unchanged where the file has neither motor channels nor vented chambers.
    """
    vented = [j for j in machine.joints if j.cylinder is not None and j.cylinder.vented is not None]
    if not vented and not any(channel.quantity in MOTOR_QUANTITIES for channel in machine.channels):
        return machine, tuple(recordings)
    derived = [*_derived(machine), *_chambers(machine)]
    kept = [channel for channel in machine.channels if channel.quantity not in MOTOR_QUANTITIES]
    joints = tuple(
        j.model_copy(update={"cylinder": j.cylinder.model_copy(update={"vented": None})})
        if j.cylinder is not None and j in vented
        else j
        for j in machine.joints
    )
    changed = machine.model_copy(update={"joints": joints, "channels": (*kept, *derived)})
    return changed, tuple(_converted(machine, recording, kept, derived) for recording in recordings)


def _derived(machine: Machine) -> list[Channel]:
    """Make the joint channels that motors determine."""
    joints = machine.joints
    unmeasured = [j for j in joints if machine.channel("joint_effort", j.name) is None]
    kinds: tuple[tuple[str, Quantity, list[Joint]], ...] = (
        ("from_motors", "joint_position", [joints[n] for n in machine.at_motors]),
        ("velocity_from_motors", "joint_velocity", [joints[n] for n in machine.turning_at_motors]),
        (
            "effort_of_motors",
            "joint_effort",
            [j for j in unmeasured if j.drive is not None],
        ),
    )
    return [
        Channel(name=f"{joint.name}.{name}", quantity=quantity, joint=joint.name, unit=_unit(joint, quantity))
        for name, quantity, of in kinds
        for joint in of
    ]


def _unit(joint: Joint, quantity: str) -> str:
    way = "rad" if joint.type == "revolute" else "m"
    return {"joint_position": way, "joint_velocity": f"{way}/s"}.get(quantity, joint.effort_unit)


def _chambers(machine: Machine) -> list[Channel]:
    result = []
    for joint in machine.joints:
        if joint.cylinder is not None and joint.cylinder.vented is not None:
            quantity: Quantity = "head_pressure" if joint.cylinder.vented == "head" else "rod_pressure"
            result.append(Channel(name=f"{joint.name}.vented", quantity=quantity, joint=joint.name, unit="Pa"))
    return result


def _converted(
    machine: Machine, recording: Recording, kept: Sequence[Channel], derived: Sequence[Channel]
) -> Recording:
    values = {channel.name: recording.values[channel.name] for channel in kept}
    q = _joint_positions(machine, recording)
    turning = _measured(machine, recording, "joint_velocity")
    speeds = _solved(machine, recording, turning, machine.turning_at_motors, "motor_velocity")
    efforts = _measured(machine, recording, "motor_effort")
    places = {joint.name: number for number, joint in enumerate(machine.joints)}
    for channel in derived:
        number = places[str(channel.joint)]
        if channel.quantity == "joint_position":
            made = q[:, number]
        elif channel.quantity == "joint_velocity":
            made = speeds[:, number]
        elif channel.quantity == "joint_effort":
            acting = np.flatnonzero(machine.ratios[:, number])
            made = efforts[:, acting] @ machine.ratios[acting, number]
        else:
            made = np.zeros(len(recording))
        made.flags.writeable = False
        values[channel.name] = made
    return replace(recording, values=values)


def _measured(machine: Machine, recording: Recording, quantity: str) -> FloatArray:
    """Return all joints' channels of a quantity, (N, n), NaN where there is none."""
    values = np.full((len(recording), len(machine.joints)), np.nan)
    for number, joint in enumerate(machine.joints):
        channel = machine.channel(quantity, joint.name)
        if channel is not None:
            values[:, number] = recording.values[channel.name]
    return values


def _joint_positions(machine: Machine, recording: Recording) -> FloatArray:
    """Compute all joints' positions (N, n), NaN where no motor and no sensor has one."""
    q = _measured(machine, recording, "joint_position")
    for number, joint in enumerate(machine.joints):
        piston = machine.channel("piston_position", joint.name)
        if joint.cylinder is None or piston is None or machine.channel("joint_position", joint.name) is not None:
            continue
        if any(machine.ratios[list(machine.at_motors), number]):
            q[:, number] = joint_position(joint, recording.values[piston.name])
    return _solved(machine, recording, q, machine.at_motors, "motor_position")


def _solved(
    machine: Machine, recording: Recording, known: FloatArray, unknown: Sequence[int], quantity: str
) -> FloatArray:
    """Solve for joint values (N, n), columns ``unknown``, from their motors' channels of ``quantity``."""
    places = list(unknown)
    if places:
        R = machine.ratios[places]
        motors = _measured(machine, recording, quantity)[:, places]
        others = [n for n in range(len(machine.joints)) if n not in places and R[:, n].any()]
        known[:, places] = np.linalg.solve(R[:, places], (motors - known[:, others] @ R[:, others].T).T).T
    return known
