"""Random machines and their recordings, before anybody makes a mistake with them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.interpolate import CubicSpline

from benchmarks.attribution.recipe import draw_quality, largest
from daq.machine.machine_file import Machine, machine_to_yaml
from fitting.arrays import FloatArray
from sim_backends.machines import folding_arm, slewing_arm
from sim_backends.plant.cases import STEMS, CasePlan, plan_case, write_tables
from sim_backends.plant.truth import Truth
from sim_backends.undeclared import MISMATCH, OUTSIDE_MISMATCH, UNDECLARED, EffectSpec

#: Both position sensors at every joint; one of them; an arm of one joint.
Kind = Literal["both", "single", "one"]
#: Effects that a sound machine may have, without those that came later: the rigs of a seed stay the same.
_LATER = {"neighbour_inertia", "dented_rod", "return_line", "hanging_hose", *MISMATCH, *OUTSIDE_MISMATCH}
EFFECTS = sorted(set(UNDECLARED) - _LATER)
KINDS: tuple[Kind, ...] = ("both", "single", "one")
_SECONDS = 40.0
#: Share of the sound machines that have an effect of the catalogue in them.
_WITH_EFFECT = 0.5
#: Sizes of it, as shares of the largest plausible one.
_SIZES = (0.1, 0.7)


@dataclass(frozen=True)
class Rig:
    """A machine file and recordings: columns by stem of the file, in the units that the file declares."""

    kind: Kind
    machine: Machine
    tables: Mapping[str, Mapping[str, FloatArray]]
    effect: str | None = None

    @property
    def names(self) -> list[str]:
        """Names of the joints."""
        return [joint.name for joint in self.machine.joints]

    def with_column(self, stem: str, channel: str, values: FloatArray) -> Rig:
        """Put one column of one recording in place of another."""
        return replace(self, tables={**self.tables, stem: {**self.tables[stem], channel: values}})

    def write(self, folder: Path, machine: Machine | None = None) -> tuple[Path, list[tuple[str, Path]]]:
        """Write machine file and recordings to disk; return them with their roles."""
        assert set(next(iter(self.tables.values()))) == {"time", *(channel.name for channel in self.machine.channels)}
        files = write_tables(folder, self.machine, self.tables, ".csv")
        file = folder / "machine.yaml"
        if machine is not None:
            file.write_text(machine_to_yaml(machine), encoding="utf-8")
        return file, files


def make_rig(kind: Kind, seed: int, *, effect: bool = False, parked: bool = False) -> Rig:
    """Make a random machine and its recordings; with ``effect`` half of them have one of the catalogue.

    With ``parked`` some joints rest in the second half of every loaded recording.

    ``single`` has the joint's or the piston's sensor only, and no `unloaded` recording half of the time.
    """
    rng = np.random.default_rng([4711, KINDS.index(kind), seed])
    if kind == "one":
        machine, truth = _one_joint(int(rng.integers(2**31)))
        plan = plan_case((machine, truth), int(rng.integers(2**31)), _SECONDS)
    else:
        make = folding_arm if rng.random() < 0.5 else slewing_arm
        plan = plan_case(make(int(rng.integers(2**31))), int(rng.integers(2**31)), _SECONDS)
    quality = draw_quality(rng)
    if parked:
        plan = _parked(plan, np.random.default_rng([4712, seed]))
    specs, named = [], None
    if effect and rng.random() < _WITH_EFFECT:
        named, spec = _effect(plan, rng)
        specs = [spec]
    tables = {stem: plan.record(stem, specs, quality)[0] for stem in STEMS}
    rig = Rig(kind, plan.machine, tables, named)
    if kind == "both":
        return rig
    kept = "joint_position" if rng.random() < 0.5 else "piston_position"
    rig = _with_one_sensor(rig, kept)
    if kept == "joint_position" or rng.random() < 0.5:
        rig = replace(rig, tables={stem: table for stem, table in rig.tables.items() if stem != "unloaded"})
    return rig


def _parked(plan: CasePlan, rng: np.random.Generator) -> CasePlan:
    """Let the time of some joints (one at least) run out in the middle of each motion, smoothly."""
    joints = [joint.name for joint in plan.machine.joints]
    still = set(rng.choice(joints, int(rng.integers(1, len(joints) + 1)), replace=False))
    motions = {}
    for stem, motion in plan.motions.items():
        own = motion.time - motion.duration / 2
        slowed = 0.5 * (own - np.hypot(own, 0.5))
        slowed -= slowed[0]
        moved = [
            CubicSpline(motion.time, column)(slowed) if name in still and stem != "unloaded" else column
            for name, column in zip(motion.joints, motion.positions.T, strict=True)
        ]
        motions[stem] = replace(motion, positions=np.stack(moved, axis=1))
    motions["repeat"] = motions["train-1"]
    return replace(plan, motions=motions)


def with_lost_rows(rig: Rig, rng: np.random.Generator) -> Rig:
    """Drop single rows at random, from thirty to a fifth of each recording."""
    share = float(rng.choice([0.015, 0.05, 0.2]))
    tables = {}
    for stem, table in rig.tables.items():
        kept = rng.random(len(table["time"])) > share
        kept[[0, -1]] = True
        tables[stem] = {name: np.asarray(column)[kept] for name, column in table.items()}
    return replace(rig, tables=tables)


def _effect(plan: CasePlan, rng: np.random.Generator) -> tuple[str, EffectSpec]:
    while True:
        name = str(rng.choice(EFFECTS))
        joint = plan.machine.joints[int(rng.integers(len(plan.machine.joints)))].name
        size = float(rng.uniform(*_SIZES))
        where = None if UNDECLARED[name].base_wide else joint
        try:
            return name, EffectSpec(name, where, size * largest(name, plan, joint))
        except KeyError:
            continue


def _one_joint(seed: int) -> tuple[Machine, Truth]:
    machine, truth = folding_arm(seed)
    joint = machine.joints[0]
    channels = tuple(c for c in machine.channels if c.joint == joint.name)
    alone = machine.model_copy(update={"joints": (joint,), "channels": channels, "name": "boom"})
    return alone, Truth(truth.links[:1], {joint.name: truth.cylinders[joint.name]}, {}, truth.hydraulics)


def _with_one_sensor(rig: Rig, kept: str) -> Rig:
    dropped = {"joint_position": "piston_position", "piston_position": "joint_position"}[kept]
    channels = tuple(c for c in rig.machine.channels if c.quantity != dropped)
    names = {"time", *(c.name for c in channels)}
    return Rig(
        rig.kind,
        rig.machine.model_copy(update={"channels": channels}),
        {stem: {k: v for k, v in table.items() if k in names} for stem, table in rig.tables.items()},
        rig.effect,
    )
