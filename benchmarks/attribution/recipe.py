"""Recipes of cases: everything is drawn from the case's class, number and seed, and from nothing else."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from sim_backends.machines import ARMS, ArmKind
from sim_backends.plant.cases import CasePlan, plan_case
from sim_backends.plant.truth import SensorQuality
from sim_backends.undeclared import MISMATCH, OUTSIDE, OUTSIDE_MISMATCH, UNDECLARED, EffectSpec, outside

#: Classes of cases, and the interval their sizes are drawn from (log-uniform): lambda, or, for effects that bend an
#: encoder, the root mean square of the mismatch in noise widths of one sample.
TARGETS: dict[str, tuple[float, float]] = {
    "null": (0.0, 0.0),
    "large": (10.0, 60.0),
    "medium": (6.0, 10.0),
    "small": (4.0, 6.0),
    "kinematic": (2.0, 100.0),
    "outside": (10.0, 60.0),
    "pairs": (10.0, 60.0),
}
KINDS = tuple(TARGETS)
KINEMATIC = ("encoder_offset", "encoder_eccentricity", "linkage_geometry", "backlash")
#: Effects of the catalogue that show in the efforts.
INSIDE = tuple(e for e in UNDECLARED if e not in (*KINEMATIC, *MISMATCH, *OUTSIDE, *OUTSIDE_MISMATCH))
#: Effects whose size may have either sign: errors of transducers and mountings.
SIGNED = (
    "pressure_offset",
    "pressure_gain",
    "pressure_drift",
    "encoder_offset",
    "encoder_eccentricity",
    "linkage_geometry",
    "base_tilt",
)


@dataclass(frozen=True)
class Recipe:
    """Pools of cases: kinds of arms, effects outside the catalogue, and effects that bend position sensors.

    Their order counts. ``zeros`` of position sensors, the piston's and the joint's, look like play on one side: it is
    as large as what is beyond them. ``positions``: the size of an effect counts all noise of inertia, too; ``lines``:
    that of a spectral line does.
    """

    arms: tuple[ArmKind, ...]
    outside: tuple[str, ...]
    kinematic: tuple[str, ...] = KINEMATIC
    zeros: int = 1
    positions: bool = False
    lines: bool = False


#: By number; a number is added whenever the same key would give another case, and makes its own cases for ever.
RECIPES = {
    3: Recipe(("folding", "slewing"), tuple(e for e in OUTSIDE if UNDECLARED[e].__module__ == outside.__name__)),
    4: Recipe(tuple(ARMS), OUTSIDE),
    5: Recipe(tuple(ARMS), OUTSIDE, (*KINEMATIC, *MISMATCH), 2),
    6: Recipe(tuple(ARMS), OUTSIDE, (*KINEMATIC, *MISMATCH), 2, True),
    7: Recipe(tuple(ARMS), OUTSIDE, (*KINEMATIC, *MISMATCH), 2, True, True),
}
RECIPE = max(RECIPES)


@dataclass(frozen=True)
class CaseKey:
    """Key of a case: its class, its number in the class, and the seed of the run."""

    kind: str
    number: int
    seed: int = 0

    @property
    def text(self) -> str:
        """Text for ``--case``."""
        return f"{self.kind}:{self.number}"


@dataclass(frozen=True)
class Selection:
    """Restrictions of a run.

    Attributes
    ----------
    only : one effect
    arms : kinds of arms, which take turns by a case's number; none: drawn from all of the recipe
    seconds : length of each recording
    recipe : number in :data:`RECIPES`
    """

    only: str | None = None
    arms: tuple[ArmKind, ...] = ()
    seconds: float = 60.0
    recipe: int = field(default=RECIPE)

    @property
    def text(self) -> str:
        """Part of a file name; empty for an unrestricted run of today's recipe."""
        parts = [self.only, "-".join(self.arms), None if self.seconds == 60.0 else f"{self.seconds:g}s"]
        parts.append(None if self.recipe == RECIPE else f"recipe{self.recipe}")
        return "".join(f"-{part}" for part in parts if part)

    def as_json(self) -> dict[str, Any]:
        """Return it as it is read back from a line of results."""
        return asdict(self) | {"arms": list(self.arms)}


def generator(key: CaseKey) -> np.random.Generator:
    """Return the random generator of a case."""
    return np.random.default_rng([77, key.seed, KINDS.index(key.kind), key.number])


#: Where pressure transducers end, Pa: 250 bar, and 400 on the machines of tonnes.
FULL_SCALE: dict[ArmKind, float] = {"folding": 25.0e6, "slewing": 25.0e6, "excavator": 40.0e6, "telescope": 40.0e6}


def _between(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw a number, log-uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def draw_transducers(rng: np.random.Generator, full_scale: float) -> SensorQuality:
    """Draw a measurement chain, each property log-uniform over what machines have.

    Pressures have 14 to 16 bits of ``full_scale`` Pa and noise of 20 to 200 millionths of it, joint encoders 17 to 20
    bits, piston encoders steps of 1 to 10 micrometres.
    """
    return SensorQuality(
        encoder_std=_between(rng, 5e-6, 3e-5),
        encoder_resolution=2 * float(np.pi) / 2 ** int(rng.integers(17, 21)),
        piston_std=_between(rng, 1.5e-6, 8e-6),
        piston_resolution=float(rng.choice([1e-6, 2e-6, 5e-6, 1e-5])),
        pressure_std=_between(rng, 500.0, 5000.0) * (full_scale / 25.0e6),
        pressure_resolution=full_scale / 2 ** int(rng.integers(14, 17)),
    )


def draw_quality(rng: np.random.Generator, full_scale: float = 25.0e6) -> SensorQuality:
    """Draw a measurement chain (:func:`draw_transducers`), and a restlessness.

    The disturbance is 3 to 30 % of Coulomb friction with 0.05 to 0.6 s of memory; a knock comes every 50 to 2000 s.
    """
    return replace(
        draw_transducers(rng, full_scale),
        disturbance=_between(rng, 0.03, 0.3),
        disturbance_time=_between(rng, 0.05, 0.6),
        knock_rate=_between(rng, 0.0005, 0.02),
        knock_size=_between(rng, 0.3, 1.5),
        tracking=_between(rng, 1e-5, 2e-4),
    )


def opened(key: CaseKey, selection: Selection) -> tuple[np.random.Generator, CasePlan, SensorQuality]:
    """Draw machine, motions and measurement chain; return the generator that draws the rest too."""
    rng = generator(key)
    arms = RECIPES[selection.recipe].arms
    arm = arms[int(rng.choice(len(arms)))]
    if selection.arms:
        arm = selection.arms[key.number % len(selection.arms)]
    plan = plan_case(arm, int(rng.integers(2**31)), selection.seconds)
    return rng, plan, draw_quality(rng, FULL_SCALE[arm])


def draw_effect(rng: np.random.Generator, kind: str, plan: CasePlan, selection: Selection) -> tuple[EffectSpec, float]:
    """Draw an effect of a class of cases, its joint (None: the whole machine) and its sign; and its size."""
    recipe = RECIPES[selection.recipe]
    pool = {"kinematic": recipe.kinematic, "outside": recipe.outside}.get(kind, INSIDE)
    effect = pool[int(rng.integers(len(pool)))]
    joint = plan.machine.joints[int(rng.integers(len(plan.machine.joints)))].name
    effect = selection.only or effect
    target = float(np.exp(rng.uniform(*np.log(TARGETS[kind]))))
    sign = float(rng.choice([-1.0, 1.0])) if effect in SIGNED else 1.0
    return EffectSpec(effect, None if UNDECLARED[effect].base_wide else joint, sign), target


@dataclass(frozen=True)
class _Largest:
    """A largest size: times all of ``of``, over all of ``over``, by the names of :func:`_measures`."""

    size: float
    of: tuple[str, ...] = ()
    over: tuple[str, ...] = ()


_LARGEST = {
    effect: _Largest(**own)
    for effect, own in yaml.safe_load(Path(__file__).with_name("largest.yaml").read_text(encoding="utf-8")).items()
}


def largest(effect: str, plan: CasePlan, joint: str | None) -> float:
    """Return the largest size that is still this defect and not a broken machine, in the effect's unit.

    Engineering estimates (``largest.yaml``): forces relative to the cylinder's Coulomb friction or to its load,
    inertias and masses relative to the arm's.

    Raises
    ------
    KeyError
        For an effect of which there is no estimate.
    """
    own = _LARGEST[effect]
    known = {"arm_mass": sum(link.mass for link in plan.truth.links), "pressure": 2.0e6, "weight": 9.81}
    if joint is not None:
        known |= _measures(plan, [j.name for j in plan.machine.joints].index(joint))
    return float(prod([own.size, *(known[name] for name in own.of)]) / prod(known[name] for name in own.over))


def _measures(plan: CasePlan, number: int) -> dict[str, float]:
    """Measure a joint and what it carries, by the names of ``largest.yaml``."""
    joint, links = plan.machine.joints[number], plan.truth.links
    law, cylinder, q = plan.truth.cylinders[joint.name], joint.cylinder, np.linspace(*joint.limits.position, 201)
    assert cylinder is not None
    lever = float(np.mean(np.abs(np.gradient(cylinder.linkage.piston_position(q), q))))
    # The estimates are for links of up to 1.3 m.
    longest = max(1.0, max(abs(each.dh.a) for each in plan.machine.joints) / 1.3)
    stretch = 1.0 if joint.type == "prismatic" else longest
    found = {"f_c": law.f_c, "f_v": law.f_v, "m": law.m, "head_area": cylinder.head_area, "lever": lever}
    found |= {"lever_squared": lever**2, "stretch": stretch, "stretch_squared": stretch**2}
    return found | {"outer_mass": sum(link.mass for link in links[number:])}
