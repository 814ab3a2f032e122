"""What a machine file leaves unsaid of its valves, and what that costs."""

from __future__ import annotations

from collections.abc import Iterator

from daq.machine.machine_file import Machine
from daq.machine.plausible import Doubt, Place


def valve_doubts(machine: Machine) -> Iterator[Doubt]:
    """Doubts about the valves of a valid machine file, joint by joint."""
    for number, joint in enumerate(machine.joints):
        if joint.cylinder is None or joint.cylinder.valve is None:
            continue
        place: Place = ("joints", number, "cylinder", "valve")
        pressures = [machine.channel(f"{side}_pressure", joint.name) for side in ("head", "rod")]
        if machine.channel("command", joint.name) is None:
            yield Doubt(
                place,
                "no channel shows what this valve is told, so nothing of it can be identified",
                f"add a channel of quantity command, joint {joint.name}, in {joint.cylinder.valve.unit}",
                slight=True,
            )
        elif not all(pressures):
            yield Doubt(
                place,
                "without both chamber pressures only the curve and the delay can be told: speeds at another load are "
                "predicted worse",
                "add head_pressure and rod_pressure",
                slight=True,
            )
        elif machine.supplied_at is None and machine.channel("supply_pressure") is None:
            yield Doubt(
                place,
                "nothing tells the supply pressure: an orifice that feeds the cylinder cannot be told from a "
                "compensated valve, and speeds at another load are predicted worse",
                "add a supply_pressure channel, or supply: {pressure: ...} in Pa",
                slight=True,
            )
