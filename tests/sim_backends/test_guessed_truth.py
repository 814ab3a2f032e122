"""Plant parameters for a machine file that nobody weighed: they can exist, fit its geometry, and make it run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import typer
import yaml
from typer.testing import CliRunner

import sim_backends.machines
from daq.machine.machine_file import Machine, machine_to_yaml, parse_machine
from sim_backends import SensorQuality, excavator_front, folding_arm, random_motion, record, slewing_arm
from sim_backends import telescopic_crane as telescope
from sim_backends.cli import register
from sim_backends.plant.guessed_truth import guessed_truth, guessed_truth_yaml
from sim_backends.plant.truth import Truth, load_truth

FILE = str(Path(sim_backends.machines.__file__).with_name("folding_arm.yaml"))
LIMITS = {"position": [-0.5, 0.5], "velocity": 0.5, "acceleration": 1.0}
APP = typer.Typer()
register(APP)
APP.command("other")(lambda: None)  # with one command only, typer takes no command name


def central(link: list[float]) -> np.ndarray:
    """Inertia tensor about the centre of mass, by the parallel axis theorem."""
    mass, *rest = link
    centre = np.array(rest[:3]) / mass
    about = np.zeros((3, 3))
    about[np.triu_indices(3)] = rest[3:]
    about = about + np.triu(about, 1).T
    return about - mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))


@pytest.mark.parametrize("arm", [folding_arm, slewing_arm, excavator_front, telescope])
def test_guessed_links_can_exist_and_lie_between_their_joints(arm) -> None:
    machine, _ = arm(0)
    for joint, link in zip(machine.joints, guessed_truth(machine).links, strict=True):
        moments = np.linalg.eigvalsh(central(link.as_list()))
        assert moments[0] > 0 and moments[0] + moments[1] > moments[2]
        slide = sum(joint.limits.position) / 2 if joint.type == "prismatic" else 0.0
        assert np.linalg.norm(link.moment) / link.mass < 0.5 * np.hypot(joint.dh.a, joint.dh.d + slide) * 1.1 + 0.15


def planar(convention: str, rows: list[float]) -> Machine:
    """Three parallel axes, driven directly; ``a`` of each row."""
    joints = [
        {"name": f"j{k}", "dh": {"a": a, "alpha": 0.0, "d": 0.0, "theta": 0.0}, "limits": LIMITS}
        for k, a in enumerate(rows)
    ]
    channels = [
        {"name": f"j{k}.{what}", "quantity": f"joint_{what}", "joint": f"j{k}", "unit": unit}
        for k in range(len(rows))
        for what, unit in (("position", "rad"), ("effort", "N m"))
    ]
    content = {"schema": "hilfit/machine/1", "name": "planar", "rate_hz": 50, "gravity": [0.0, -9.81, 0.0]}
    return parse_machine(yaml.safe_dump(content | {"convention": convention, "joints": joints, "channels": channels}))


def test_a_link_reaches_back_in_the_standard_convention_and_forward_in_the_modified_one() -> None:
    standard = guessed_truth(planar("standard", [2.0, 1.0, 0.5]))
    modified = guessed_truth(planar("modified", [0.0, 2.0, 1.0]))
    for truth, sign in ((standard, -1.0), (modified, 1.0)):
        centres = [link.moment[0] / link.mass for link in truth.links[:2]]
        assert centres == pytest.approx([sign * 1.0, sign * 0.5], rel=0.1, abs=0.1)
    assert all(drive.f_c > 0 and drive.inertia > 0 for drive in standard.drives.values())


@pytest.mark.parametrize("arm", [folding_arm, slewing_arm])
def test_an_arm_with_guessed_weights_moves_within_its_supply_pressure(arm) -> None:
    machine, _ = arm(1)
    truth = Truth.from_dict(yaml.safe_load(guessed_truth_yaml(machine)))
    motion = random_motion(machine, np.random.default_rng(0), 8.0)
    table = record(machine, truth, motion, quality=SensorQuality.perfect(), rng=np.random.default_rng(0))
    pressures = np.array([column for name, column in table.items() if "pressure" in name])
    assert pressures.min() > 1.0e5 and 10.0e5 < pressures.max() < truth.hydraulics.supply


def test_supply_and_tank_are_those_of_the_machine_file() -> None:
    tree = yaml.safe_load(machine_to_yaml(folding_arm(0)[0]))
    tree["hydraulics"] = {"supply_pressure": 18.0e6, "tank_pressure": 0.5e6}
    found = guessed_truth(parse_machine(yaml.safe_dump(tree))).hydraulics
    assert (found.supply, found.tank) == (18.0e6, 0.5e6)


def test_the_command_writes_a_file_that_it_reads_and_never_over_another(tmp_path: Path) -> None:
    path = tmp_path / "truth.yaml"
    result = CliRunner().invoke(APP, ["simulate", FILE, "--guess-truth", str(path)])
    assert result.exit_code == 0 and str(path) in result.stdout
    assert set(load_truth(path).cylinders) == {f"joint{k}" for k in range(1, 7)}
    before = path.read_bytes()
    again = CliRunner().invoke(APP, ["simulate", FILE, "--guess-truth", str(path)])
    assert again.exit_code == 2 and "is there already" in again.stderr and again.stderr.count("\n") == 1
    assert path.read_bytes() == before
