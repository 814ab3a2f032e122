"""The demonstration's arm with some of its joints: a machine on the same buses that costs less to run and to fit."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from daq.machine.buses import CanopenBus
from daq.machine.machine_file import Machine
from sim_backends import SimulatedMachine, default_machine
from sim_backends.plant.truth import Truth


def shorter_arm(*numbers: int) -> tuple[Machine, Truth]:
    """Joints of these numbers (from 1 on), their channels and nodes, and what is measured of the machine as a whole."""
    machine, truth = default_machine()
    kept = tuple(machine.joints[number - 1] for number in numbers)
    names = {None, *(joint.name for joint in kept)}
    channels = tuple(channel for channel in machine.channels if channel.joint in names)
    nodes = {channel.source.node for channel in channels if channel.source is not None and channel.source.bus == "can"}
    buses = tuple(
        bus.model_copy(update={"nodes": tuple(node for node in bus.nodes if node.node in nodes)})
        if isinstance(bus, CanopenBus)
        else bus
        for bus in machine.buses
    )
    cylinders = {name: cylinder for name, cylinder in truth.cylinders.items() if name in names}
    return (
        machine.model_copy(update={"joints": kept, "channels": channels, "buses": buses}),
        replace(truth, links=tuple(truth.links[number - 1] for number in numbers), cylinders=cylinders),
    )


@contextmanager
def three_joints(directory: Path, speed: float) -> Iterator[Path]:
    """Simulate three joints of it, with the effect that the demonstration's plant has; the machine file."""
    machine, truth = shorter_arm(1, 2, 3)
    with SimulatedMachine(machine, truth, undeclared="demo", speed=speed, workdir=directory) as simulated:
        yield simulated.machine_path
