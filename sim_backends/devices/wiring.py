"""Assignment of channels to simulated devices: from the machine file to plans for the device processes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from daq.errors import InputError
from daq.machine.buses import object_of
from daq.machine.machine_file import CanopenBus, CanSource, Channel, Machine, ModbusRtuBus, ModbusSource, ModbusTcpBus
from sim_backends.devices.device_plans import NodeObject, NodePlan, RegisterSignal, Signal, UnitPlan

#: What a machine file may declare of a node, and its plan has by the same name.
_DECLARED = (
    "device_type", "vendor_id", "product_code", "settings", "revision_number", "serial_number", "firmware",
)  # fmt: skip


@dataclass(frozen=True)
class Wiring:
    """All device plans of a machine: nodes of its CANopen bus, units of each of its Modbus buses."""

    can_channel: str
    nodes: tuple[NodePlan, ...]
    modbus: Mapping[str, tuple[UnitPlan, ...]]


def wire(machine: Machine) -> Wiring:
    """Plan all channels of ``machine`` that have a source.

    Raises
    ------
    InputError
        If the machine has no CANopen bus, more than one, or a bus that the simulator cannot stand in for.
    """
    can = [bus for bus in machine.buses if isinstance(bus, CanopenBus)]
    if len(can) != 1:
        raise InputError("sim_backends.not_one_canopen_bus", machine=machine.name, count=len(can))
    for bus in machine.buses:
        if not isinstance(bus, CanopenBus | ModbusTcpBus | ModbusRtuBus):
            raise InputError("sim_backends.bus_not_simulated", machine=machine.name, bus=bus.name, type=bus.type)
    nodes: dict[int, list[NodeObject]] = {}
    units: dict[str, dict[int, list[RegisterSignal]]] = {
        bus.name: {} for bus in machine.buses if isinstance(bus, ModbusTcpBus | ModbusRtuBus)
    }
    for column, channel in enumerate(machine.channels):
        source = channel.source
        if isinstance(source, CanSource):
            known = nodes.setdefault(source.node, [])
            known.append(NodeObject(source.object, source.subindex, channel_signal(machine, channel, column)))
        elif isinstance(source, ModbusSource):
            held = units[source.bus].setdefault(source.unit, [])
            held.append(RegisterSignal(source.register_, source.word_order, channel_signal(machine, channel, column)))
    declared = {node.node: node for node in can[0].nodes}
    plans = []
    for number, objects in sorted(nodes.items()):
        node = declared.get(number)
        own: dict[str, Any] = {} if node is None else {key: getattr(node, key) for key in _DECLARED}
        plans.append(NodePlan(number, _kind(objects, own.get("device_type")), tuple(objects), **own))
    return Wiring(
        can[0].channel,
        tuple(plans),
        {bus: tuple(UnitPlan(n, tuple(r)) for n, r in sorted(held.items())) for bus, held in units.items()},
    )


def channel_signal(machine: Machine, channel: Channel, column: int) -> Signal:
    """Return the conversion of a channel's SI value to what its device sends."""
    source = channel.source
    assert isinstance(source, CanSource | ModbusSource)
    # value = (SI - conversion.offset) / conversion.factor and raw = (value - source.offset) / source.scale
    conversion = machine.conversion(channel)
    scale = source.scale / 10.0**source.decimals
    factor = 1.0 / (conversion.factor * scale)
    offset = -(conversion.offset / conversion.factor + source.offset) / scale
    turn = source.modulo or 0.0
    field = (0, 0)
    if source.mask is not None:
        field = (source.mask.bit_count(), (source.mask & -source.mask).bit_length() - 1)
    decimals = None
    if isinstance(source, CanSource) and source.decimals_object is not None:
        decimals = object_of(source.decimals_object)
    elif isinstance(source, ModbusSource) and source.decimals_register is not None:
        decimals = (source.decimals_register, 0)
    zero = source.zero if turn else 0.0
    offset += 0.0 if turn else source.zero
    return Signal(channel.name, column, factor, offset, source.data_type, turn, zero, field, decimals)


def _kind(objects: list[NodeObject], device_type: int | None) -> str:
    indices = {item.index for item in objects}
    profile = None if device_type is None else device_type & 0xFFFF
    if 0x6130 in indices and profile in (None, 0x194):
        return "pressure_transducer"
    if indices & {0x6010, 0x6020} and profile == 0x19A:
        return "inclinometer"
    if 0x6004 in indices and profile in (None, 0x196):
        return "rotary_encoder"
    if 0x6020 in indices and profile in (None, 0x196):
        return "linear_encoder"
    return "generic"
