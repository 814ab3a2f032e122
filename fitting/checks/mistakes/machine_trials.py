"""Trials of the machine file: gravity, lengths and axes of links, pins, bore and rod; and the effects like them."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import scipy

from daq.machine.linkages import ThreePin
from daq.machine.machine_file import Machine
from fitting.arm.linkage import cylinder_of, parameter_names
from fitting.checks.findings import worded
from fitting.checks.mistakes.channel_trials import mapped, weighted
from fitting.checks.mistakes.hypothesis import Build, Hypothesis
from fitting.checks.mistakes.physical import Trial
from fitting.checks.mistakes.samples import POSITIONS

#: Factors by which a sign, a decimal point or a unit is off.
SLIPS = (-1.0, 10.0, 0.1, 100.0, 0.01, 1e3, 1e-3)
#: m that a link is long: another length is not what was meant.
LONG = (0.005, 20.0)
#: Factors by which a length of the pins, and a bore or rod, is off.
PINS, SIZES = (0.1, 0.5, 0.75, 1.33, 2.0, 10.0), (0.1, 0.5, 0.63, 0.7, 0.794, 1.25, 1.4, 1.6, 2.0, 10.0)
#: rad by which a base may be askew, and a joint's zero be off, as effects of the catalogue.
TILTS, ZEROS = (-0.15, -0.08, -0.03, 0.03, 0.08, 0.15), (-0.1, -0.05, 0.05, 0.1)


def changed_joint(machine: Machine, number: int, part: str, key: str, value: float) -> Machine:
    """Return the machine with a number of one joint changed, unvalidated.

    Parameters
    ----------
    number : of the joint
    part : ``dh`` or ``linkage``
    key, value : of the number there, m or rad
    """
    joint = machine.joints[number]
    if part == "dh":
        new = joint.model_copy(update={"dh": joint.dh.model_copy(update={key: value})})
    else:
        cylinder = cylinder_of(joint)
        linkage = cylinder.linkage.model_copy(update={key: value})
        new = joint.model_copy(update={"cylinder": cylinder.model_copy(update={"linkage": linkage})})
    joints = tuple(new if k == number else own for k, own in enumerate(machine.joints))
    return machine.model_copy(update={"joints": joints})


def _on_machine(change: Callable[[Machine], Machine]) -> Build:
    return lambda trial, targets: (trial.with_machine(change(trial.machine)), targets)


def with_joint(number: int, part: str, key: str, value: float) -> Build:
    """Build a trial with the machine of :func:`changed_joint`."""
    return _on_machine(lambda machine: changed_joint(machine, number, part, key, value))


def _with_gravity(gravity: tuple[float, ...]) -> Build:
    return _on_machine(lambda machine: machine.model_copy(update={"gravity": gravity}))


def gravity(trial: Trial) -> Iterator[Hypothesis]:
    """Try gravity along every other axis, and turned over."""
    g = np.array(trial.machine.gravity)
    size = float(np.linalg.norm(g)) or 9.81
    directions = {tuple(np.round(-g, 6))} | {tuple(s * 9.81 * np.eye(3)[k]) for k in range(3) for s in (1.0, -1.0)}
    for direction in sorted(directions):
        if np.linalg.norm(np.array(direction) - g) < 0.2 * size:
            continue
        turned = float(np.dot(direction, g)) < -0.9 * size * float(np.linalg.norm(direction))
        shown = "[" + ", ".join(f"{v:g}" for v in direction) + "]"
        texts = worded("gravity/turned" if turned else "gravity/other", shown=shown)
        yield Hypothesis(*texts, (), _with_gravity(direction), key=("gravity",), price=1.0)


def lengths(trial: Trial) -> Iterator[Hypothesis]:
    """Try other lengths, axes and pins of each link."""
    for j, joint in enumerate(trial.machine.joints):
        for name in ("a", "d"):
            value = float(getattr(joint.dh, name))
            for factor in (*SLIPS, 0.5, 2.0):
                new, price = factor * value, 1.6 if factor in (10.0, 0.1, -1.0) else 1.9
                if LONG[0] < abs(new) < LONG[1]:
                    texts, key = worded("length", name=name, new=new, old=value), ("joints", j, "dh", name)
                    build, slip = with_joint(j, "dh", name, new), factor in SLIPS
                    yield Hypothesis(*texts, (j,), build, key=key, factor=factor, price=price, slip=slip)
        old = joint.dh.alpha
        for alpha in sorted({-old, old + np.pi / 2, old - np.pi / 2} - {old}):
            texts, build = worded("axis", new=alpha, old=old), with_joint(j, "dh", "alpha", alpha)
            yield Hypothesis(*texts, (j,), build, key=("joints", j, "dh", "alpha"), price=1.8, slip=True)
        # Two sensors that agree have the pins right between them.
        both = all(trial.samples.get(quantity, j) is not None for quantity in POSITIONS)
        if joint.cylinder is not None and isinstance(joint.cylinder.linkage, ThreePin) and not both:
            yield from _pins(trial, j, joint.cylinder.linkage)


def _pins(trial: Trial, number: int, linkage: ThreePin) -> Iterator[Hypothesis]:
    """Try other lengths and another offset of a joint's pins."""
    for name in parameter_names(linkage):
        value = float(getattr(linkage, name))
        angles = (-value, value + np.pi / 2, value - np.pi / 2, value + np.pi, value + 0.3, value - 0.3)
        if name == "retracted" and trial.positions[number] == "joint_position":
            continue  # does not enter the lever arm
        for new in angles if name == "offset" else tuple(f * value for f in PINS):
            texts = worded("linkage/rad" if name == "offset" else "linkage/m", name=name, new=new, old=value)
            key, build = ("joints", number, "cylinder", "linkage", name), with_joint(number, "linkage", name, new)
            yield Hypothesis(*texts, (number,), build, key=key, factor=new / value, price=1.7)


def sizes(trial: Trial) -> Iterator[Hypothesis]:
    """Try another bore or rod: both areas estimated, with all other joints as the measure."""
    for j, joint in enumerate(trial.machine.joints):
        block = trial.blocks[j]
        if block is None or joint.cylinder is None or f"head_pressure{j}" not in block.side.names:
            continue
        for factor in SIZES:
            for code in ("bore", "rod"):
                old = {"bore": joint.cylinder.bore, "rod": joint.cylinder.rod}
                new = {**old, code: factor * old[code]}
                if 0 < new["rod"] < new["bore"]:
                    areas = np.pi / 4 * new["bore"] ** 2, np.pi / 4 * (new["bore"] ** 2 - new["rod"] ** 2)
                    texts = worded(code, part=code, new=1e3 * new[code], old=1e3 * old[code])
                    key = ("joints", j, "cylinder", code)
                    yield Hypothesis(*texts, (j,), _with_areas(j, *areas), key=key, factor=factor, price=1.5)


def _with_areas(number: int, head: float, rod: float) -> Build:
    areas = {f"head_pressure{number}": head, f"rod_pressure{number}": -rod}
    return weighted(number, lambda own: {**own, **areas})


def effects(trial: Trial) -> Iterator[Hypothesis]:
    """Try the catalogue's effects that resemble mistakes: taken back without a report; they accuse nobody."""
    machine = trial.machine
    g = np.array(machine.gravity)
    for axis in np.eye(3):
        for angle in () if np.linalg.norm(np.cross(axis, g)) < 0.1 * np.linalg.norm(g) else TILTS:
            tilted = tuple(float(v) for v in scipy.spatial.transform.Rotation.from_rotvec(angle * axis).apply(g))
            yield Hypothesis("", "", "", (), _with_gravity(tilted), price=0.5)
    for j in range(len(machine.joints)):
        for angle in ZEROS if trial.positions[j] == "joint_position" else ():
            yield Hypothesis("", "", "", (j,), mapped(("joint_position", j), 1.0, angle), price=0.5)
