"""Small machines with valves for tests: a mass on one direct cylinder, and its closed forms."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import yaml

from daq.machine.machine_file import Machine, parse_machine
from sim_backends.plant.truth import LinkTruth
from sim_backends.valve.truth import LANDS, CylinderOil, Land, OilTruth, Spool, SupplyTruth, ValvePlantTruth, ValveTruth

BORE, ROD, STROKE = 0.05, 0.028, 0.6
MASS = 200.0  # kg
FLOW = 5.0e-4  # m^3/s of every land at full stroke and NOMINAL
NOMINAL = 1.0e6  # Pa
EDGE = 0.1


def sled_machine(count: int = 1, upright: bool = False) -> Machine:
    """``count`` sliding axes along x (with ``upright`` against gravity), with command and both pressures each."""
    joints: list[dict[str, Any]] = []
    channels: list[dict[str, Any]] = []
    for number in range(count):
        name = f"slide{number + 1}"
        joints.append({
            "name": name, "type": "prismatic", "dh": {"a": 0.0, "alpha": 0.0, "d": 0.0, "theta": 0.0},
            "limits": {"position": [0.02, STROKE - 0.02], "velocity": 0.5, "acceleration": 3.0},
            "cylinder": {"bore": BORE, "rod": ROD, "stroke": STROKE, "linkage": {"type": "direct"}, "valve": {}},
        })  # fmt: skip
        channels += [
            {"name": f"{name}.{key}", "quantity": key, "joint": name, "unit": unit}
            for key, unit in (
                ("command", "1"),
                ("piston_position", "m"),
                ("head_pressure", "Pa"),
                ("rod_pressure", "Pa"),
            )
        ]
    content = {"schema": "hilfit/machine/1", "name": "sled", "rate_hz": 50, "joints": joints, "channels": channels,
               "gravity": [0.0, 0.0, -9.81] if upright else [0.0, -9.81, 0.0]}  # fmt: skip
    return parse_machine(yaml.safe_dump(content))


def sled_truth(count: int = 1, mass: float = MASS, **of_the_supply: Any) -> ValvePlantTruth:
    """A truth of :func:`sled_machine` without friction: orifice valves, a spool of 20 Hz, a delay of 50 ms."""
    names = [f"slide{number + 1}" for number in range(count)]
    spool = Spool(0.05, 0.05, frequency=20.0, damping=1.0)
    valve = ValveTruth(spool, {land: Land(EDGE, FLOW) for land in LANDS}, nominal_drop=NOMINAL)
    link = LinkTruth(mass, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 1.0, 0.0, 1.0))
    supply = SupplyTruth(**({"pressure": 1.0e7, "tank": 5.0e5} | of_the_supply))
    return ValvePlantTruth(
        (link,) * count,
        dict.fromkeys(names, valve),
        dict.fromkeys(names, CylinderOil(2.0e-4, 2.0e-4)),
        supply,
        OilTruth(bulk_modulus=1.0e9),
    )


def with_valve(truth: ValvePlantTruth, **changes: Any) -> ValvePlantTruth:
    """The same with other fields of every valve; those of the spool by their own names."""
    of_the_spool = {key: changes.pop(key) for key in tuple(changes) if key in Spool.__dataclass_fields__}
    return replace(
        truth,
        valves={n: replace(v, spool=replace(v.spool, **of_the_spool), **changes) for n, v in truth.valves.items()},
    )


def with_cylinder(truth: ValvePlantTruth, **changes: Any) -> ValvePlantTruth:
    """The same with other fields of every cylinder."""
    return replace(truth, cylinders={name: replace(own, **changes) for name, own in truth.cylinders.items()})
