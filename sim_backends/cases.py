"""Whole cases for identification: a machine file, its recordings, and apart from them the truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt
import yaml

from daq.machine_file import Machine, machine_to_yaml
from daq.recording import write_recording
from sim_backends.machines import folding_arm, slewing_arm
from sim_backends.motion import Motion, random_motion
from sim_backends.plant import record
from sim_backends.truth import SensorQuality, Truth
from sim_backends.undeclared import EffectSpec, check_spec

FloatArray = npt.NDArray[np.float64]
Effects = Sequence[EffectSpec | tuple[str, str | None, float]]


@dataclass(frozen=True)
class Case:
    """Recordings of one machine: SI tables by file stem (``unloaded``, ``train-1``, ``train-2``, ``repeat``,
    ``validate``), their motions, and the truth."""

    machine: Machine
    truth: Truth
    undeclared: tuple[EffectSpec, ...]
    motions: Mapping[str, Motion]
    recordings: Mapping[str, Mapping[str, FloatArray]]


def simulate_case(
    arm: Literal["folding", "slewing"] | tuple[Machine, Truth] = "folding",
    seed: int = 0,
    undeclared: Effects = (),
    quality: SensorQuality | None = None,
    seconds: float = 60.0,
) -> Case:
    """Simulate the recordings of one case in memory.

    ``repeat`` is the motion of ``train-1`` again. The hidden shape of an effect is the same in all recordings, noise
    and tracking errors differ. The same arguments give the same numbers.
    """
    if isinstance(arm, tuple):
        machine, truth = arm
    else:
        machine, truth = (folding_arm if arm == "folding" else slewing_arm)(seed)
    specs = tuple(check_spec(s if isinstance(s, EffectSpec) else EffectSpec(*s), machine) for s in undeclared)
    motion_rng = np.random.default_rng([seed, 11])
    motions: dict[str, Motion] = {"unloaded": random_motion(machine, motion_rng, seconds, rods="unpinned")}
    for stem in ("train-1", "train-2", "validate"):
        motions[stem] = random_motion(machine, motion_rng, seconds)
    motions["repeat"] = motions["train-1"]
    recordings = {}
    for k, stem in enumerate(("unloaded", "train-1", "train-2", "repeat", "validate")):
        recordings[stem] = record(
            machine, truth, motions[stem], undeclared=specs, quality=quality,
            rng=np.random.default_rng([seed, 12, k]), shapes=np.random.default_rng([seed, 13]),
        )  # fmt: skip
    return Case(machine, truth, specs, motions, recordings)


def make_case(
    folder: str | Path,
    arm: Literal["folding", "slewing"] | tuple[Machine, Truth] = "folding",
    seed: int = 0,
    undeclared: Effects = (),
    quality: SensorQuality | None = None,
    seconds: float = 60.0,
) -> Case:
    """As :func:`simulate_case`, written to ``folder``: ``machine.yaml``, one Parquet file each, ``truth.yaml``."""
    case = simulate_case(arm, seed, undeclared, quality, seconds)
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "machine.yaml").write_text(machine_to_yaml(case.machine), encoding="utf-8")
    for stem, table in case.recordings.items():
        values = {name: column for name, column in table.items() if name != "time"}
        role = stem.partition("-")[0]
        write_recording(folder / f"{stem}.parquet", case.machine, role, table["time"], values)
    effects = [{"name": s.id, "joint": s.joint, "size": s.size} for s in case.undeclared]
    content = {"arm": case.machine.name, "seed": seed, "effects": effects} | case.truth.to_dict()
    (folder / "truth.yaml").write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return case
