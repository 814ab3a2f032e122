"""Faults that a simulated machine can have: an offer for each fault and each thing that can have it, to choose from."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from daq.machine.machine_file import CanopenBus, CanSource, Channel, Machine, ModbusSource, ModbusTcpBus

_OF_DEVICES = ("node_death", "drop", "delay", "corrupt")
_OF_NODES = ("duplicate_id", "emcy_storm")
_OF_CHANNELS = ("freeze", "nan", "saturate", "noise_burst", "bias_step")
LATE_S, SLOW_S, JITTER_S, JUMP_S = 0.06, 0.03, 0.004, 3600.0
SIZE = 0.05  # of a channel's range, for what is added to its value


def fault_offers(machine: Machine) -> list[dict[str, Any]]:
    """List offers as ``{"fault", "target", "entry"}``: name, what it is of in words, keys of a fault file.

    ``entry`` lacks ``at`` and ``for``; sizes are such that the fault is seen.
    """
    return [
        {"fault": entry["fault"], "target": target, "entry": entry}
        for target, entry in (*_devices(machine), *_channels(machine), *_buses(machine))
    ]


def _devices(machine: Machine) -> Iterator[tuple[str, dict[str, Any]]]:
    devices: dict[tuple[str, str, int], list[str]] = {}
    for channel in machine.channels:
        if isinstance(channel.source, CanSource):
            devices.setdefault((channel.source.bus, "node", channel.source.node), []).append(channel.name)
        elif isinstance(channel.source, ModbusSource):
            devices.setdefault((channel.source.bus, "unit", channel.source.unit), []).append(channel.name)
    for (bus, kind, number), names in devices.items():
        target = f"{kind} {number} on {bus} ({', '.join(names[:2])}{', …' if len(names) > 2 else ''})"
        for fault in _OF_DEVICES + (_OF_NODES if kind == "node" else ()):
            late = {"syncs": 2} if kind == "node" else {"seconds": LATE_S}
            yield target, {"fault": fault, "bus": bus, kind: number, **(late if fault == "delay" else {})}


def _channels(machine: Machine) -> Iterator[tuple[str, dict[str, Any]]]:
    for channel in machine.channels:
        if not isinstance(channel.source, CanSource | ModbusSource):
            continue
        for fault in _OF_CHANNELS:
            if fault == "nan" and not channel.source.data_type.startswith("float"):
                continue
            if fault in ("saturate", "noise_burst", "bias_step") and channel.range is None:
                continue
            size = {"size": _size(channel)} if fault in ("noise_burst", "bias_step") else {}
            yield channel.name, {"fault": fault, "channel": channel.name, **size}


def _size(channel: Channel) -> float:
    assert channel.range is not None
    return float(f"{SIZE * (max(channel.range) - min(channel.range)):.3g}")


def _buses(machine: Machine) -> Iterator[tuple[str, dict[str, Any]]]:
    for bus in machine.buses:
        target = f"bus {bus.name}"
        if isinstance(bus, CanopenBus):
            for fault, seconds in (("bus_off", None), ("sync_jitter", JITTER_S), ("clock_jump", JUMP_S)):
                yield target, {"fault": fault, "bus": bus.name, **({} if seconds is None else {"seconds": seconds})}
        if isinstance(bus, CanopenBus | ModbusTcpBus):
            yield target, {"fault": "half_open", "bus": bus.name}
        slow = 0.2 * SLOW_S if isinstance(bus, CanopenBus) else SLOW_S
        yield target, {"fault": "slow_peer", "bus": bus.name, "seconds": slow}
