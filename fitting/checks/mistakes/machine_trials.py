"""Trials of the machine file: gravity, lengths and axes of links, pins; and the effects that resemble them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from daq.machine.linkages import ThreePin
from daq.machine.machine_file import Machine
from fitting.arm.linkage import parameter_names
from fitting.checks.findings import worded
from fitting.checks.mistakes.hypothesis import Build, Hypothesis
from fitting.checks.mistakes.motion_trials import mapped
from fitting.checks.mistakes.physical import Trial


def changed_joint(machine: Machine, number: int, part: str, values: Mapping[str, float]) -> Machine:
    """Return the machine with numbers of a joint's ``dh`` or ``linkage`` changed, unvalidated."""
    joint = machine.joints[number]
    if part == "dh":
        new = joint.model_copy(update={"dh": joint.dh.model_copy(update=dict(values))})
    else:
        assert joint.cylinder is not None
        linkage = joint.cylinder.linkage.model_copy(update=dict(values))
        new = joint.model_copy(update={"cylinder": joint.cylinder.model_copy(update={"linkage": linkage})})
    joints = tuple(new if k == number else own for k, own in enumerate(machine.joints))
    return machine.model_copy(update={"joints": joints})


def on_machine(change: Callable[[Machine], Machine]) -> Build:
    return lambda trial, targets: (trial.with_machine(change(trial.machine)), targets)


def gravity(trial: Trial) -> Iterator[Hypothesis]:
    machine = trial.machine
    g = np.array(machine.gravity)
    size = float(np.linalg.norm(g)) or 9.81
    directions = {tuple(np.round(-g, 6))} | {tuple(s * 9.81 * np.eye(3)[k]) for k in range(3) for s in (1.0, -1.0)}
    for direction in sorted(directions):
        if np.linalg.norm(np.array(direction) - g) < 0.2 * size:
            continue
        turned = float(np.dot(direction, g)) < -0.9 * size * float(np.linalg.norm(direction))
        shown = "[" + ", ".join(f"{v:g}" for v in direction) + "]"
        yield Hypothesis(
            *worded("gravity/turned" if turned else "gravity/other", shown=shown), (),
            on_machine(lambda m, d=direction: m.model_copy(update={"gravity": d})),  # type: ignore[misc]
            key=("gravity",), price=1.0,
        )  # fmt: skip


#: Factors by which a sign, a decimal point or a unit is off.
SLIPS = (-1.0, 10.0, 0.1, 100.0, 0.01, 1e3, 1e-3)
#: m that a link is long: another length is not what was meant.
LONG = (0.005, 20.0)


def lengths(trial: Trial) -> Iterator[Hypothesis]:
    machine = trial.machine
    for j, joint in enumerate(machine.joints):
        for name in ("a", "d"):
            value = float(getattr(joint.dh, name))
            for factor in (*SLIPS, 0.5, 2.0):
                if LONG[0] < abs(factor * value) < LONG[1]:
                    yield Hypothesis(
                        *worded("length", name=name, new=factor * value, old=value), (j,),
                        on_machine(lambda m, j=j, k=name, v=factor * value: changed_joint(m, j, "dh", {k: v})),  # type: ignore[misc]
                        key=("joints", j, "dh", name), factor=factor, price=1.6 if factor in (10.0, 0.1, -1.0) else 1.9,
                        slip=factor in SLIPS,
                    )  # fmt: skip
        alphas = {-joint.dh.alpha, joint.dh.alpha + np.pi / 2, joint.dh.alpha - np.pi / 2} - {joint.dh.alpha}
        for alpha in sorted(alphas):
            yield Hypothesis(
                *worded("axis", new=alpha, old=joint.dh.alpha), (j,),
                on_machine(lambda m, j=j, v=alpha: changed_joint(m, j, "dh", {"alpha": v})),  # type: ignore[misc]
                key=("joints", j, "dh", "alpha"), price=1.8, slip=True,
            )  # fmt: skip
        if joint.cylinder is None or not isinstance(joint.cylinder.linkage, ThreePin):
            continue
        linkage = joint.cylinder.linkage
        for name in parameter_names(linkage):
            value = float(getattr(linkage, name))
            angles = (-value, value + np.pi / 2, value - np.pi / 2, value + np.pi, value + 0.3, value - 0.3)
            tried = angles if name == "offset" else tuple(f * value for f in (0.1, 0.5, 0.75, 1.33, 2.0, 10.0))
            if name == "retracted" and trial.positions[j] == "joint_position":
                continue  # does not enter the lever arm
            for new in tried:
                yield Hypothesis(
                    *worded("linkage/rad" if name == "offset" else "linkage/m", name=name, new=new, old=value), (j,),
                    on_machine(lambda m, j=j, k=name, v=new: changed_joint(m, j, "linkage", {k: v})),  # type: ignore[misc]
                    key=("joints", j, "cylinder", "linkage", name), factor=new / value, price=1.7,
                )  # fmt: skip


#: rad by which a base may stand askew, and a joint's zero be off, as effects of the catalogue.
TILTS, ZEROS = (-0.15, -0.08, -0.03, 0.03, 0.08, 0.15), (-0.1, -0.05, 0.05, 0.1)


def effects(trial: Trial) -> Iterator[Hypothesis]:
    """Try the catalogue's effects that resemble mistakes: taken back without a report; they accuse nobody."""
    machine = trial.machine
    g = np.array(machine.gravity)
    for axis in np.eye(3):
        if np.linalg.norm(np.cross(axis, g)) < 0.1 * np.linalg.norm(g):
            continue
        for angle in TILTS:
            tilted = tuple(float(v) for v in Rotation.from_rotvec(angle * axis).apply(g))
            yield Hypothesis(
                "", "", "", (), on_machine(lambda m, t=tilted: m.model_copy(update={"gravity": t})), price=0.5  # type: ignore[misc]
            )  # fmt: skip
    for j in range(len(machine.joints)):
        if trial.positions[j] == "joint_position":
            for angle in ZEROS:
                yield Hypothesis("", "", "", (j,), mapped(("joint_position", j), 1.0, angle), price=0.5)
