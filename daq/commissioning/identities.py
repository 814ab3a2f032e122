"""Comparison of a node in the machine file with the node itself: identity, units, scaling, mapping."""

from __future__ import annotations

import math

from daq.commissioning.can_questions import FoundNode
from daq.drivers.canopen.mapping import map_node
from daq.drivers.canopen.profiles import measured
from daq.errors import MachineFileError
from daq.machine.buses import object_of
from daq.machine.machine_file import CanopenBus, CanSource, Channel, Machine, ModbusSource
from daq.messages import Sentence
from daq.units import conversion

SAME = 1e-3  # two scalings that differ by less are one, written with fewer digits


def identity_findings(machine: Machine, bus_name: str, node: FoundNode) -> list[str]:
    """Report where the node is not what the machine file declares."""
    bus = next(bus for bus in machine.buses if bus.name == bus_name)
    place = Sentence("daq.bus_node", bus_name=bus_name, node=node.node)
    lines: list[str] = []
    for config in bus.nodes if isinstance(bus, CanopenBus) else ():
        if config.node != node.node:
            continue
        for key in ("device_type", "vendor_id", "product_code", "revision_number", "serial_number"):
            wanted, answered = getattr(config, key), getattr(node, key)
            if wanted is not None and wanted != answered:
                shown = "nothing" if answered is None else f"0x{answered:08X}"
                lines.append(
                    Sentence("daq.identity_differs", place=place, key=key, shown=shown, wanted=f"{wanted:08X}")
                )
        if config.firmware is not None and config.firmware != node.firmware:
            lines.append(
                Sentence(
                    "daq.firmware_machine_file_says", place=place, firmware=node.firmware, firmware_2=config.firmware
                )
            )
    return lines


def scale_finding(machine: Machine, channel: Channel, node: FoundNode) -> str | None:
    """Report where a channel's scaling is not that of the node's own objects, by its profile."""
    source = channel.source
    if not isinstance(source, CanSource) or node.device_type is None:
        return None
    objects = {object_of(text): value for text, value in node.objects.items()}
    for own in measured(node.device_type, objects):
        if (own.index, own.subindex) != (source.object, source.subindex) or not own.unit:
            continue
        settings = next(
            (n.settings for bus in machine.buses if isinstance(bus, CanopenBus) and bus.name == source.bus
             for n in bus.nodes if n.node == source.node), {},
        )  # fmt: skip
        if settings:
            return None  # commissioning writes how it is scaled, so what it says before is no matter
        try:
            device = own.scale * conversion(own.unit, machine.si_unit(channel)).factor
        except ValueError:
            return Sentence(
                "daq.node_measures_channel", channel=channel.name, node=node.node, unit=own.unit, unit_2=channel.unit
            )
        file = abs(machine.conversion(channel).factor * source.scale / 10.0**source.decimals)
        if not math.isclose(device, file, rel_tol=SAME):
            scale = device / machine.conversion(channel).factor
            return Sentence(
                "daq.own_objects_node_times",
                channel=channel.name,
                node=node.node,
                device=device / file,
                unit=own.unit,
                scale=scale,
            )
    return None


def mapping_of(machine: Machine, bus_name: str, device: str) -> str:
    """Return the place of a device's values, as commissioning maps it or as registers."""
    number = device.rpartition(" ")[2]
    own = [(i, c) for i, c in enumerate(machine.channels) if c.source is not None and c.source.bus == bus_name]
    nodes = [(i, c) for i, c in own if isinstance(c.source, CanSource) and str(c.source.node) == number]
    units = [c.source for _, c in own if isinstance(c.source, ModbusSource) and str(c.source.unit) == number]
    if units:
        return ", ".join(f"{source.table} {source.register_} {source.data_type}" for source in units)
    if not nodes:
        return ""
    bus = next(bus for bus in machine.buses if bus.name == bus_name)
    if isinstance(bus, CanopenBus) and bus.listen_only:
        sources = [c.source for _, c in nodes if isinstance(c.source, CanSource)]
        return ", ".join(f"0x{source.object:04X}:{source.subindex}" for source in sources)
    try:
        mapped = map_node(int(number), nodes, device)
    except MachineFileError as error:
        return str(error)
    return "; ".join(
        f"TPDO{mapping.number} 0x{mapping.cob_id:03X}: "
        + ", ".join(f"0x{e >> 16:04X}:{e >> 8 & 0xFF}/{e & 0xFF}" for e in mapping.entries)
        for mapping in mapped
    )
