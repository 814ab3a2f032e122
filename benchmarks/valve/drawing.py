"""What a case is made of, and cases on disk: machine file, recordings, and apart from them what is true.

Every number of a run is a machine; it is recorded twice with the same motions, healthy (``null``) and with one
undeclared effect (``large``). The three kinds of machines take turns.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import yaml

from benchmarks.attribution.recipe import draw_transducers
from benchmarks.valve.sight import at_limit, floor, misfit
from sim_backends.valve.effects import VALVE_EFFECTS, ValveEffectSpec, valve_obstacle
from sim_backends.valve.machines import VALVE_MACHINES, Kind
from sim_backends.valve.motion import Phase, joint_motion, valve_motion, working_motion
from sim_backends.valve.recording import Order, ValveCase, guesses_of, simulate_valve_cases, write_valve_case

KINDS: tuple[Kind, ...] = ("bench", "crane", "excavator")
CLASSES = ("null", "large")
FULL_SCALE = 40.0e6  # Pa of the pressure transducers
WORK = 60.0  # s of the motion that is judged on
SIDE_BY_SIDE = 16  # cases that are simulated together


@dataclass(frozen=True)
class ValveKey:
    """Which case: its number, its class and the run's seed."""

    number: int
    made: Literal["null", "large"]
    seed: int = 0

    @property
    def kind(self) -> Kind:
        """The kind of machine."""
        return KINDS[self.number % len(KINDS)]

    @property
    def text(self) -> str:
        """Name of the case, and of its folder."""
        return f"seed{self.seed}-{self.number:03d}-{self.kind}-{self.made}"


def order_of(key: ValveKey) -> Order:
    """Draw machine, truth, programmes, guesses, effects, sensors and seed of the noise."""
    rng = np.random.default_rng([78, key.seed, key.number])
    machine, truth = VALVE_MACHINES[key.kind](int(rng.integers(2**31)))
    guesses = guesses_of(machine, truth, rng)
    count = len(machine.joints)
    level = float(rng.uniform(0.65, 0.8))
    programmes: dict[str, Sequence[Phase]] = {}
    for axis, joint in enumerate(machine.joints):
        poses = [(0.5,) * count, tuple(0.5 if j == axis else float(rng.uniform(0.15, 0.3)) for j in range(count))]
        programmes[f"train-{joint.name}"] = valve_motion(axis, guesses, poses, level)
    programmes["train-all"] = joint_motion(guesses, rng, 0.8)
    programmes["repeat"] = programmes["train-all"]
    programmes["validate"] = working_motion(guesses, rng, WORK)
    quality = draw_transducers(rng, FULL_SCALE)
    effects: tuple[ValveEffectSpec, ...] = ()
    if key.made == "large":
        pool: dict[str, list[tuple[str, str | None]]] = {}
        for (effect, form), known in VALVE_EFFECTS.items():
            # The excavator's pump has its limit in every case.
            if known.earlier or (known.whole and np.isfinite(truth.supply.flow_limit)):
                continue
            for joint_name in [None] if known.whole else [joint.name for joint in machine.joints]:
                if valve_obstacle(known, machine, truth, joint_name) is None:
                    pool.setdefault(effect, []).append((form, joint_name))
        own = np.random.default_rng([79, key.seed, key.number])
        effect = list(pool)[int(own.integers(len(pool)))]
        form, place = pool[effect][int(own.integers(len(pool[effect])))]
        low, high = VALVE_EFFECTS[effect, form].large
        effects = (ValveEffectSpec(effect, form, place, float(np.exp(own.uniform(np.log(low), np.log(high))))),)
    return machine, truth, programmes, guesses, effects, quality, key.seed * 1000 + key.number


def stored_cases(folder: Path, keys: Sequence[ValveKey], show: Callable[[str], None] = print) -> list[Path]:
    """Return folders of the cases in the order of ``keys``; make those not there yet, many at a time."""
    folder.mkdir(parents=True, exist_ok=True)
    missing = [key for key in keys if not (folder / key.text / "case.yaml").is_file()]
    for kind in KINDS:
        own = [key for key in missing if key.kind == kind]
        for first in range(0, len(own), SIDE_BY_SIDE):
            part = own[first : first + SIDE_BY_SIDE]
            show(f"simulating {len(part)} cases of kind {kind}")
            for key, case in zip(part, simulate_valve_cases([order_of(key) for key in part]), strict=True):
                _write(folder / key.text, key, case)
    return [folder / key.text for key in keys]


def _write(place: Path, key: ValveKey, case: ValveCase) -> None:
    shutil.rmtree(place, ignore_errors=True)
    write_valve_case(place, case)
    courses = [case.courses[stem] for stem in case.courses if stem != "repeat"]
    names = [joint.name for joint in case.machine.joints]
    seen = misfit(case.machine, case.healthy, courses)
    content = {
        "kind": key.kind,
        "made": key.made,
        "seen": dict(zip(names, map(float, seen), strict=True)),
        "at_limit": at_limit(case.machine, case.truth, [case.courses["train-all"]]),
        "floor": dict(zip(names, map(float, floor(case)), strict=True)),
        "healthy": case.healthy.to_dict(),
    }
    # Written last and in one step: a folder with it is complete.
    part = place / "case.yaml.part"
    part.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    part.replace(place / "case.yaml")
