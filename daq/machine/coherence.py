"""Coherence of the parts of a machine file: names, channels and joints, motors and what they turn."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from daq.errors import BadValueError
from daq.machine.buses import CanopenBus, CanSource, Word, object_of
from daq.machine.joints import Joint, unique
from daq.machine.machine_file_errors import Place, did_you_mean
from daq.machine.quantities import CYLINDER_QUANTITIES, JOINT_QUANTITIES, MOTOR_QUANTITIES, SENT_QUANTITIES
from daq.messages import Sentence, named

if TYPE_CHECKING:
    from daq.machine.machine_file import Channel, Machine
    from daq.units import Conversion


class IncoherenceError(ValueError):
    """Several problems of one part of a file; its text is the first of them.

    Attributes
    ----------
    located : all of them, each its place and one line
    """

    def __init__(self, located: list[tuple[Place, str]]) -> None:
        super().__init__(located[0][1])
        self.located = located


def incoherences(machine: Machine) -> list[tuple[Place, str]]:
    """List everything that does not belong together in a machine file, place and line; later checks need earlier ones.

    A check that does not say ``at`` which place it stopped is about the one that stands in front of it here.
    """
    joints, channels = machine.joints, machine.channels
    problems = _of(
        (("joints",), unique, [joint.name for joint in joints], "joint", "joints"),
        (("channels",), unique, [channel.name for channel in channels], "channel", "channels"),
        (("buses",), unique, [bus.name for bus in machine.buses], "bus", "buses"),
    )
    if problems:
        return problems
    problems = _of(
        (("buses",), _one_sync, machine), (("delays",), _delayed_buses, machine), (("supply",), _one_supply, machine)
    )
    at_channels = [(("channels", index), channel) for index, channel in enumerate(channels)]
    problems += _of(*((at, _sets_nothing, machine, own) for at, own in at_channels if own.quantity == "command"))
    problems += _of(*((at, _channel, machine, at[1], channel) for at, channel in at_channels))
    at_joints = [(("joints", index), joint) for index, joint in enumerate(joints)]
    problems += _of(*((at, _couplings, machine, joint) for at, joint in at_joints))
    if problems:  # a channel that is nobody's makes its joint look unmeasured
        return problems
    problems = _of(*((at, _measured, machine, joint.name) for at, joint in at_joints))
    whole = ("joints",)
    return problems or _of((whole, _velocities_are_measured, machine), (whole, _motors_determine, machine))


def _one_sync(machine: Machine) -> None:
    led = [bus.name for bus in machine.buses if isinstance(bus, CanopenBus) and bus.sync == "external"]
    if len(led) > 1:
        raise BadValueError("daq.buses_both_say_sync", led=led)


def _delayed_buses(machine: Machine) -> None:
    names = [bus.name for bus in machine.buses]
    known: set[frozenset[str]] = set()
    for number, delay in enumerate(machine.delays):
        for name in (delay.bus, delay.behind):
            _known(name, names, "bus", f"delays[{number}]")
        if frozenset((delay.bus, delay.behind)) in known:
            raise BadValueError(
                "daq.delays_told_twice", at=("delays", number), number=number, bus=delay.bus, behind=delay.behind
            )
        known.add(frozenset((delay.bus, delay.behind)))


def _one_supply(machine: Machine) -> None:
    supply, hydraulics = machine.supply, machine.hydraulics
    if supply is None or hydraulics is None:
        return
    for key, one, other, name in (
        ("pressure", supply.pressure, hydraulics.supply_pressure, "supply_pressure"),
        ("flow_limit", supply.flow_limit, hydraulics.pump_flow, "pump_flow"),
    ):
        if one is not None and other is not None and one != other:
            at = ("supply", key)
            raise BadValueError("daq.supply_here_hydraulics", at=at, key=key, one=one, other=other, name=name)


def _of(*checks: tuple[Any, ...]) -> list[tuple[Place, str]]:
    """Collect places and texts of the checks that raise a ValueError; each stands behind its place."""
    located = []
    for place, check, *arguments in checks:
        try:
            check(*arguments)
        except ValueError as error:
            located.append((getattr(error, "at", ()) or place, str(error)))
    return located


def _known(name: str, names: Iterable[str], what: str, place: str) -> None:
    options = list(names)
    if name not in options:
        hint = did_you_mean(name, options) or Sentence("daq.there_are", options=options)
        raise BadValueError("daq.place_names_none", place=place, what=what, name=name, hint=hint)


def _channel(machine: Machine, index: int, channel: Channel) -> None:
    place = f"channels[{index}] ({channel.name})"
    if channel.quantity in JOINT_QUANTITIES:
        if channel.joint is None:
            raise BadValueError("daq.belongs_joint", place=place, quantity=channel.quantity)
        _known(channel.joint, (joint.name for joint in machine.joints), "joint", place)
        _has(place, channel.quantity, machine.joint(channel.joint))
    elif channel.joint is not None:
        raise BadValueError("daq.belongs_machine", place=place, quantity=channel.quantity)
    try:
        machine.conversion(channel)
    except ValueError as error:
        raise ValueError(named(place, str(error))) from None
    if channel.quantity == "command" and channel.joint is not None:
        _in_the_valves_unit(place, channel.unit, machine.joint(channel.joint))
    if channel.source is not None and machine.buses:
        buses = {bus.name: bus for bus in machine.buses}
        _known(channel.source.bus, buses, "bus", place)
        bus = buses[channel.source.bus]
        if not isinstance(channel.source, bus.source):
            raise BadValueError("daq.source_not_fit_bus", place=place, bus=bus.name, type=bus.type)
    if channel.quantity == "joint_position" and channel.joint is not None and isinstance(channel.source, Word):
        _turns_once(place, machine.conversion(channel), channel.source, machine.joint(channel.joint))


def _turns_once(place: str, to_si: Conversion, source: Word, joint: Joint) -> None:
    """Check that an encoder does not begin anew within its joint's limits."""
    if source.modulo is None or not hasattr(joint, "limits"):  # the joint itself is wrong, and told elsewhere
        return
    half = 0.5 * source.modulo * source.scale / 10.0**source.decimals
    low, high = sorted(float(to_si.to_si(source.offset + end)) for end in (-half, half))
    limits = joint.limits.position
    if limits[0] < low or limits[1] > high:
        raise BadValueError(
            "daq.encoder_begins_anew_moves",
            place=place,
            low=low,
            high=high,
            joint=joint.name,
            limit=limits[0],
            limit_2=limits[1],
        )


def _has(place: str, quantity: str, joint: Joint) -> None:
    """Check that a channel's joint has what the channel measures."""
    if quantity in MOTOR_QUANTITIES and joint.drive is None:
        raise BadValueError("daq.no_drive_no", place=place, joint=joint.name, quantity=quantity)
    if quantity == "motor_effort" and joint.drive is not None and joint.drive.effort == "link_side":
        raise BadValueError("daq.drive_says_effort_link_side", place=place, joint=joint.name)
    if quantity in CYLINDER_QUANTITIES:
        if joint.cylinder is None:
            raise BadValueError("daq.no_cylinder_no", place=place, joint=joint.name, quantity=quantity)
        if joint.cylinder.vented is not None and quantity == f"{joint.cylinder.vented}_pressure":
            raise BadValueError("daq.chamber_vented", place=place, joint=joint.name)
        if quantity in SENT_QUANTITIES and joint.cylinder.valve is None:
            raise BadValueError("daq.no_valve_no", place=place, joint=joint.name, quantity=quantity)


def _sets_nothing(machine: Machine, channel: Channel) -> None:
    """Check that a command is read and never written: no node setting is its object."""
    source = channel.source
    if not isinstance(source, CanSource):
        return
    for number, bus in enumerate(machine.buses):
        for k, node in enumerate(bus.nodes if isinstance(bus, CanopenBus) and bus.name == source.bus else ()):
            for key in node.settings if node.node == source.node else ():
                if object_of(key.partition(" ")[0]) == (source.object, source.subindex):
                    at, name = ("buses", number, "nodes", k, "settings", key), channel.name
                    raise BadValueError(
                        "daq.buses_node_settings_would", at=at, bus=bus.name, node=node.node, channel=name
                    )


def _in_the_valves_unit(place: str, unit: str, joint: Joint) -> None:
    """Check that a command is in the unit of its valve's range and neutral."""
    valve = None if joint.cylinder is None else joint.cylinder.valve
    if valve is not None and hasattr(valve, "unit") and valve.unit != unit:
        raise BadValueError("daq.valve_units_differ", place=place, unit=unit, joint=joint.name, unit_2=valve.unit)


def _couplings(machine: Machine, joint: Joint) -> None:
    for coupling in () if joint.drive is None else joint.drive.coupled:
        if coupling.joint == joint.name:
            raise BadValueError("daq.joints_drive_coupled_names", joint=joint.name)
        names = (other.name for other in machine.joints)
        _known(coupling.joint, names, "joint", f"joints.{joint.name}: drive.coupled")


def _measured(machine: Machine, name: str) -> None:
    """Check that a joint has a position and an effort."""
    present = [c.quantity for c in machine.channels if c.joint == name]
    for quantity in sorted(set(present)):
        if present.count(quantity) > 1:
            raise BadValueError("daq.joints_more_channel", name=name, quantity=quantity)
    drive, cylinder = machine.joint(name).drive, machine.joint(name).cylinder
    positions = {"joint_position", "piston_position", "motor_position"}
    if not positions & set(present):
        kinds = "joint_position or " + ("motor_position" if drive else "piston_position")
        raise BadValueError("daq.joints_no_position", name=name, kinds=kinds)
    pressures = {"head_pressure", "rod_pressure"} & set(present)
    if cylinder is not None and cylinder.vented is not None and pressures:
        return
    if "external_force" in present and len(pressures) < 2:
        raise BadValueError("daq.joints_external_force_needs_head_pressure", name=name)
    if drive is not None and "joint_effort" not in present:
        _driven(machine, name, link_side=drive.effort == "link_side")
        return
    if len(pressures) == 1 and not {"cylinder_force", "joint_effort"} & set(present):
        missing = ({"head_pressure", "rod_pressure"} - pressures).pop()
        raise BadValueError("daq.joints_no_effort_pressure", name=name, missing=missing)
    if "command" in present:  # of its valve the curve and the delay can be told without any effort
        return
    if not pressures and not {"cylinder_force", "joint_effort"} & set(present):
        raise BadValueError("daq.joints_no_effort", name=name)


def _driven(machine: Machine, name: str, *, link_side: bool) -> None:
    """Check that every motor that acts on the joint is measured."""
    if link_side:
        raise BadValueError("daq.joints_no_effort_drive", name=name)
    column = [joint.name for joint in machine.joints].index(name)
    for row in np.flatnonzero(machine.ratios[:, column]):
        motor = machine.joints[row].name
        if machine.channel("motor_effort", motor) is None:
            raise BadValueError("daq.joints_no_effort_add", name=name, motor=motor)


def _velocities_are_measured(machine: Machine) -> None:
    """Check that what else a motor turns with is known where it gives its joint's velocity."""
    measured = {n for n, joint in enumerate(machine.joints) if machine.channel("joint_velocity", joint.name)}
    measured |= set(machine.turning_at_motors)
    for number in machine.turning_at_motors:
        for other in np.flatnonzero(machine.ratios[number]):
            if other not in measured:
                own, missing = machine.joints[number].name, machine.joints[other].name
                raise BadValueError(
                    "daq.joints_motor_velocity_holds_speed", at=("joints", number), own=own, missing=missing
                )


def _motors_determine(machine: Machine) -> None:
    """Check that ratios can be solved for joints that only motors measure, each row by its own ratio."""
    for unknown in (machine.at_motors, machine.turning_at_motors):
        R = machine.ratios[np.ix_(unknown, unknown)]
        if not np.all(np.linalg.svd(R / np.diag(R)[:, None], compute_uv=False) > 1e-9):
            own = next(k for k, joint in enumerate(machine.joints) if joint.drive is not None and joint.drive.coupled)
            raise BadValueError("daq.joints_drive_all_motors", at=("joints", own), name=machine.joints[own].name)
