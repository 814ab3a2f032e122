"""The bus check of a machine that is being acquired: only one process may have a bus, so nobody else is asked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from daq.acquisition.cycles import AcquisitionStatistics
from daq.commissioning.can_questions import FoundNode, described
from daq.commissioning.check import SECONDS, MachineCheck, delays_of_frames, machine_check
from daq.machine.machine_file import CanopenBus, Machine
from daq.messages import Sentence


def check_running(
    machine: Machine,
    rows: npt.NDArray[np.void],
    statistics: AcquisitionStatistics,
    *,
    seconds: float = SECONDS,
    depressurised: bool = False,
) -> MachineCheck:
    """Check a machine that is being acquired, by frames of it; nothing is sent, and nothing waits.

    Who devices are is what they answered the driver when they had been commissioned.

    Parameters
    ----------
    rows : (N,) frames, as the ring buffer has them; delays between buses come from all of them
    statistics : of the same acquisition, since its start
    seconds : the newest ones are those in which the machine rests
    depressurised : as in :func:`check_machine_buses`
    """
    nodes = {
        (bus["bus"], node.node): node
        for bus in statistics.buses
        for device in bus["devices"]
        if (node := _node(device)) is not None
    }
    silent = [bus for bus in machine.buses if isinstance(bus, CanopenBus) and bus.listen_only]
    notes = [Sentence("server.bus_listen_only_no_device", bus=bus.name) for bus in silent]
    resting = rows[-max(1, round(seconds * machine.rate_hz)) :]
    found = machine_check(machine, resting, statistics, nodes, notes, depressurised=depressurised)
    return replace(found, delays=delays_of_frames(machine, rows))


def _node(device: Mapping[str, Any]) -> FoundNode | None:
    """Describe a node from its driver's requests; None for a device that was not asked."""
    objects = device.get("objects") or {}
    kind, _, number = str(device["name"]).rpartition(" ")
    return described(int(number), objects) if kind == "node" and objects and number.isdigit() else None
