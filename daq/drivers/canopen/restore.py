"""Putting CANopen nodes back to what they were before they were commissioned (:mod:`daq.drivers.found_setups`)."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

from daq.drivers.base import DriverContext
from daq.drivers.can.health import BusHealth
from daq.drivers.canopen.commissioning import LEFT, PRE_OPERATIONAL, identity_of, write_objects
from daq.drivers.canopen.leadership import Leadership
from daq.drivers.canopen.link import CanLink
from daq.drivers.found_setups import FoundSetup, FoundSetups
from daq.errors import AcquisitionError, BusError, CommissioningError
from daq.machine.machine_file import CanopenBus, CanSource, Machine
from daq.messages import Sentence


@dataclass(frozen=True)
class Restored:
    """One node, and the line that says why it was not put back (empty if it was)."""

    bus: str
    node: int
    failure: str = ""


def restore_nodes(machine: Machine, data_directory: Path) -> list[Restored]:
    """Put back what commissioning changed in the nodes of a machine; nobody may be acquiring from it.

    Raises
    ------
    BusError
        If a bus cannot be opened, or another master leads it; nothing was sent on that one then.
    """
    kept = FoundSetups(data_directory, machine.name)
    done = []
    for bus in machine.buses:
        if not isinstance(bus, CanopenBus) or bus.listen_only:
            continue
        nodes = sorted(
            {c.source.node for c in machine.channels if isinstance(c.source, CanSource) and c.source.bus == bus.name}
        )
        setups = {node: setup for node in nodes if (setup := kept.read(bus.name, node)) is not None}
        if setups:
            done += _bus(bus, setups, kept)
    return done


def _bus(bus: CanopenBus, setups: dict[int, FoundSetup], kept: FoundSetups) -> list[Restored]:
    context = DriverContext(1.0, 0.0, time.monotonic_ns)
    leadership = Leadership(bus, context, setups, kept.started(bus.name))
    link = CanLink(bus, context, BusHealth(), leadership)
    try:
        if not link.leadership.lead():
            raise BusError("daq.led_nothing_sent", bus=bus.name, leadership=link.leadership.masters_seen())
        done = []
        for node, setup in setups.items():
            link.send_nmt(PRE_OPERATIONAL, node)
            try:
                sdo, place = link.sdo(node), Sentence("daq.bus_node", bus_name=bus.name, node=node)
                if identity_of(sdo) != dict(setup.identity):
                    raise CommissioningError("daq.not_the_changed_device", place=place)
                write_objects(sdo, setup.found, place)
            except AcquisitionError as error:
                done.append(Restored(bus.name, node, str(error)))
                continue
            link.send_nmt(LEFT.get(setup.state, PRE_OPERATIONAL), node)
            kept.put_back(bus.name, node)
            done.append(Restored(bus.name, node))
        return done
    finally:
        link.close()
