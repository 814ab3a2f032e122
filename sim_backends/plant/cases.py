"""Whole cases for identification: a machine file, its recordings, and apart from them the truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

from daq.machine.machine_file import Machine, machine_to_yaml
from daq.recordings.recording import write_recording
from sim_backends.arrays import FloatArray
from sim_backends.machines import ARMS, ArmKind
from sim_backends.plant.motion import Motion, random_motion
from sim_backends.plant.plant import record_beside_ideal
from sim_backends.plant.truth import SensorQuality, Truth
from sim_backends.undeclared import EffectSpec, check_spec

Effects = Sequence[EffectSpec | tuple[str, str | None, float]]


#: The recordings of a case, by file stem; the role is what stands before the hyphen.
STEMS = ("unloaded", "train-1", "train-2", "repeat", "validate")


@dataclass(frozen=True)
class CasePlan:
    """A machine and its motions; recordings are made one by one, with whatever effects are asked for.

    ``repeat`` is the motion of ``train-1`` again. Noise and tracking errors depend on ``seed`` and the stem alone, so
    a recording with an effect differs from the same without it by that effect only.
    """

    machine: Machine
    truth: Truth
    seed: int
    motions: Mapping[str, Motion]

    def record(
        self, stem: str, undeclared: Sequence[EffectSpec] = (), quality: SensorQuality | None = None
    ) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
        """Record one motion, measured and ideal (see :func:`sim_backends.plant.plant.record_beside_ideal`)."""
        return record_beside_ideal(
            self.machine, self.truth, self.motions[stem], undeclared=undeclared, quality=quality,
            rng=np.random.default_rng([self.seed, 12, STEMS.index(stem)]),
            shapes=np.random.default_rng([self.seed, 13]),
        )  # fmt: skip


@dataclass(frozen=True)
class Case:
    """Recordings of one machine: SI tables by file stem (``unloaded``, ``train-1``, ``train-2``, ``repeat``,
    ``validate``), and the truth."""

    machine: Machine
    truth: Truth
    undeclared: tuple[EffectSpec, ...]
    recordings: Mapping[str, Mapping[str, FloatArray]]


def plan_case(arm: ArmKind | tuple[Machine, Truth], seed: int, seconds: float = 60.0) -> CasePlan:
    """Plan machine and motions of a case, before anything is recorded."""
    machine, truth = arm if isinstance(arm, tuple) else ARMS[arm](seed)
    rng = np.random.default_rng([seed, 11])
    motions: dict[str, Motion] = {"unloaded": random_motion(machine, rng, seconds, rods="unpinned")}
    for stem in ("train-1", "train-2", "validate"):
        motions[stem] = random_motion(machine, rng, seconds)
    motions["repeat"] = motions["train-1"]
    return CasePlan(machine, truth, seed, motions)


def simulate_case(
    arm: ArmKind | tuple[Machine, Truth],
    seed: int,
    undeclared: Effects = (),
    quality: SensorQuality | None = None,
    seconds: float = 60.0,
) -> Case:
    """Simulate the recordings of one case in memory.

    ``repeat`` is the motion of ``train-1`` again. The hidden shape of an effect is the same in all recordings, noise
    and tracking errors differ. The same arguments give the same numbers.
    """
    plan = plan_case(arm, seed, seconds)
    specs = tuple(check_spec(s if isinstance(s, EffectSpec) else EffectSpec(*s), plan.machine) for s in undeclared)
    recordings = {stem: plan.record(stem, specs, quality)[0] for stem in STEMS}
    return Case(plan.machine, plan.truth, specs, recordings)


def write_table(file: Path, machine: Machine, role: str, table: Mapping[str, FloatArray]) -> Path:
    """Write a table of the machine's channels and their time as a recording."""
    values = {name: column for name, column in table.items() if name != "time"}
    return write_recording(file, machine, role, table["time"], values)


def write_tables(
    folder: Path, machine: Machine, tables: Mapping[str, Mapping[str, FloatArray]], suffix: str = ".parquet"
) -> list[tuple[str, Path]]:
    """Write ``machine.yaml`` and a recording per table, by file stem; return roles and files of the recordings."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "machine.yaml").write_text(machine_to_yaml(machine), encoding="utf-8")
    roles = {stem: stem.partition("-")[0] for stem in tables}
    return [
        (roles[stem], write_table(folder / f"{stem}{suffix}", machine, roles[stem], table))
        for stem, table in tables.items()
    ]


def make_case(
    folder: str | Path,
    arm: ArmKind | tuple[Machine, Truth],
    seed: int = 0,
    undeclared: Effects = (),
    seconds: float = 60.0,
) -> Case:
    """Simulate as :func:`simulate_case` into ``folder``: ``machine.yaml``, Parquet files, ``truth.yaml``."""
    case = simulate_case(arm, seed, undeclared, seconds=seconds)
    folder = Path(folder)
    write_tables(folder, case.machine, case.recordings)
    effects = [{"name": s.id, "joint": s.joint, "size": s.size} for s in case.undeclared]
    content = {"arm": case.machine.name, "seed": seed, "effects": effects} | case.truth.to_dict()
    (folder / "truth.yaml").write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return case
