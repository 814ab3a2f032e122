"""Whether the parts of a machine file belong together: names, channels and joints, motors and what they turn."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from daq.machine.buses import CanopenBus, CanSource, Word, object_of
from daq.machine.joints import Joint, unique
from daq.machine.machine_file_errors import did_you_mean
from daq.machine.quantities import CYLINDER_QUANTITIES, JOINT_QUANTITIES, MOTOR_QUANTITIES, SENT_QUANTITIES

if TYPE_CHECKING:
    from daq.machine.machine_file import Channel, Machine
    from daq.units import Conversion


class IncoherenceError(ValueError):
    """Several problems of one part of a file; its text is the first of them.

    Attributes
    ----------
    texts : all of them, each one line that begins with its place
    """

    def __init__(self, texts: list[str]) -> None:
        super().__init__(texts[0])
        self.texts = tuple(texts)


def incoherences(machine: Machine) -> list[str]:
    """List everything that does not belong together in a machine file, a line each; later checks need earlier ones."""
    joints, channels = machine.joints, machine.channels
    problems = _of(
        (unique, [joint.name for joint in joints], "joint"),
        (unique, [channel.name for channel in channels], "channel"),
        (unique, [bus.name for bus in machine.buses], "bus"),
    )
    if problems:
        return problems
    problems = _of((_one_sync, machine), (_delayed_buses, machine), (_one_supply, machine))
    problems += _of(*((_sets_nothing, machine, channel) for channel in channels if channel.quantity == "command"))
    problems += _of(*((_channel, machine, index, channel) for index, channel in enumerate(channels)))
    problems += _of(*((_couplings, machine, joint) for joint in joints))
    if problems:  # a channel that is nobody's makes its joint look unmeasured
        return problems
    problems = _of(*((_measured, machine, joint.name) for joint in joints))
    return problems or _of((_velocities_are_measured, machine), (_motors_determine, machine))


def _one_sync(machine: Machine) -> None:
    led = [bus.name for bus in machine.buses if isinstance(bus, CanopenBus) and bus.sync == "external"]
    if len(led) > 1:
        raise ValueError(f"buses: {' and '.join(led)} both say sync: external; one of them leads the cycle")


def _delayed_buses(machine: Machine) -> None:
    names = [bus.name for bus in machine.buses]
    known: set[frozenset[str]] = set()
    for number, delay in enumerate(machine.delays):
        for name in (delay.bus, delay.behind):
            _known(name, names, "bus", f"delays[{number}]")
        if frozenset((delay.bus, delay.behind)) in known:
            raise ValueError(f"delays[{number}]: '{delay.bus}' and '{delay.behind}' are told twice; keep one")
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
            raise ValueError(f"supply: {key} is {one:g} here and {other:g} as hydraulics.{name}; correct one")


def _of(*checks: tuple[Callable[..., None] | Any, ...]) -> list[str]:
    """Collect texts of the checks that raise a ValueError."""
    texts = []
    for check, *arguments in checks:
        try:
            check(*arguments)
        except ValueError as error:
            texts.append(str(error))
    return texts


def _known(name: str, names: Iterable[str], what: str, place: str) -> None:
    options = list(names)
    if name not in options:
        hint = did_you_mean(name, options) or f"; there are {', '.join(options)}"
        raise ValueError(f"{place}: there is no {what} '{name}'{hint}")


def _channel(machine: Machine, index: int, channel: Channel) -> None:
    place = f"channels[{index}] ({channel.name})"
    if channel.quantity in JOINT_QUANTITIES:
        if channel.joint is None:
            raise ValueError(f"{place}: a {channel.quantity} belongs to a joint; add joint:")
        _known(channel.joint, (joint.name for joint in machine.joints), "joint", place)
        _has(place, channel.quantity, machine.joint(channel.joint))
    elif channel.joint is not None:
        raise ValueError(f"{place}: a {channel.quantity} belongs to the machine; remove joint:")
    try:
        machine.conversion(channel)
    except ValueError as error:
        raise ValueError(f"{place}: {error}") from None
    if channel.quantity == "command" and channel.joint is not None:
        _in_the_valves_unit(place, channel.unit, machine.joint(channel.joint))
    if channel.source is not None and machine.buses:
        buses = {bus.name: bus for bus in machine.buses}
        _known(channel.source.bus, buses, "bus", place)
        bus = buses[channel.source.bus]
        if not isinstance(channel.source, bus.source):
            raise ValueError(f"{place}: its source does not fit bus '{bus.name}' of type {bus.type}")
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
        raise ValueError(
            f"{place}: its encoder begins anew at {low:.4g} and {high:.4g}, and {joint.name} moves from {limits[0]:g} "
            f"to {limits[1]:g}; correct modulo, scale or offset"
        )


def _has(place: str, quantity: str, joint: Joint) -> None:
    """Check that a channel's joint has what the channel measures."""
    if quantity in MOTOR_QUANTITIES and joint.drive is None:
        raise ValueError(f"{place}: {joint.name} has no drive, so no {quantity}; add drive: with its ratio")
    if quantity == "motor_effort" and joint.drive is not None and joint.drive.effort == "link_side":
        raise ValueError(
            f"{place}: the drive of {joint.name} says effort: link_side, which is a joint_effort; correct one"
        )
    if quantity in CYLINDER_QUANTITIES:
        if joint.cylinder is None:
            raise ValueError(f"{place}: {joint.name} has no cylinder, so no {quantity}")
        if joint.cylinder.vented is not None and quantity == f"{joint.cylinder.vented}_pressure":
            raise ValueError(f"{place}: this chamber of {joint.name} is vented; remove the channel, or vented:")
        if quantity in SENT_QUANTITIES and joint.cylinder.valve is None:
            raise ValueError(f"{place}: {joint.name} has no valve, so no {quantity}; add cylinder.valve:")


def _sets_nothing(machine: Machine, channel: Channel) -> None:
    """Check that a command is read and never written: no node setting is its object."""
    source = channel.source
    if not isinstance(source, CanSource):
        return
    for bus in machine.buses:
        for node in bus.nodes if isinstance(bus, CanopenBus) and bus.name == source.bus else ():
            for key in node.settings if node.node == source.node else ():
                if object_of(key.partition(" ")[0]) == (source.object, source.subindex):
                    raise ValueError(
                        f"buses: {bus.name}: node {node.node}: settings would write {channel.name}, a valve's command; "
                        "no command is ever sent: remove it"
                    )


def _in_the_valves_unit(place: str, unit: str, joint: Joint) -> None:
    """Check that a command is in the unit of its valve's range and neutral."""
    valve = None if joint.cylinder is None else joint.cylinder.valve
    if valve is not None and hasattr(valve, "unit") and valve.unit != unit:
        raise ValueError(
            f"{place}: is in {unit}, and the valve of {joint.name} in {valve.unit}; write both as it is sent"
        )


def _couplings(machine: Machine, joint: Joint) -> None:
    for coupling in () if joint.drive is None else joint.drive.coupled:
        if coupling.joint == joint.name:
            raise ValueError(f"joints.{joint.name}: drive.coupled names the joint itself; that is ratio")
        names = (other.name for other in machine.joints)
        _known(coupling.joint, names, "joint", f"joints.{joint.name}: drive.coupled")


def _measured(machine: Machine, name: str) -> None:
    """Check that a joint has a position and an effort."""
    present = [c.quantity for c in machine.channels if c.joint == name]
    for quantity in sorted(set(present)):
        if present.count(quantity) > 1:
            raise ValueError(f"joints.{name}: has more than one {quantity} channel; keep one")
    drive, cylinder = machine.joint(name).drive, machine.joint(name).cylinder
    positions = {"joint_position", "piston_position", "motor_position"}
    if not positions & set(present):
        kinds = "joint_position or " + ("motor_position" if drive else "piston_position")
        raise ValueError(f"joints.{name}: has no position; add a channel of quantity {kinds}")
    pressures = {"head_pressure", "rod_pressure"} & set(present)
    if cylinder is not None and cylinder.vented is not None and pressures:
        return
    if "external_force" in present and len(pressures) < 2:
        raise ValueError(f"joints.{name}: an external_force needs head_pressure and rod_pressure; add them")
    if drive is not None and "joint_effort" not in present:
        _driven(machine, name, link_side=drive.effort == "link_side")
        return
    if len(pressures) == 1 and not {"cylinder_force", "joint_effort"} & set(present):
        missing = ({"head_pressure", "rod_pressure"} - pressures).pop()
        raise ValueError(f"joints.{name}: has no effort: one pressure is not enough; add a {missing} channel")
    if "command" in present:  # of its valve the curve and the delay can be told without any effort
        return
    if not pressures and not {"cylinder_force", "joint_effort"} & set(present):
        raise ValueError(
            f"joints.{name}: has no effort; add head_pressure and rod_pressure, cylinder_force, or joint_effort"
        )


def _driven(machine: Machine, name: str, *, link_side: bool) -> None:
    """Check that every motor that acts on the joint is measured."""
    if link_side:
        raise ValueError(
            f"joints.{name}: has no effort; its drive says effort: link_side, so add a channel of quantity joint_effort"
        )
    column = [joint.name for joint in machine.joints].index(name)
    for row in np.flatnonzero(machine.ratios[:, column]):
        motor = machine.joints[row].name
        if machine.channel("motor_effort", motor) is None:
            raise ValueError(
                f"joints.{name}: has no effort; add a channel of quantity joint_effort, or motor_effort of {motor}"
            )


def _velocities_are_measured(machine: Machine) -> None:
    """Check that what else a motor turns with is known where it gives its joint's velocity."""
    measured = {n for n, joint in enumerate(machine.joints) if machine.channel("joint_velocity", joint.name)}
    measured |= set(machine.turning_at_motors)
    for number in machine.turning_at_motors:
        for other in np.flatnonzero(machine.ratios[number]):
            if other not in measured:
                own, missing = machine.joints[number].name, machine.joints[other].name
                raise ValueError(
                    f"joints.{own}: its motor_velocity holds the speed of {missing} too, which nothing measures; "
                    f"add joint_velocity or motor_velocity of {missing}, or remove this motor_velocity"
                )


def _motors_determine(machine: Machine) -> None:
    """Check that ratios can be solved for joints that only motors measure, each row by its own ratio."""
    for unknown in (machine.at_motors, machine.turning_at_motors):
        R = machine.ratios[np.ix_(unknown, unknown)]
        if not np.all(np.linalg.svd(R / np.diag(R)[:, None], compute_uv=False) > 1e-9):
            name = next(joint.name for joint in machine.joints if joint.drive is not None and joint.drive.coupled)
            raise ValueError(
                f"joints.{name}: drive: all motors together do not tell the joints' positions; correct ratio, coupled"
            )
