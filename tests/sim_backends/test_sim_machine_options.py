"""What the simulated machine makes of the rarer parts of a machine file: simulated as declared, or refused clearly."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import yaml

from daq.errors import InputError
from daq.machine.machine_file import Drive, Machine, machine_to_yaml, parse_machine
from fitting.arm.linkage import piston_motion
from sim_backends import Plant, Truth, slewing_arm
from sim_backends.plant.arm import Arm, ArmDesign
from sim_backends.plant.truth import DriveTruth

PINS = {"type": "pins", "base_pin": [-0.35, 0.2], "base_pivot": [0.1, 0.1], "rod_pin": [0.1, 0.25],
        "link_pivot": [0.2, 0.4], "retracted": 0.2}  # fmt: skip
BUCKET = {"type": "four_bar", "base_pin": [-1.5, 0.3], "base_pivot": [0, 0], "rocker_pivot": [-0.4, 0.05],
          "coupler_pin": [-0.05, 0.3], "link_pivot": [0, 0], "rod_arm": 0.48, "coupler_arm": 0.45, "arms_angle": 0.1,
          "coupler": 0.42, "side": "left", "retracted": 0.85}  # fmt: skip


def changed(**joint: Any) -> tuple[Machine, Truth]:
    """The slewing arm with keys of its last joint with a cylinder changed."""
    machine, truth = slewing_arm(0)
    tree = yaml.safe_load(machine_to_yaml(machine))
    own = [j for j in tree["joints"] if j.get("cylinder")][-1]
    own.update(joint)
    return parse_machine(yaml.safe_dump(tree)), truth


@pytest.mark.parametrize("linkage", [PINS, BUCKET], ids=["pins", "four_bar"])
def test_pistons_move_as_declared(linkage: dict[str, Any]) -> None:
    machine, truth = changed(
        cylinder={"bore": 0.08, "rod": 0.045, "stroke": 0.6, "linkage": linkage},
        limits={"position": [-0.5, 0.5], "velocity": 0.5, "acceleration": 1.0},
        dh={"a": 0.8, "alpha": 0.0, "d": 0.0, "theta": 0.0},
    )
    number = max(i for i, joint in enumerate(machine.joints) if joint.cylinder is not None)
    cylinder = machine.joints[number].cylinder
    assert cylinder is not None
    rng = np.random.default_rng(1)
    q, qd, qdd = rng.uniform(-0.5, 0.5, (3, 20, len(machine.joints)))
    x, v, a, _ = Arm(ArmDesign(machine, truth)).piston(q, qd, qdd)
    expected = piston_motion(cylinder.linkage, q[:, number], qd[:, number], qdd[:, number])
    for found, own in zip((x, v, a), expected, strict=True):
        np.testing.assert_allclose(found[:, number], own, atol=1e-5)


def plant(machine: Machine, truth: Truth) -> Plant:
    return Plant(machine, truth, rng=np.random.default_rng(0))


def test_what_is_not_simulated_is_refused() -> None:
    machine, truth = slewing_arm(0)
    tree = yaml.safe_load(machine_to_yaml(machine))
    joint = next(j["name"] for j in tree["joints"] if j.get("cylinder"))
    speed = {"name": "speed", "quantity": "joint_velocity", "joint": joint, "unit": "rad/s"}
    more = parse_machine(yaml.safe_dump({**tree, "channels": [*tree["channels"], speed]}))
    with pytest.raises(InputError, match="channel speed: the simulated machine has no joint_velocity; leave it out"):
        plant(more, truth)
    number = next(i for i, j in enumerate(machine.joints) if j.cylinder is not None)
    cylinder = machine.joints[number].cylinder
    assert cylinder is not None
    vented = machine.joints[number].model_copy(update={"cylinder": cylinder.model_copy(update={"vented": "rod"})})
    joints = (*machine.joints[:number], vented, *machine.joints[number + 1 :])
    with pytest.raises(InputError, match="no vented chambers"):
        plant(machine.model_copy(update={"joints": joints}), truth)
    behind = machine.joints[number].model_copy(update={"cylinder": None, "drive": Drive(effort="link_side")})
    joints = (*machine.joints[:number], behind, *machine.joints[number + 1 :])
    driven = replace(truth, drives={behind.name: DriveTruth(f_c=1.0, f_v=1.0, inertia=0.1)})
    with pytest.raises(InputError, match="measured before the gear; leave coupled: and effort: out"):
        plant(machine.model_copy(update={"joints": joints}), driven)
