"""Machines of tonnes, drawn at random: the front of an excavator, and a loader crane with a telescope.

Sizes are those of data sheets and of what such machines weigh: excavators of 8 to 45 t, whose front keeps its
proportions (lengths with ``s``, areas with ``s^2``, masses with ``s^3``; ``s = 1`` has 20 t), and cranes of 10 to
35 t m. A pair of cylinders side by side counts as one of its area. Supply and valves are those of 300 bar and more.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from daq.machine.machine_file import Machine
from sim_backends.machines.parts import box_link, measured_machine, scattered
from sim_backends.plant.truth import CylinderTruth, Hydraulics, Truth

STEEL = 7850.0  # kg/m^3
MARGIN = (0.02, 0.05)  # m of stroke left at each end of the travel
Joint = dict[str, Any]


def excavator_front(seed: int) -> tuple[Machine, Truth]:
    """Swing post, boom, stick and bucket, some 1.5 to 9 t in all; sizes drawn with ``seed``.

    The post is swung by a cylinder, as on a backhoe. Boom cylinders lift; the stick's and the bucket's pull the tool in
    as they extend. The bucket hangs in a four-bar linkage and has its load inside.
    """
    rng = np.random.default_rng([seed, 3])
    s = float(np.exp(rng.uniform(np.log(0.72), np.log(1.3))))
    near = scattered(rng, s)
    post, boom, stick, bucket = near(0.5, 0.1), near(5.6), near(2.9), near(1.45)
    masses = np.array([700.0, 1550.0, 850.0, 1300.0]) * s**3 * rng.uniform(0.8, 1.2, 4)
    links = [
        box_link(rng, masses[0], (-0.5 * post, -0.15 * s, 0.0), (0.6 * s, 1.0 * s, 0.6 * s)),
        box_link(rng, masses[1], (-0.52 * boom, 0.12 * boom, 0.0), (boom, 0.6 * s, 0.5 * s)),
        box_link(rng, masses[2], (-0.62 * stick, 0.1 * s, 0.0), (1.2 * stick, 0.5 * s, 0.4 * s)),
        box_link(rng, masses[3], (-0.55 * bucket, -0.2 * s, 0.0), (bucket, 1.0 * s, 1.2 * s)),
    ]
    bar = {
        "type": "four_bar", "base_pin": [near(-1.85), near(0.42)], "base_pivot": [0.0, 0.0],
        "rocker_pivot": [near(-0.42, 0.03), 0.0], "coupler_pin": _polar(near(0.42, 0.03), rng.uniform(1.8, 1.95)),
        "link_pivot": [0.0, 0.0], "rod_arm": near(0.55, 0.03), "coupler_arm": near(0.55, 0.03),
        "coupler": near(0.5, 0.03), "side": "left",
    }  # fmt: skip
    joints = [
        _joint("swing", {"a": post, "alpha": np.pi / 2}, 0.6, 0.35, 0.4,
               _three_pin(near(0.85), near(0.34), rng.uniform(1.45, 1.7))),
        _joint("boom", {"a": boom, "theta": rng.uniform(0.25, 0.45)}, 0.55, 0.28, 0.5,
               _three_pin(near(0.78), near(2.4), rng.uniform(1.35, 1.55))),
        _joint("stick", {"a": stick, "theta": rng.uniform(-1.4, -1.1)}, 0.65, 0.45, 0.9,
               _three_pin(near(2.1), near(0.75), -rng.uniform(1.4, 1.65))),
        _joint("bucket", {"a": bucket, "theta": rng.uniform(-1.0, -0.8)}, 0.65, 0.7, 1.5, bar),
    ]  # fmt: skip
    bores = np.array([0.155, 0.170, 0.135, 0.115]) * s
    laws = [_cylinder(joint, bore, 0.68, rng) for joint, bore in zip(joints, bores, strict=True)]
    return measured_machine("excavator-front", [0.0, 0.0, -9.81], joints, laws, links, _hydraulics(s))


def telescopic_crane(seed: int) -> tuple[Machine, Truth]:
    """Make slewing column, boom, knuckle and telescope, some 1.2 to 4.5 t in all; sizes by ``seed``.

    The column is slewed by racks. The telescope is a sliding joint that a cylinder moves directly, with a grapple
    rigidly at its end; it rubs on slide pads as well as in its seals.
    """
    rng = np.random.default_rng([seed, 4])
    s = float(np.exp(rng.uniform(np.log(0.8), np.log(1.2))))
    near = scattered(rng, s)
    column, boom, outer, reach = near(0.3, 0.1), near(2.6), near(0.22), near(1.5)
    masses = np.array([450.0, 850.0, 650.0, 620.0]) * s**3 * rng.uniform(0.8, 1.2, 4)
    # The outer boom's frame stands at the knuckle: its third axis, which the telescope slides along, is the boom's.
    links = [
        box_link(rng, masses[0], (-0.5 * column, -0.5 * s, 0.0), (0.5 * s, 1.6 * s, 0.5 * s)),
        box_link(rng, masses[1], (-0.5 * boom, 0.05 * s, 0.0), (boom, 0.4 * s, 0.35 * s)),
        box_link(rng, masses[2], (-0.05 * s, 0.02, 1.0 * s), (0.35 * s, 0.3 * s, 2.4 * s)),
        box_link(rng, masses[3], (0.0, 0.0, -0.45 * s), (0.3 * s, 0.3 * s, 1.9 * s)),
    ]
    pinion = near(0.13)
    travel = 1.2
    rack = {"type": "rack", "radius": pinion, "zero": float(-travel - rng.uniform(*MARGIN) / pinion)}
    joints = [
        _joint("slew", {"a": column, "alpha": np.pi / 2, "d": near(1.8)}, travel, 0.35, 0.25, rack),
        _joint("boom", {"a": boom, "theta": rng.uniform(0.45, 0.7)}, 0.55, 0.25, 0.4,
               _three_pin(near(1.3), near(0.5), rng.uniform(1.4, 1.65))),
        _joint("knuckle", {"a": outer, "alpha": np.pi / 2, "theta": np.pi / 2 - rng.uniform(0.4, 0.8)}, 0.65, 0.35, 0.6,
               _three_pin(near(1.35), near(0.42), rng.uniform(1.45, 1.7))),
        _joint("telescope", {"d": reach}, 0.0, 0.3, 0.5, {"type": "direct"}, slide=(0.1, 0.1 + near(1.2))),
    ]  # fmt: skip
    bores = np.array([0.110, 0.170, 0.140, 0.065]) * s
    laws = [_cylinder(joint, bore, 0.65, rng) for joint, bore in zip(joints[:3], bores[:3], strict=True)]
    laws.append(_cylinder(joints[3], bores[3], 0.65, rng, pads=rng.uniform(3.0, 6.0)))
    return measured_machine("telescopic-crane", [0.0, 0.0, -9.81], joints, laws, links, _hydraulics(0.6 * s))


def _polar(radius: float, bearing: float) -> list[float]:
    return [float(radius * np.cos(bearing)), float(radius * np.sin(bearing))]


def _three_pin(a: float, b: float, offset: float) -> Joint:
    return {"type": "three_pin", "a": a, "b": b, "offset": float(offset)}


def _joint(
    name: str, row: dict[str, float], travel: float, speed: float, acceleration: float, linkage: Joint,
    slide: tuple[float, float] | None = None,
) -> Joint:  # fmt: skip
    dh = {key: float(row.get(key, 0.0)) for key in ("a", "alpha", "d", "theta")}
    limits = {"position": list(slide or (-travel, travel)), "velocity": speed, "acceleration": acceleration}
    return {"name": name, "type": "prismatic" if slide else "revolute", "dh": dh, "limits": limits,
            "cylinder": {"linkage": linkage}}  # fmt: skip


def _piston_range(joint: Joint, q: np.ndarray) -> tuple[float, float]:
    """Compute pin to pin lengths (or piston positions without pins) over the travel, from geometry of its own."""
    linkage = joint["cylinder"]["linkage"]
    if linkage["type"] == "direct":
        x = q
    elif linkage["type"] == "rack":
        x = linkage["radius"] * (q - linkage["zero"])
    elif linkage["type"] == "three_pin":
        a, b = linkage["a"], linkage["b"]
        x = np.sqrt(a**2 + b**2 - 2 * a * b * np.cos(q + linkage["offset"]))
    else:
        pivot = complex(*linkage["rocker_pivot"])
        ear = complex(*linkage["coupler_pin"]) * np.exp(1j * (q + joint["dh"]["theta"])) - pivot
        k, c, g = linkage["coupler_arm"], linkage["coupler"], np.abs(ear)
        opening = np.arccos((k**2 + g**2 - c**2) / (2 * k * g))
        rod_pin = linkage["rod_arm"] * np.exp(1j * (np.angle(ear) + opening))
        x = np.abs(rod_pin + pivot - complex(*linkage["base_pin"]))
    return float(x.min()), float(x.max())


def _cylinder(joint: Joint, bore: float, ratio: float, rng: np.random.Generator, pads: float = 1.0) -> CylinderTruth:
    """Complete the joint's cylinder of ``bore`` m so that its stroke serves the travel; what it really is.

    Coulomb friction is that of 0.6 bar over the bore, times ``pads`` where something else rubs, too.
    """
    bore = round(float(bore), 3)
    rod = round(bore * ratio, 3)
    area = np.pi * bore**2 / 4

    def around(value: float, spread: float = 0.3) -> float:
        return float(value * rng.uniform(1 - spread, 1 + spread))

    low, high = joint["limits"]["position"]
    shortest, longest = _piston_range(joint, np.linspace(low, high, 401))
    low, high = rng.uniform(*MARGIN, 2)
    if "retracted" not in joint["cylinder"]["linkage"] and joint["cylinder"]["linkage"]["type"] in _BETWEEN_PINS:
        joint["cylinder"]["linkage"]["retracted"] = float(shortest - low)
        shortest, longest = low, longest - shortest + low
    stroke = float(np.ceil(100 * (longest + high)) / 100)
    joint["cylinder"] |= {"bore": bore, "rod": rod, "stroke": stroke, "damping": around(4.5e4 * area)}
    mass = STEEL * (np.pi * rod**2 / 4 * (stroke + 0.25) + 0.6 * bore * area)
    f_c = pads * around(6.0e4 * area)
    return CylinderTruth(
        m=around(mass),
        K=around(1.1e5 * area),
        f_c=f_c,
        f_v=around(4.0e5 * area),
        f_s=float(f_c * rng.uniform(0.45, 0.95)),
    )


_BETWEEN_PINS = ("three_pin", "four_bar")


def _hydraulics(scale: float) -> Hydraulics:
    """Make a load-sensing supply of 340 bar with its size's flow; meter-out edges keep some 12 bar."""
    return Hydraulics(
        supply=34.0e6, tank=0.5e6, preload=1.2e6, head_floor=0.6e6, loss=4.0e7, droop=1.0e9 / scale**2,
        ambient=300.0, heating=25.0, warm_up=1500.0,
    )  # fmt: skip
