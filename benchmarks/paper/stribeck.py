"""Stribeck friction in the plant that the model lacks: what the loop makes of it, and the friction curves."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import hilfit
from benchmarks.samples import files_of, named
from fitting.arm.linkage import lever_arm
from fitting.arrays import FloatArray
from sim_backends.plant.cases import Case, make_case
from sim_backends.plant.plant import Plant
from sim_backends.undeclared import EffectSpec

#: The joint, and its extra friction at breakaway over its Coulomb friction.
JOINT, SHARE = "joint2", 0.6
#: Speeds of the curves, shares of the fastest piston speed of the fitted motions.
_LOWEST = 0.01


@dataclass(frozen=True)
class StribeckRun:
    """Friction of one cylinder over piston speed.

    Attributes
    ----------
    size : N, extra friction at breakaway
    speed : (N,) m/s
    truth, base, corrected : (N,) N: the plant's, the base model's, the corrected model's
    before, after : N, root mean square distance of the two models' curves from the truth
    named : whether the loop names Stribeck friction at the joint, alone or in a set
    said : what the loop said
    errors : N m on the validation motion: noise floor, before, after
    """

    size: float
    speed: FloatArray
    truth: FloatArray
    base: FloatArray
    corrected: FloatArray
    before: float
    after: float
    named: bool
    said: str
    errors: tuple[float, float, float]


def stribeck_run(seed: int) -> StribeckRun:
    """Identify a folding arm with Stribeck friction at :data:`JOINT`, with the loop, through ``import hilfit``."""
    with TemporaryDirectory(prefix="hilfit-paper-") as scratch:
        folder = Path(scratch)
        case = _case(folder, seed)
        files: dict[str, Any] = files_of(folder)
        found = hilfit.identify(folder / "machine.yaml", **files)
        base = hilfit.identify(folder / "machine.yaml", **files, loop=False)
    speed = _speeds(case)
    truth = _truth(case, seed, speed)
    curves = [_friction(result.model, case, speed) for result in (base, found)]
    before, after = (float(np.sqrt(np.mean((curve - truth) ** 2))) for curve in curves)
    errors = found.report["errors"][JOINT]
    sets = named(found.report)
    said = ", ".join(" or ".join(f"{name} at {joint}" for name, joint in own) for own in sets) or "nothing"
    return StribeckRun(
        case.undeclared[0].size,
        speed,
        truth,
        curves[0],
        curves[1],
        before,
        after,
        any(("stribeck", JOINT) in own for own in sets),
        said,
        (errors["noise_floor"], errors["before"]["validate"], errors["after"]["validate"]),
    )


def _case(folder: Path, seed: int) -> Case:
    from sim_backends.machines import folding_arm

    machine, truth = folding_arm(seed)
    size = SHARE * truth.cylinders[JOINT].f_c
    return make_case(folder, (machine, truth), seed, [EffectSpec("stribeck", JOINT, size)])


def _speeds(case: Case) -> FloatArray:
    train = case.recordings["train-1"]
    fastest = float(np.quantile(np.abs(np.gradient(train[f"{JOINT}.piston_position"], train["time"])), 0.99))
    half = np.geomspace(_LOWEST * fastest, fastest, 60)
    return np.concatenate([-half[::-1], half])


def _truth(case: Case, seed: int, v: FloatArray) -> FloatArray:
    """Compute the plant's own friction: its cylinder's law and its own bump, which is not the catalogue's.

    The declared damping is in it, as it is in what a model calls friction: whatever changes its sign with the speed.
    """
    described = next(joint.cylinder for joint in case.machine.joints if joint.name == JOINT)
    assert described is not None
    own = case.truth.cylinders[JOINT]
    plant = Plant(
        case.machine, case.truth, undeclared=case.undeclared,
        rng=np.random.default_rng(0), shapes=np.random.default_rng([seed, 13]),
    )  # fmt: skip
    film: float = plant.effects[0].film_speed  # type: ignore[attr-defined]
    base = own.f_c * np.sign(v) + (own.f_v + described.damping) * v + own.f_s * np.cbrt(v)
    return np.asarray(base + case.undeclared[0].size * np.sign(v) / (1.0 + (v / film) ** 2))


def _friction(model: hilfit.Model, case: Case, v: FloatArray) -> FloatArray:
    """Convert friction to the piston: the joint's, over its lever arm in mid-travel."""
    joint = next(k for k, each in enumerate(case.machine.joints) if each.name == JOINT)
    own = case.machine.joints[joint]
    assert own.cylinder is not None
    q = np.zeros((len(v), len(case.machine.joints)))
    q[:, joint] = np.mean(own.limits.position)
    r = lever_arm(own.cylinder.linkage, q[:, joint])
    qd = np.zeros_like(q)
    qd[:, joint] = v / r
    return np.asarray(model.friction(q, qd)[:, joint] / r)
