"""Every documented option of the machine file goes through ``identify``, a few without the loop as well.

One or two joints, 20 s a motion. What is measured is put together here, channel by channel, from the machine file's own
definitions: motors by their ratios, chambers by their areas, load cells by their sign.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from synthetic_arm import Motion, force, make_motion, truth

from daq.machine.machine_file import Machine, machine_to_yaml, parse_machine
from daq.recordings.recording import write_recording
from fitting.loop.session import Options, Request
from fitting.pipeline import stages
from fitting.pipeline.stages import identify

pytestmark = pytest.mark.slow

SECONDS = 20.0
#: Seeds of the motions; that of `validate` has no speed that grazes zero, where a sign is a matter of luck.
SEEDS = {"unloaded": 1, "validate": 5}
#: Noise of each quantity, SI: sensors of ordinary quality.
NOISE = {
    "joint_position": 2e-5,
    "joint_velocity": 5e-4,
    "motor_position": 1e-3,
    "motor_velocity": 2e-2,
    "piston_position": 1e-5,
    "head_pressure": 2e3,
    "rod_pressure": 2e3,
    "cylinder_force": 8.0,
    "external_force": 2.0,
    "joint_effort": 0.8,
    "motor_effort": 0.02,
    "oil_temperature": 0.05,
}
PINS = {
    "type": "pins", "base_pin": [-0.35, 0.2], "base_pivot": [0.1, 0.1], "rod_pin": [0.1, 0.25],
    "link_pivot": [0.2, 0.4], "retracted": 0.2,
}  # fmt: skip
BUCKET = {
    "type": "four_bar", "base_pin": [-1.5, 0.3], "base_pivot": [0.0, 0.0], "rocker_pivot": [-0.4, 0.05],
    "coupler_pin": [-0.05, 0.3], "link_pivot": [0.0, 0.0], "rod_arm": 0.48, "coupler_arm": 0.45, "arms_angle": 0.1,
    "coupler": 0.42, "side": "left", "retracted": 0.85,
}  # fmt: skip
LINKAGES: dict[str, dict[str, Any]] = {
    "three_pin": {"type": "three_pin", "a": 0.45, "b": 0.16, "offset": 1.7, "retracted": 0.37},
    "pins": PINS,
    "four_bar": BUCKET,
    "rack": {"type": "rack", "radius": 0.12, "zero": -1.0},
    "direct": {"type": "direct"},
    "polynomial": {"type": "polynomial", "coefficients": [0.16, 0.15, -0.02, 0.01]},
}
UNITS = {
    "piston_position": "mm", "head_pressure": "bar", "rod_pressure": "bar", "cylinder_force": "kN",
    "external_force": "N", "motor_position": "rad", "motor_velocity": "rpm", "motor_effort": "N m",
    "oil_temperature": "degC", "supply_pressure": "bar", "tank_pressure": "bar", "base_roll": "deg",
    "base_pitch": "deg",
}  # fmt: skip
BOTH = ("joint_position", "piston_position", "head_pressure", "rod_pressure")
DRIVEN = ("joint_position", "joint_effort")
MOTOR = ("motor_position", "motor_effort")


@dataclass(frozen=True)
class Axis:
    """One joint of a case: what drives it, what is measured of it, keys that differ."""

    channels: tuple[str, ...]
    linkage: str | None = None
    cylinder: dict[str, Any] = field(default_factory=dict)
    drive: dict[str, Any] | None = None
    type: str = "revolute"
    channel: dict[str, Any] = field(default_factory=dict)  # further keys of each channel


@dataclass(frozen=True)
class Case:
    """A machine, and what its report has to say."""

    axes: tuple[Axis, ...]
    machine: dict[str, Any] = field(default_factory=dict)
    further: tuple[str, ...] = ()  # channels of the machine
    names: tuple[str, ...] = ()  # of the last joint's drive parameters, if they matter
    roles: tuple[str, ...] = ("train", "repeat", "validate")


CASES: dict[str, Case] = {
    **{
        name: Case(
            (Axis(BOTH, name, type="prismatic" if name == "direct" else "revolute"),),
            roles=("unloaded", "train", "repeat", "validate"),
        )
        for name in LINKAGES
    },
    "optional_keys": Case(
        (Axis(BOTH, "three_pin", {"damping": 0.0}, channel={"noise_std": 0.1, "resolution": 0.0}),),
        {"hydraulics": {"supply_pressure": 21e6, "tank_pressure": 3e5, "pump_flow": 6e-4}, "simulation": {"speed": 2}},
        ("oil_temperature", "supply_pressure", "tank_pressure", "base_roll", "base_pitch"),
    ),
    "moving_mass": Case((Axis(BOTH, "three_pin", {"moving_mass": 6.0}),), names=("K", "f_c", "f_v", "f_s")),
    "piston_only": Case((Axis(BOTH[1:], "three_pin"),)),
    "joint_only": Case((Axis(("joint_position", *BOTH[2:]), "pins"),)),
    "cylinder_force": Case((Axis(("joint_position", "cylinder_force"), "four_bar"),)),
    "effort_at_a_cylinder": Case((Axis(DRIVEN, "rack"),)),
    "vented": Case((Axis(("joint_position", "head_pressure"), "direct", {"vented": "rod"}, type="prismatic"),)),
    "vented_head": Case((Axis(("joint_position", "rod_pressure"), "three_pin", {"vented": "head"}),)),
    "external_force": Case((Axis((*BOTH, "external_force"), "three_pin"),)),
    "velocity_at_a_cylinder": Case((Axis((*BOTH, "joint_velocity"), "pins"),)),
    "direct_drive": Case((Axis(DRIVEN), Axis(DRIVEN)), names=("J", "f_c", "f_v")),
    "sliding_drive": Case((Axis(DRIVEN, type="prismatic", drive={"offset": True}),), names=("f_c", "f_v", "f_0")),
    "offset": Case((Axis(DRIVEN, drive={"offset": True}),), names=("f_c", "f_v", "f_0")),
    "motor": Case((Axis(MOTOR, drive={"ratio": -40.0, "offset": True}),), names=("f_c", "f_v", "f_0")),
    "motor_velocity": Case((Axis((*MOTOR, "motor_velocity"), drive={"ratio": 40.0}),)),
    "coupled": Case(
        (
            Axis((*MOTOR, "motor_velocity"), drive={"ratio": 45.0, "offset": True}),
            Axis((*MOTOR, "motor_velocity"), drive={"ratio": 32.0, "coupled": [{"joint": "joint1", "ratio": 16.0}]}),
        )
    ),
    "link_side": Case(
        (
            Axis((*DRIVEN, "joint_velocity"), drive={"effort": "link_side"}),
            Axis((*DRIVEN, "joint_velocity"), drive={"effort": "link_side", "offset": True, "ratio": 100.0}),
        ),
        names=("f_c", "f_v", "f_0"),
    ),
    "modified": Case((Axis(DRIVEN), Axis(DRIVEN)), {"convention": "modified"}),
    "modified_cylinders": Case(
        (Axis(BOTH, "pins"), Axis(BOTH, "direct", type="prismatic")), {"convention": "modified"}
    ),
    "mixed": Case((Axis(BOTH, "four_bar"), Axis((*DRIVEN, "joint_velocity"), drive={"offset": True}))),
}
#: Searched at the two other cut-offs of the filter as well, which is the same search twice more, and identified without
#: the loop, too; of all others that is what the loop's report calls the errors before.
FULLY = ("pins", "coupled", "mixed")


def machine_of(case: Case) -> Machine:
    """The machine file of a case."""
    joints, channels = [], []
    for number, axis in enumerate(case.axes, start=1):
        name, straight = f"joint{number}", axis.type == "prismatic"
        position, effort = ("m", "N") if straight else ("rad", "N m")
        twist = np.pi / 2 if any(a.type == "prismatic" for a in case.axes) else 0.0
        own = {**UNITS, "joint_position": position, "joint_velocity": f"{position}/s", "joint_effort": effort}
        joint: dict[str, Any] = {
            "name": name,
            "type": axis.type,
            "dh": {
                "a": 0.8,
                "alpha": twist,
                "d": 0.1,
                "theta": 0.0,
            },
            "limits": {"position": [0.05, 0.35] if straight else [-0.55, 0.55], "velocity": 1.0, "acceleration": 4.0},
            "drive": axis.drive,
        }
        if axis.linkage is not None:
            size = {"bore": 0.08, "rod": 0.045, "stroke": 0.6, "damping": 150.0}
            joint["cylinder"] = {**size, **axis.cylinder, "linkage": LINKAGES[axis.linkage]}
        joints.append(joint)
        for quantity in axis.channels:
            channel = {"name": f"{name}.{quantity}", "quantity": quantity, "joint": name, "unit": own[quantity]}
            channels.append({**channel, **axis.channel})
    channels += [{"name": quantity, "quantity": quantity, "unit": UNITS[quantity]} for quantity in case.further]
    head = {"schema": "hilfit/machine/1", "name": "options", "rate_hz": 50.0, "gravity": [0.0, -9.81, 0.0]}
    return parse_machine(yaml.safe_dump({**head, **case.machine, "joints": joints, "channels": channels}))


OFFSET = 3.0  # N m (N) that every effort with a zero of its own reads too much


def efforts_of(machine: Machine, motion: Motion) -> np.ndarray:
    """Drive efforts (N, n) of an arm: piston forces, or joint efforts with the zero of their sensor."""
    arm = truth(len(machine.joints))
    # A gear's friction is some newton metres; that of a cylinder some ten newtons.
    arm = replace(arm, drive=arm.drive * np.where([j.cylinder is None for j in machine.joints], 0.1, 1.0)[:, None])
    total = force(machine, arm, motion)
    for j, joint in enumerate(machine.joints):
        if joint.cylinder is not None and joint.cylinder.moving_mass is not None:
            total[:, j] += (joint.cylinder.moving_mass - arm.drive[j, 0]) * motion.a[:, j]
        if joint.drive is not None and joint.drive.offset:
            total[:, j] += OFFSET
    return total


def readings(machine: Machine, motion: Motion, effort: np.ndarray, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """What all channels read, SI."""
    R, t, values = machine.ratios, motion.t, {}
    motor_efforts = np.linalg.solve(R.T, effort.T).T
    for channel in machine.channels:
        quantity = channel.quantity
        if channel.joint is None:
            still = {"oil_temperature": 300.0 + 0.1 * t, "supply_pressure": 2e7, "tank_pressure": 3e5}
            ideal = still.get(quantity, 0.0) + 1e-6 * rng.normal(size=len(t))
        else:
            j = [joint.name for joint in machine.joints].index(channel.joint)
            joint = machine.joints[j]
            outside = np.zeros_like(t)
            if machine.channel("external_force", joint.name) is not None:
                outside = 300.0 * np.sin(0.7 * t)  # against extension: more pressure is needed
            ideals: dict[str, Callable[[], np.ndarray]] = {
                "joint_position": lambda j=j: motion.q[:, j],
                "joint_velocity": lambda j=j: motion.qd[:, j],
                "piston_position": lambda j=j: motion.x[:, j],
                "cylinder_force": lambda j=j: effort[:, j],
                "external_force": lambda outside=outside: outside,
                "joint_effort": lambda j=j: effort[:, j] * motion.r[:, j],
                "motor_position": lambda j=j: motion.q @ R[j],
                "motor_velocity": lambda j=j: motion.qd @ R[j],
                "motor_effort": lambda j=j: motor_efforts[:, j],
            }
            if quantity in ideals:
                ideal = ideals[quantity]()
            else:
                assert joint.cylinder is not None
                a1, a2, vented = joint.cylinder.head_area, joint.cylinder.rod_area, joint.cylinder.vented
                back = np.zeros_like(t) if vented == "rod" else 6e5 + 2e6 * motion.v[:, j]
                pushed = effort[:, j] + outside
                if quantity == "head_pressure":
                    ideal = (pushed + back * a2) / a1
                else:
                    ideal = -pushed / a2 if vented == "head" else back
        values[channel.name] = ideal + NOISE.get(quantity, 0.0) * rng.normal(size=len(t))
    return values


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Files of a case, made when first asked for."""
    made: dict[str, Path] = {}

    def files(name: str) -> Path:
        if name not in made:
            folder = made[name] = tmp_path_factory.mktemp(name)
            machine = machine_of(CASES[name])
            (folder / "machine.yaml").write_text(machine_to_yaml(machine), encoding="utf-8")
            for number, role in enumerate(CASES[name].roles):
                motion = make_motion(machine, role, SEEDS.get(role, 2), SECONDS)
                values = readings(machine, motion, efforts_of(machine, motion), np.random.default_rng(number))
                write_recording(folder / f"{role}.parquet", machine, role, motion.t, values)
        return made[name]

    return files


@pytest.mark.parametrize(("name", "loop"), [*((name, True) for name in CASES), *((name, False) for name in FULLY)])
def test_every_option_is_identified(
    name: str, loop: bool, recorded: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    case, folder = CASES[name], recorded(name)
    if name not in FULLY:
        monkeypatch.setattr(stages, "other_bands", lambda *_: ())
    pairs = tuple((role, folder / f"{role}.parquet") for role in case.roles)
    report = identify(Request(folder / "machine.yaml", pairs, tmp_path / "out", Options(loop=loop, bootstrap=2)))
    assert json.loads((tmp_path / "out" / "report.json").read_text(encoding="utf-8"))["machine"] == "options"
    assert (tmp_path / "out" / "report.html").stat().st_size > 1000
    machine = machine_of(case)
    motion = make_motion(machine, "validate", SEEDS["validate"], SECONDS)
    size = np.sqrt(np.mean((efforts_of(machine, motion) * motion.r) ** 2, axis=0))
    for number, (joint, errors) in enumerate(report["errors"].items()):
        # Nothing is missing here, so errors are those of the repeated motion and, at 20 s, of parameters known to a
        # fraction of a per cent of the effort; a wrong sign, unit or area is a hundred.
        for when in ("before", "after"):
            assert errors[when]["validate"] < 2.0 * errors["noise_floor"] + 0.003 * size[number], (joint, when)
    last = report["cylinders"][f"joint{len(case.axes)}"]["parameters"]
    if case.names:
        assert tuple(last) == case.names
    for entry in last.values():
        assert entry["unit"]
    if "f_0" in last and machine.joints[0].type == "revolute":
        assert abs(last["f_0"]["value"] - OFFSET) < max(5 * last["f_0"]["std"], 0.05)
