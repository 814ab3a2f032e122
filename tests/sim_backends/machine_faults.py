"""Faults of a running simulated machine, over the control channel of its processes; more kinds than fault files have.

Every function returns when the process has done it; none of them reaches the plant.
"""

from __future__ import annotations

from typing import Any

from sim_backends.faults.fault_runner import Orderable


def kill_node(machine: Orderable, node: int) -> None:
    """The node falls silent altogether: no TPDO, no heartbeat, no SDO answer."""
    _node(machine, node, "kill")


def revive_node(machine: Orderable, node: int) -> None:
    """Power for a killed node: boot-up message, defaults, pre-operational."""
    _node(machine, node, "revive")


def reset_node(machine: Orderable, node: int) -> None:
    """The node reboots by itself (a power dip): boot-up in service, its mapping forgotten."""
    _node(machine, node, "reset")


def emergency(machine: Orderable, node: int, code: int = 0x5000, register: int = 0x81) -> None:
    """An EMCY message; ``code=0, register=0`` says that the error is gone."""
    _node(machine, node, "emergency", code=code, register=register)


def short_pdo(machine: Orderable, node: int, length: int | None = 2) -> None:
    """TPDOs are cut to ``length`` bytes (None: whole again), as a node does whose mapping was lost."""
    _node(machine, node, "short", length=length)


def freeze_node(machine: Orderable, node: int, on: bool = True) -> None:
    """The process values stand still; everything else goes on."""
    _node(machine, node, "freeze", on=on)


def silence_node(machine: Orderable, node: int, on: bool = True) -> None:
    """No TPDOs; heartbeat and SDO go on."""
    _node(machine, node, "silence", on=on)


def drop_can_clients(machine: Orderable) -> int:
    """The hub closes all connections, as a gateway that reboots does; how many there were."""
    return int(machine.order("hub", "drop_clients"))


def lose_tpdos(machine: Orderable, node: int, count: int) -> None:
    """The next so many TPDOs of the node are lost."""
    _node(machine, node, "lose", value=count)


def double_node(machine: Orderable, node: int, on: bool = True) -> None:
    """A second device with the same node-ID, which measures something else."""
    _node(machine, node, "doubled", value=on)


def garble_sdo(machine: Orderable, node: int, on: bool = True) -> None:
    """SDO answers are cut to two bytes."""
    _node(machine, node, "garbled", value=on)


def not_a_number(machine: Orderable, node: int, on: bool = True) -> None:
    """Every float that the node measures is NaN."""
    _node(machine, node, "not_a_number", on=on)


def emergency_storm(machine: Orderable, node: int, count: int = 2000, code: int = 0x5000) -> None:
    """So many EMCY messages at once."""
    _node(machine, node, "storm", count=count, code=code)


def error_frame(machine: Orderable, identifier: int = 0x008) -> None:
    """An error frame on the CAN bus; ``0x040`` is bus-off (classes of ``linux/can/error.h``)."""
    machine.order("hub", "error_frame", identifier=identifier)


def inject(machine: Orderable, identifier: int, data: bytes, extended: bool = False) -> None:
    """A frame of a stranger on the CAN bus."""
    machine.order("hub", "inject", identifier=identifier, data=data.hex(), extended=extended)


def silence_unit(machine: Orderable, bus: str, unit: int, on: bool = True) -> None:
    """The Modbus unit does not answer."""
    _unit(machine, bus, unit, "silence", on=on)


def freeze_unit(machine: Orderable, bus: str, unit: int, on: bool = True) -> None:
    """The unit's registers stand still."""
    _unit(machine, bus, unit, "freeze", on=on)


def delay_unit(machine: Orderable, bus: str, unit: int, seconds: float) -> None:
    """The unit answers late by ``seconds`` (0: at once again)."""
    _unit(machine, bus, unit, "delay", seconds=seconds)


def exception_unit(machine: Orderable, bus: str, unit: int, code: int | None = 4) -> None:
    """The unit answers with this exception code (None: with values again)."""
    _unit(machine, bus, unit, "exception", code=code)


def override_unit(machine: Orderable, bus: str, unit: int, raw: float | None) -> None:
    """All signals of the unit have this raw value, NaN for instance (None: measured ones again)."""
    _unit(machine, bus, unit, "override", raw=raw)


def _node(machine: Orderable, node: int, kind: str, **details: Any) -> None:
    machine.order("nodes", "fault", node=node, kind=kind, **details)


def _unit(machine: Orderable, bus: str, unit: int, kind: str, **details: Any) -> None:
    machine.order("modbus", "fault", bus=bus, unit=unit, kind=kind, **details)
