"""Whatever is offered is a fault that a fault file may hold, for every device, channel and bus there is."""

from __future__ import annotations

import yaml

from daq.machine.machine_file import CanSource, Machine, ModbusRtuBus, ModbusSource
from sim_backends import default_machine
from sim_backends.faults.fault_file import FAULTS, SCHEMA, fault_problems
from sim_backends.faults.fault_offers import fault_offers


def machine_with_a_serial_line() -> Machine:
    machine, _ = default_machine()
    channels = tuple(
        c.model_copy(update={"source": c.source.model_copy(update={"bus": "line"})})
        if isinstance(c.source, ModbusSource) and c.source.unit == 5
        else c
        for c in machine.channels
    )
    line = ModbusRtuBus(name="line", type="modbus_rtu", port="/dev/ttyS0")
    return machine.model_copy(update={"channels": channels, "buses": (*machine.buses, line)})


def test_every_offer_is_a_fault_of_this_machine() -> None:
    machine = machine_with_a_serial_line()
    offers = fault_offers(machine)
    listed = [{"at": 0, "for": 1, **offer["entry"]} for offer in offers]
    script, problems = fault_problems(yaml.safe_dump({"schema": SCHEMA, "faults": listed}), machine)
    assert problems == [] and script is not None and len(script.faults) == len(offers)
    assert {offer["fault"] for offer in offers} == set(FAULTS)
    assert len({(offer["fault"], offer["target"]) for offer in offers}) == len(offers), "a person can tell them apart"


def test_every_device_and_channel_is_offered() -> None:
    machine = machine_with_a_serial_line()
    entries = [offer["entry"] for offer in fault_offers(machine)]
    dead = {(e["bus"], e.get("node", e.get("unit"))) for e in entries if e["fault"] == "node_death"}
    assert dead == {
        (c.source.bus, c.source.node if isinstance(c.source, CanSource) else c.source.unit)
        for c in machine.channels
        if isinstance(c.source, CanSource | ModbusSource)
    }
    frozen = {e["channel"] for e in entries if e["fault"] == "freeze"}
    assert frozen == {c.name for c in machine.channels if c.source is not None}
