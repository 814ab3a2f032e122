"""Faults of a script, begun and ended at their times on a running simulated machine."""

from __future__ import annotations

import heapq
import json
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Protocol

from daq.errors import HilfitError
from daq.machine.machine_file import CanopenBus, CanSource, Machine, ModbusSource
from sim_backends.devices.wiring import channel_signal
from sim_backends.faults.fault_file import (
    BiasStep,
    BusOff,
    ClockJump,
    Corrupt,
    Death,
    Delay,
    Drop,
    DuplicateId,
    EmcyStorm,
    Fault,
    HalfOpen,
    NoiseBurst,
    Saturate,
    SignalFault,
    SlowPeer,
    SyncJitter,
)

LOOK_S = 0.05  # between two looks whether acquisition has begun


class Orderable(Protocol):
    """A machine that takes orders for its processes."""

    def order(self, process: str, order: str, **details: Any) -> Any:
        """Give one order and wait for its answer."""


class FaultRunner:
    """Runs a script beside a simulated machine, from its first SYNC on.

    Parameters
    ----------
    machine : takes the orders
    declared : its machine file
    script : what is to happen
    log : a line of JSON for everything that began or ended: ``utc_ns``, ``what`` (``begin`` or ``end``), ``fault``
    show : takes the same in words
    """

    def __init__(
        self,
        machine: Orderable,
        declared: Machine,
        script: Sequence[Fault],
        log: Path | None = None,
        show: Callable[[str], None] = lambda line: None,
    ) -> None:
        self._machine, self._declared = machine, declared
        self._log, self._show = log, show
        self._stopping = threading.Event()
        # Time, a number that keeps the order of the file, the fault, and whether it begins.
        self._due = [(fault.at, number, fault, True) for number, fault in enumerate(script)]
        heapq.heapify(self._due)
        self._thread = threading.Thread(target=self._run, name="faults", daemon=True)

    def start(self) -> None:
        """Wait for the first SYNC, in a thread."""
        self._thread.start()

    def stop(self) -> None:
        """Begin no more faults; those that have begun remain."""
        self._stopping.set()
        if self._thread.is_alive():
            self._thread.join()

    def _run(self) -> None:
        try:
            while not self._machine.order("hub", "counts")["sync"]:
                if self._stopping.wait(LOOK_S):
                    return
            began = time.monotonic()
            while self._due:
                at, number, fault, begins = heapq.heappop(self._due)
                if self._stopping.wait(max(0.0, began + at - time.monotonic())):
                    return
                apply(self._machine, self._declared, fault, on=begins)
                self._announce(fault, begins)
                if begins:
                    heapq.heappush(self._due, (at + fault.seconds_long, number, fault, False))
                elif fault.every is not None:
                    heapq.heappush(self._due, (at - fault.seconds_long + fault.every, number, fault, True))
        except HilfitError as error:  # the simulated machine was switched off, or one of its processes died
            self._show(f"faults end here: {error}")

    def _announce(self, fault: Fault, begins: bool) -> None:
        content = fault.model_dump(mode="json", by_alias=True, exclude_none=True)
        what = "begin" if begins else "end"
        details = ", ".join(f"{key} {value}" for key, value in content.items() if key not in ("fault", "at", "every"))
        self._show(f"{content['fault']} {what}s ({details})")
        if self._log is not None:
            with self._log.open("a", encoding="utf-8") as file:
                file.write(json.dumps({"utc_ns": time.time_ns(), "what": what, "fault": content}) + "\n")


def apply(machine: Orderable, declared: Machine, fault: Fault, *, on: bool) -> None:
    """Let a fault begin, or end.

    Parameters
    ----------
    machine : takes the orders
    declared : its machine file
    fault : which one
    on : True begins it
    """
    match fault:
        case SignalFault():
            _signal(machine, declared, fault, on)
        case Death(node=None, unit=int(unit)):
            _unit(machine, fault.bus, unit, "silence", on=on)
        case Death(node=int(node)):
            _node(machine, node, "kill" if on else "revive")
        case Drop() | Corrupt():
            _share(machine, fault, fault.share if on else 0.0)
        case Delay(node=None, unit=int(unit)):
            _unit(machine, fault.bus, unit, "delay", seconds=(fault.seconds or 0.0) if on else 0.0)
        case Delay(node=int(node)):
            _node(machine, node, "lag", value=(fault.syncs or 0) if on else 0)
        case DuplicateId():
            _node(machine, fault.node, "doubled", value=on)
        case EmcyStorm():
            if on:
                _node(machine, fault.node, "storm", count=fault.count, code=fault.code)
            else:
                _node(machine, fault.node, "emergency", code=0, register=0)
        case BusOff():
            machine.order("hub", "bus_off", on=on)
        case SyncJitter():
            machine.order("hub", "jitter", seconds=fault.seconds if on else 0.0)
        case ClockJump():
            for process in ("hub", "nodes"):
                machine.order(process, "clock_jump", seconds=fault.seconds if on else 0.0)
        case HalfOpen():
            process, where = _bus(declared, fault.bus)
            machine.order(process, "half_open", on=on, **where)
        case SlowPeer():
            process, where = _bus(declared, fault.bus)
            machine.order(process, "slow", seconds=fault.seconds if on else 0.0, **where)
        case _:
            raise TypeError(f"no fault of a simulated machine: {type(fault).__name__}")


def _node(machine: Orderable, node: int, kind: str, **details: Any) -> None:
    machine.order("nodes", "fault", node=node, kind=kind, **details)


def _unit(machine: Orderable, bus: str, unit: int | None, kind: str, **details: Any) -> None:
    machine.order("modbus", "fault", bus=bus, unit=unit, kind=kind, **details)


def _bus(declared: Machine, name: str) -> tuple[str, dict[str, str]]:
    can = any(bus.name == name and isinstance(bus, CanopenBus) for bus in declared.buses)
    return ("hub", {}) if can else ("modbus", {"bus": name})


def _share(machine: Orderable, fault: Drop | Corrupt, share: float) -> None:
    if fault.node is not None:
        _node(machine, fault.node, fault.fault, value=share)
    else:
        _unit(machine, fault.bus, fault.unit, fault.fault, value=share)


def _signal(machine: Orderable, declared: Machine, fault: SignalFault, on: bool) -> None:
    column, channel = next((k, c) for k, c in enumerate(declared.channels) if c.name == fault.channel)
    signal, unit = channel_signal(declared, channel, column), declared.conversion(channel)
    size = 0.0
    if isinstance(fault, NoiseBurst | BiasStep):
        size = fault.size * unit.factor * signal.factor
    elif isinstance(fault, Saturate):
        assert channel.range is not None
        size = signal.factor * float(unit.to_si(max(channel.range))) + signal.offset
    what: Any = fault.model_dump()["fault"]
    details = {"channel": fault.channel, "what": what, "size": size, "on": on}
    if isinstance(channel.source, CanSource):
        _node(machine, channel.source.node, "signal", **details)
    elif isinstance(channel.source, ModbusSource):
        _unit(machine, channel.source.bus, channel.source.unit, "signal", **details)
