"""The excavator's front and the crane with a telescope: their sizes and pressures, and the fit's dynamics of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import yaml

from daq.machine.machine_file import machine_to_yaml
from daq.machine.plausible import unusual_values
from fitting.arm.base_parameters import base_regressor, reduce_parameters
from fitting.arm.linkage import lever_arm
from sim_backends import SensorQuality, excavator_front, random_motion, record, telescopic_crane
from sim_backends.plant.arm import Arm, ArmDesign

HEAVY = [excavator_front, telescopic_crane]


@pytest.mark.slow
@pytest.mark.parametrize("arm", HEAVY)
def test_sizes_are_those_of_such_machines_and_no_number_looks_slipped(arm) -> None:
    totals = []
    for seed in range(25):
        machine, truth = arm(seed)
        totals.append(sum(link.mass for link in truth.links))
        assert all(150 < link.mass < 5000 for link in truth.links)
        assert list(unusual_values(yaml.safe_load(machine_to_yaml(machine)))) == []
        for joint in machine.joints:
            q = np.linspace(*joint.limits.position, 101)
            x = joint.cylinder.linkage.piston_position(q)
            assert x.min() > 0.01 and x.max() < joint.cylinder.stroke - 0.01
            assert 0.05 < joint.cylinder.bore < 0.25 and 0.3 < joint.cylinder.stroke < 1.8
            # 0.4 to 0.8 bar over the bore; the telescope's slide pads rub, too
            friction = truth.cylinders[joint.name].f_c / joint.cylinder.head_area
            assert 4.0e4 < friction < (6.0e5 if joint.type == "prismatic" else 8.0e4)
    assert max(totals) > 2 * min(totals)
    assert arm(3)[1] == arm(3)[1] != arm(4)[1]


@pytest.mark.slow
@pytest.mark.parametrize("arm", HEAVY)
def test_what_carries_the_boom_is_under_some_hundred_bar_and_nothing_beyond_the_supply(arm) -> None:
    highest = []
    for seed in range(4):
        machine, truth = arm(seed)
        motion = random_motion(machine, np.random.default_rng(seed), 20.0)
        table = record(machine, truth, motion, quality=SensorQuality.perfect(), rng=np.random.default_rng(0))
        pressures = {name: column for name, column in table.items() if "pressure" in name}
        assert all(column.min() > 1.0e5 for column in pressures.values())
        assert max(column.max() for column in pressures.values()) < truth.hydraulics.supply
        highest.append(pressures["boom.head_pressure"].max())
    assert 50e5 < min(highest) < max(highest) < 300e5


@pytest.mark.parametrize("arm", HEAVY)
def test_the_fits_regressor_is_the_plants_dynamics(arm) -> None:
    """MuJoCo's inverse dynamics against the fit's base regressor times the true base parameters: slide included."""
    for seed in range(3):
        machine, truth = arm(seed)
        light = replace(truth, cylinders={n: replace(c, m=1e-9) for n, c in truth.cylinders.items()})
        limits = np.array([joint.limits.position for joint in machine.joints])
        rng = np.random.default_rng(seed)
        q = rng.uniform(limits[:, 0], limits[:, 1], (40, len(limits)))
        qd, qdd = rng.normal(0.0, 0.5, (2, *q.shape))
        base = reduce_parameters(machine)
        theta = base.from_standard(np.array([link.as_list() for link in truth.links]))
        effort = Arm(ArmDesign(machine, light)).effort(q, qd, qdd)
        found = base_regressor(machine, base, q, qd, qdd) @ theta
        np.testing.assert_allclose(found, effort, rtol=1e-9, atol=1e-7 * np.abs(effort).max())


@pytest.mark.parametrize("arm", HEAVY)
def test_levers_of_racks_slides_and_four_bars_are_those_of_the_fit(arm) -> None:
    machine, truth = arm(1)
    limits = np.array([joint.limits.position for joint in machine.joints])
    q = np.linspace(limits[:, 0], limits[:, 1], 60)[1:-1]
    _, _, _, lever = Arm(ArmDesign(machine, truth)).piston(q, np.zeros_like(q), np.zeros_like(q))
    for j, joint in enumerate(machine.joints):
        np.testing.assert_allclose(lever_arm(joint.cylinder.linkage, q[:, j]), lever[:, j], rtol=1e-6)
    if "stick" in [joint.name for joint in machine.joints]:
        stick, bucket = lever[:, 2], lever[:, 3]
        assert (stick < 0).all() and (bucket < 0).all()  # their cylinders pull the tool in as they extend
