"""Machines with valves, drawn at random: a compensated bench, a crane with orifice valves, an excavator on one pump.

Sizes are those of data sheets. A valve is sized by the speed that its cylinder has at full stroke and the nominal drop;
the supply by what the load needs over the travel.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import yaml

from daq.machine.machine_file import Machine, load_machine, parse_machine
from sim_backends.machines.parts import box_link, scattered
from sim_backends.plant.truth import LinkTruth
from sim_backends.valve.load import load_of
from sim_backends.valve.truth import (
    LANDS,
    Counterbalance,
    CylinderOil,
    Land,
    OilTruth,
    Spool,
    SupplyTruth,
    ValvePlantTruth,
    ValveTruth,
    load_valve_truth,
)

Kind = Literal["bench", "crane", "excavator"]

HOSE = 3.0e8  # Pa: what a hose's wall adds, as a modulus of its own volume
MARGIN = 0.03  # m of stroke left at each end of the travel
#: Of full stroke: data sheets give repeatabilities of 0.2 % (servo valves) to 1 % (mobile valves), twice this.
RESTLESS = (1.0e-3, 5.0e-3)


@dataclass(frozen=True)
class _Axis:
    """An axis before its load is known: its joint in the machine file, and its speed at full stroke."""

    joint: dict[str, Any]
    speed: float  # m/s
    supported: Literal["head", "rod"] | None  # chamber that carries the load by a counterbalance valve

    @property
    def areas(self) -> tuple[float, float]:
        bore, rod = self.joint["cylinder"]["bore"], self.joint["cylinder"]["rod"]
        return float(np.pi * bore**2 / 4), float(np.pi * (bore**2 - rod**2) / 4)


def default_crane() -> tuple[Machine, ValvePlantTruth]:
    """Return the demonstration's crane with its buses, and its truth."""
    folder = Path(__file__).parent
    return load_machine(folder / "crane.yaml"), load_valve_truth(folder / "crane.truth.yaml")


def compensated_bench(seed: int) -> tuple[Machine, ValvePlantTruth]:
    """Make two sliding axes, one horizontal on a spring, one that lifts, with compensated valves."""
    rng = np.random.default_rng([seed, 41])
    axes = []
    for name, alpha in (("slide", -np.pi / 2), ("lift", 0.0)):
        bore = float(rng.choice([0.040, 0.050, 0.063]))
        stroke = float(rng.choice([0.5, 0.6, 0.7]))
        speed = float(rng.uniform(0.18, 0.32))
        axes.append(
            _Axis(
                {
                    "name": name, "type": "prismatic", "dh": {"a": 0.0, "alpha": alpha, "d": 0.0, "theta": 0.0},
                    "limits": {"position": [MARGIN, stroke - MARGIN], "velocity": 1.2 * speed, "acceleration": 3.0},
                    "cylinder": _cylinder(bore, 0.56, stroke, {"type": "direct"}),
                },
                speed,
                None,
            )
        )  # fmt: skip
    masses = rng.uniform([60.0, 120.0], [150.0, 350.0])
    links = [LinkTruth(float(m), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 1.0, 0.0, 1.0)) for m in masses]
    springs = [float(rng.uniform(4.0e3, 1.2e4)), float(rng.uniform(0.0, 4.0e3))]
    compensation = float(rng.uniform(6.0e5, 1.0e6))
    supply = SupplyTruth("load_sensing", margin=float(compensation + rng.uniform(8.0e5, 1.4e6)))
    if rng.random() < 0.4:
        supply = SupplyTruth("constant_pressure")
    return _machine("compensated-bench", axes, links, springs, supply, compensation, ("1", 1.0, 0.0), rng)


def orifice_crane(seed: int) -> tuple[Machine, ValvePlantTruth]:
    """Make boom and jib of a loader crane, valves without compensators, constant supply pressure."""
    rng = np.random.default_rng([seed, 42])
    s = float(np.exp(rng.uniform(np.log(0.8), np.log(1.2))))
    near = scattered(rng, s)
    boom, jib = near(2.8), near(2.2)
    links = [
        box_link(rng, float(620.0 * s**3 * rng.uniform(0.8, 1.2)), (-0.5 * boom, 0.05, 0.0), (boom, 0.35, 0.3)),
        box_link(rng, float(480.0 * s**3 * rng.uniform(0.8, 1.2)), (-0.45 * jib, 0.0, 0.0), (jib, 0.3, 0.25)),
    ]
    axes = [
        _turning("boom", boom, rng.uniform(0.45, 0.65), 0.5, (near(1.3), near(0.5), rng.uniform(1.4, 1.6)),
                 near(0.125), 0.24, "head", rng),
        _turning("jib", jib, -rng.uniform(0.6, 0.9), 0.55, (near(1.35), near(0.42), rng.uniform(1.45, 1.65)),
                 near(0.110), 0.28, "head", rng),
    ]  # fmt: skip
    supply = SupplyTruth("constant_pressure", full_flow=4.0e-3)
    return _machine("orifice-crane", axes, links, [0.0, 0.0], supply, np.inf, ("%", 100.0, 0.0), rng)


def one_pump_excavator(seed: int) -> tuple[Machine, ValvePlantTruth]:
    """Make boom, stick, bucket of a small excavator; its one load-sensing pump does not suffice for all."""
    rng = np.random.default_rng([seed, 43])
    s = float(np.exp(rng.uniform(np.log(0.45), np.log(0.7))))
    near = scattered(rng, s)
    boom, stick, bucket = near(5.0), near(2.6), near(1.3)
    masses = np.array([1500.0, 800.0, 900.0]) * s**3 * rng.uniform(0.8, 1.2, 3)
    links = [
        box_link(rng, float(masses[0]), (-0.52 * boom, 0.1 * boom, 0.0), (boom, 0.6 * s, 0.5 * s)),
        box_link(rng, float(masses[1]), (-0.6 * stick, 0.1 * s, 0.0), (1.2 * stick, 0.5 * s, 0.4 * s)),
        box_link(rng, float(masses[2]), (-0.55 * bucket, -0.2 * s, 0.0), (bucket, 1.0 * s, 1.2 * s)),
    ]
    axes = [
        _turning("boom", boom, rng.uniform(0.3, 0.5), 0.5, (near(0.78), near(2.4), rng.uniform(1.4, 1.55)),
                 near(0.170), 0.33, None, rng),
        _turning("stick", stick, -rng.uniform(1.2, 1.4), 0.6, (near(2.1), near(0.75), -rng.uniform(1.45, 1.65)),
                 near(0.135), 0.45, None, rng),
        _turning("bucket", bucket, -rng.uniform(0.7, 0.9), 0.7, (near(1.5), near(0.5), -rng.uniform(1.45, 1.65)),
                 near(0.115), 0.7, None, rng),
    ]  # fmt: skip
    flows = [axis.speed * axis.areas[0] for axis in axes]
    limit = float(max(flows) * rng.uniform(1.05, 1.3))
    supply = SupplyTruth(
        "load_sensing", margin=float(rng.uniform(1.6e6, 2.4e6)), flow_limit=limit, full_flow=1.5 * limit, volume=1.5e-3
    )
    machine, truth = _machine("one-pump-excavator", axes, links, [0.0] * 3, supply, np.inf, ("mA", 8.0, 12.0), rng)
    valves = dict(truth.valves)
    for name, valve in truth.valves.items():
        share = float(rng.uniform(0.75, 1.1))
        valves[name] = replace(valve, lands={n: replace(land, saturation=share) for n, land in valve.lands.items()})
    return machine, replace(truth, valves=valves)


#: Kinds of machines with valves; each is made from a seed.
VALVE_MACHINES: dict[Kind, Callable[[int], tuple[Machine, ValvePlantTruth]]] = {
    "bench": compensated_bench,
    "crane": orifice_crane,
    "excavator": one_pump_excavator,
}


def _cylinder(bore: float, ratio: float, stroke: float, linkage: dict[str, Any]) -> dict[str, Any]:
    return {"bore": bore, "rod": round(bore * ratio, 3), "stroke": stroke, "damping": 0.0, "linkage": linkage}


def _turning(
    name: str, length: float, bearing: float, travel: float, pins: tuple[float, float, float], bore: float,
    speed: float, supported: Literal["head", "rod"] | None, rng: np.random.Generator,
) -> _Axis:  # fmt: skip
    """Make a revolute axis, three-pin cylinder with stroke for the travel; ``speed`` in rad/s at full stroke."""
    a, b, offset = pins
    q = np.linspace(-travel, travel, 201)
    lengths = np.sqrt(a**2 + b**2 - 2 * a * b * np.cos(q + offset))
    stroke = float(np.ceil(100 * (lengths.max() - lengths.min() + 2 * MARGIN)) / 100)
    linkage = {"type": "three_pin", "a": a, "b": b, "offset": float(offset), "retracted": float(lengths.min() - MARGIN)}
    lever = float(np.abs(np.gradient(lengths, q)).mean())
    joint = {
        "name": name, "dh": {"a": length, "alpha": 0.0, "d": 0.0, "theta": float(bearing)},
        "limits": {"position": [-travel, travel], "velocity": 1.5 * speed, "acceleration": 4.0},
        "cylinder": _cylinder(round(bore, 3), 0.6, stroke, linkage),
    }  # fmt: skip
    return _Axis(joint, float(speed * lever * rng.uniform(0.85, 1.15)), supported)


def _machine(
    name: str, axes: Sequence[_Axis], links: Sequence[LinkTruth], springs: Sequence[float], supply: SupplyTruth,
    compensation: float, sent: tuple[str, float, float], rng: np.random.Generator,
) -> tuple[Machine, ValvePlantTruth]:  # fmt: skip
    """Make machine file and truth; ``sent`` are unit, full and neutral of the commands."""
    unit, full, neutral = sent
    compensated = bool(np.isfinite(compensation))
    joints, channels = [], []
    for axis in axes:
        own = str(axis.joint["name"])
        valve = {
            "unit": unit, "range": [neutral - full, neutral + full], "neutral": neutral,
            "extends": int(rng.choice([1, -1])), "compensated": compensated,
            "counterbalance": axis.supported is not None,
        }  # fmt: skip
        joints.append(axis.joint | {"cylinder": axis.joint["cylinder"] | {"valve": valve}})
        straight = axis.joint.get("type") == "prismatic"
        position = ("piston_position", "m") if straight else ("joint_position", "rad")
        channels += [
            {"name": f"{own}.{key}", "quantity": key, "joint": own, "unit": u}
            for key, u in (("command", unit), position, ("head_pressure", "Pa"), ("rod_pressure", "Pa"))
        ]  # fmt: skip
    channels += [
        {"name": "supply_pressure", "quantity": "supply_pressure", "unit": "Pa"},
        {"name": "tank_pressure", "quantity": "tank_pressure", "unit": "Pa"},
        {"name": "oil_temperature", "quantity": "oil_temperature", "unit": "K"},
    ]
    content = {
        "schema": "hilfit/machine/1", "name": name, "rate_hz": 50, "gravity": [0.0, -9.81, 0.0], "joints": joints,
        "channels": channels, "supply": {"kind": supply.kind},
    }  # fmt: skip
    machine = parse_machine(yaml.safe_dump(content), name)
    loads = _load_pressures(machine, links, axes, springs)
    pressure = float(max(1.4e7, 1.7 * max(loads)))
    supply = replace(supply, pressure=pressure, tank=float(rng.uniform(4.0e5, 7.0e5)))
    cylinders, valves = {}, {}
    for axis, spring, load in zip(axes, springs, loads, strict=True):
        own = str(axis.joint["name"])
        cylinders[own] = _oil(axis, spring, load, pressure, rng)
        valves[own] = _valve(axis, load, compensation, rng)
    oil = OilTruth(bulk_modulus=float(rng.uniform(0.9e9, 1.3e9)), heating=float(rng.uniform(12.0, 25.0)))
    return machine, ValvePlantTruth(tuple(links), valves, cylinders, supply, oil)


def _load_pressures(
    machine: Machine, links: Sequence[LinkTruth], axes: Sequence[_Axis], springs: Sequence[float]
) -> list[float]:
    """Find the largest pressure in Pa that each load asks of the smaller chamber, all poses at rest."""
    load = load_of([(machine, links)])
    grids = np.meshgrid(*[np.linspace(*joint.limits.position, 7) for joint in machine.joints], indexing="ij")
    largest = np.zeros(len(axes))
    for q in np.stack([grid.ravel() for grid in grids], axis=1):
        pose = load.pose(q[:, None])
        force = (pose.bias(np.zeros((len(q), 1))) / pose.lever)[:, 0] + np.array(springs) * pose.x[:, 0]
        largest = np.maximum(
            largest, np.abs(force) / [axis.areas[0 if f > 0 else 1] for axis, f in zip(axes, force, strict=True)]
        )
    return [float(p) for p in largest]


def _oil(axis: _Axis, spring: float, load: float, pressure: float, rng: np.random.Generator) -> CylinderOil:
    head, rod = axis.areas
    stroke = axis.joint["cylinder"]["stroke"]
    line = float(rng.uniform(1.5, 3.0)) * np.pi / 4 * (0.012 if head < 5e-3 else 0.019) ** 2  # m^3 of hose
    held = None
    if axis.supported is not None:
        flow = axis.speed * (head if axis.supported == "head" else rod)
        setting = max(1.3 * load, 4.0e6)
        held = Counterbalance(axis.supported, setting, float(rng.uniform(2.0, 3.5)), 2.5 * setting, 1.3 * flow, 0.02)
    return CylinderOil(
        head_dead=0.04 * head * stroke + line,
        rod_dead=0.04 * rod * stroke + line,
        head_hose=line / HOSE,
        rod_hose=line / HOSE,
        mass=7850.0 * np.pi / 4 * axis.joint["cylinder"]["rod"] ** 2 * (stroke + 0.2),
        f_c=float(rng.uniform(0.8e5, 2.5e5)) * head,
        f_v=float(rng.uniform(2.0e5, 6.0e5)) * head,
        spring=spring,
        relief=1.25 * pressure,
        counterbalance=held,
    )


def _valve(axis: _Axis, load: float, compensation: float, rng: np.random.Generator) -> ValveTruth:
    """Size meter-in lands for the axis' speed at the nominal drop (a compensator's).

    Meter-out lands are 10 to 60 % larger where a counterbalance valve holds the load; else as small as it takes that
    the load does not outrun the oil that comes in.
    """
    head, rod = axis.areas
    nominal = compensation if np.isfinite(compensation) else 2.0e6
    extend, retract = rng.uniform(0.04, 0.14, 2)
    later = rng.uniform(0.0, 0.012, 2)
    widths = rng.uniform(1.1, 1.6, 2)
    if axis.supported is None:
        widths = np.minimum(widths, np.sqrt(nominal / (1.3 * load + 5.0e5)))
    exponent = 1.0 if rng.random() < 0.6 else float(rng.uniform(1.05, 1.4))
    edges = dict(zip(LANDS, (extend, retract, retract + later[1], extend + later[0]), strict=True))
    flows = dict(zip(LANDS, (head, rod, widths[1] * head, widths[0] * rod), strict=True))
    delay = float(np.round(rng.uniform(0.04, 0.25), 3))
    return ValveTruth(
        Spool(
            delay,
            delay,
            frequency=float(rng.uniform(6.0, 15.0)),
            damping=float(rng.uniform(0.7, 0.95)),
            restless=float(np.exp(rng.uniform(*np.log(RESTLESS)))),
            restless_time=float(np.exp(rng.uniform(np.log(0.1), np.log(0.6)))),
        ),
        {n: Land(float(edges[n]), float(axis.speed * flows[n]), exponent) for n in LANDS},
        nominal_drop=nominal,
        compensation=compensation,
    )
