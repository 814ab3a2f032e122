"""A small valve bench for tests: what its numbers say happens, and nothing of the product is used to make it happen.

One cylinder, 20 steps of integration per cycle. The inlet's edge decides the speed; oil gives way (of the chamber that
is filled, ``v = Q/A - V/(A K) dp/dt``), pressures follow a load that swings with a lag of a tenth of a second. The
command is held between cycles; the value that stands in a row is what was sent at that moment.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from math import exp, sin, sqrt
from pathlib import Path
from types import MappingProxyType

import numpy as np
import yaml

from daq import Machine, parse_machine, write_recording

RATE, STEPS, STROKE = 50.0, 20, 0.6
A1, A2 = np.pi * 0.08**2 / 4, np.pi * (0.08**2 - 0.045**2) / 4
TANK, REFERENCE = 3e5, 1e7  # Pa


@dataclass(frozen=True)
class Bench:
    """What is true: edges and gains (extend, retract), delay, law (``in``: an orifice feeds; ``none``: compensated)."""

    edges: tuple[float, float] = (0.06, 0.12)
    gains: tuple[float, float] = (0.30, 0.35)  # m/s per full command at REFERENCE
    power: float = 1.0
    delay: float = 0.16  # s; a multiple of a step
    laws: tuple[str, str] = ("in", "in")
    supply: float = 18e6
    bulk: float = 1.2e9
    hoses: float = 2e-4  # m^3
    load: float = 2.5e4  # N
    noise: float = 2e-5  # m
    largest: float = 0.7  # of the motion's command, before feedback keeps it within the stroke
    # one effect each
    hysteresis: float = 0.0  # half width
    later: float = 0.0  # s, of retraction
    leak: float = 0.0  # m^3/s/Pa past the piston
    cold: float = 0.0  # share of the gain at the beginning, gone with 25 s
    pump: float = np.inf  # m^3/s
    # two that have no name
    bent: float = 0.0  # share of the gain more at one end of the stroke than at the other
    taken: float = 0.0  # share of the gain that is gone for each m^3/s that another cylinder takes

    @cache  # noqa: B019  # a bench is a value; machines that measure less of it read the same run
    def run(self, seed: int, seconds: float = 50.0) -> Mapping[str, np.ndarray]:
        """Channels over time, as sensors show them; made once, so not to be written to."""
        rng = np.random.default_rng(seed)
        wanted = self._motion(rng, round(seconds * RATE))
        dt = 1.0 / (RATE * STEPS)
        lags = [round((self.delay + late) / dt) for late in (0.0, self.later)]
        phases = rng.uniform(0, 2 * np.pi, 2).tolist()
        x, v, p1, p2, spool = 0.5 * STROKE, 0.0, 6e6, 5e6, 0.0
        share = 1.0 - exp(-dt / 0.12)
        turn = 0.44  # rad/s of another axis, which swings by a fifth of a metre
        spools, rows = [0.0] * (len(wanted) * STEPS), []
        for row, own in enumerate(wanted.tolist()):
            command = min(max(own - 1.2 * (x - 0.5 * STROKE), -1.0), 1.0)
            rows.append((row / RATE, command, x, p1, p2))
            for step in range(STEPS):
                place = row * STEPS + step
                time = place * dt
                spool = min(max(spool, command - self.hysteresis), command + self.hysteresis)
                spools[place] = spool
                late = [spools[place - lag] if place >= lag else 0.0 for lag in lags]
                opened = (late[0] - self.edges[0], -late[1] - self.edges[1])
                extends = late[0] > 0.0  # whose chamber tells the speed, at rest too
                flow = 0.0  # m/s
                swing = -0.2 * turn * sin(turn * time)  # m/s of the other one
                missing = self.taken * max(swing * A1, -swing * A2) - self.bent * (x / STROKE - 0.5)
                for way, (inlet, area, sign) in enumerate(((p1, A1, 1.0), (p2, A2, -1.0))):
                    if opened[way] <= 0.0:
                        continue
                    own_flow = self.gains[way] * opened[way] ** self.power * (1.0 + self.cold * exp(-time / 25.0))
                    own_flow *= 1.0 - missing
                    if self.laws[way] == "in":
                        own_flow *= sqrt(max(self.supply - inlet, 0.0) / REFERENCE)
                    flow += sign * min(own_flow, self.pump / area)
                force = self.load * (1 + 0.5 * sin(0.31 * time + phases[0]) + 0.4 * sin(0.83 * time + phases[1]))
                back = 6e5 + 3e6 * abs(v)
                goal = ((force + back * A2) / A1, back) if extends else (back + force / A1, 0.0)
                if not extends:
                    goal = goal[0], (goal[0] * A1 - force) / A2
                rise = [share * (goal[0] - p1) / dt, share * (goal[1] - p2) / dt]
                p1, p2 = p1 + rise[0] * dt, p2 + rise[1] * dt
                across = self.leak * (p1 - p2)
                if extends:
                    v = flow - (x * A1 + self.hoses) / (A1 * self.bulk) * rise[0] - across / A1
                else:
                    v = flow + ((STROKE - x) * A2 + self.hoses) / (A2 * self.bulk) * rise[1] - across / A2
                x += v * dt
        table = np.array(rows)
        count = len(table)
        shown = {
            "time": table[:, 0], "u": table[:, 1], "x": table[:, 2] + self.noise * rng.normal(size=count),
            "head": table[:, 3] + 1e4 * rng.normal(size=count), "rod": table[:, 4] + 1e4 * rng.normal(size=count),
            "ps": self.supply + 2e4 * rng.normal(size=count), "pt": TANK + 1e3 * rng.normal(size=count),
            "y": 0.3 + 0.2 * np.cos(turn * table[:, 0]), "f": np.sin(turn * table[:, 0]),
        }  # fmt: skip
        for values in shown.values():
            values.flags.writeable = False
        return MappingProxyType(shown)

    def _motion(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Sines with levels that are held, as an operator moves."""
        time = np.arange(count) / RATE
        sines = zip(rng.uniform(0.3, 1, 5), rng.uniform(0.05, 0.25, 5), rng.uniform(0, 2 * np.pi, 5), strict=True)
        u = np.sum([a * np.sin(2 * np.pi * f * time + p) for a, f, p in sines], axis=0)
        u *= self.largest / np.abs(u).max()
        for _ in range(6):
            start = int(rng.integers(0, max(count - 150, 1)))
            level = rng.uniform(-self.largest, self.largest) if rng.random() < 0.7 else 0.0
            u[start : start + int(rng.integers(50, 150))] = level
        return u

    def speed(self, way: int, share: float, filled: float) -> float:
        """m/s, not negative, at a steady command and pressure of the side that is filled."""
        factor = np.sqrt((self.supply - filled) / REFERENCE) if self.laws[way] == "in" else 1.0
        return float(self.gains[way] * max(share - self.edges[way], 0.0) ** self.power * factor)


UNITS = {
    "x": ("piston_position", "m"), "u": ("command", "1"), "head": ("head_pressure", "Pa"),
    "rod": ("rod_pressure", "Pa"), "ps": ("supply_pressure", "Pa"), "pt": ("tank_pressure", "Pa"),
    "y": ("piston_position", "m"), "f": ("cylinder_force", "N"),
}  # fmt: skip


def machine_of(channels: str = "x u head rod ps pt", **valve: object) -> Machine:
    """The bench's machine file with some of its channels."""
    listed = []
    for name in channels.split():
        quantity, unit = UNITS[name]
        own = {} if quantity in ("supply_pressure", "tank_pressure") else {"joint": "stick" if name in "yf" else "boom"}
        unit = str(valve.get("unit", unit)) if quantity == "command" else unit
        listed.append({"name": name, "quantity": quantity, "unit": unit, **own})
    cylinder = {"bore": 0.08, "rod": 0.045, "stroke": STROKE, "linkage": {"type": "direct"}, "valve": valve}
    joint = {
        "name": "boom", "type": "prismatic", "dh": dict.fromkeys(("a", "alpha", "d", "theta"), 0.0),
        "limits": {"position": [0.0, STROKE], "velocity": 1.0, "acceleration": 5.0}, "cylinder": cylinder,
    }  # fmt: skip
    head = {"schema": "hilfit/machine/1", "name": "bench", "rate_hz": RATE, "gravity": [0.0, -9.81, 0.0]}
    other = {**joint, "name": "stick", "cylinder": {**cylinder, "valve": None}}
    joints = [joint, other] if "y" in channels.split() else [joint]
    return parse_machine(yaml.safe_dump({**head, "joints": joints, "channels": listed}))


def written(folder: Path, machine: Machine, bench: Bench, seed: int, seconds: float = 50.0) -> Path:
    """A recording of the bench as a file."""
    table = bench.run(seed, seconds)
    file = folder / f"run-{seed}.parquet"
    values = {channel.name: table[channel.name] for channel in machine.channels}
    write_recording(file, machine, "operation", table["time"], values)
    return file


__all__ = ["A1", "A2", "RATE", "STROKE", "Bench", "machine_of", "replace", "written"]
