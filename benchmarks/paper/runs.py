"""Runs that the page of the claims is made of: simulated arms whose truth is known, and measured machines.

Truth is read here after the fits, and never by them. One arm has Stribeck friction that its model lacks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import hilfit
from benchmarks.attribution.judging import recordings_of
from benchmarks.attribution.verdicts import truth_vector
from benchmarks.measured import sets
from benchmarks.samples import files_of, named
from benchmarks.stages import compare_ways
from benchmarks.targets import ARMS, Arm, Check, Show, fact, figure
from daq.machine.machine_file import Machine
from fitting.arm.dynamics import rigid_body_regressor
from fitting.arm.linkage import lever_arm
from fitting.arrays import FloatArray
from fitting.loop.session import Options, Session
from fitting.pipeline.results.stage_results import Cylinders, Residual, RigidBody, StageResults
from sim_backends.plant.cases import Case, make_case, simulate_case
from sim_backends.plant.plant import Plant
from sim_backends.undeclared import EffectSpec

#: Standard deviation of measured minus computed joint torque in N m, on the motion that was fitted, as published.
PUBLISHED_STD = (0.226, 0.289, 0.378, 0.193, 0.179, 0.336)
#: Standard parameters before, and base parameters after the regrouping, as published.
PUBLISHED_COUNTS = (78, 18)
#: States at which the rank of the regressor is computed by its singular values.
_STATES = 2000
_RANK_TOLERANCE = 1e-9  # of the largest singular value


@dataclass(frozen=True)
class CylinderRun:
    """Stage 1 of one cylinder.

    Attributes
    ----------
    names, theta, covariance : what was estimated, (k,) and (k, k), SI
    truth : (k,) what the plant has
    residual_std : N
    fastest : m/s, largest piston speed of the unloaded recording
    """

    joint: str
    names: tuple[str, ...]
    theta: FloatArray
    covariance: FloatArray
    truth: FloatArray
    residual_std: float
    fastest: float

    @property
    def estimates(self) -> list[tuple[float, float, float]]:
        """Value, standard deviation and truth of each parameter."""
        return list(zip(self.theta, np.sqrt(np.diag(self.covariance)), self.truth, strict=True))

    def apart(self, name: str) -> float:
        """Compute the share by which a parameter is off its truth."""
        k = self.names.index(name)
        return abs(float(self.theta[k] / self.truth[k]) - 1.0)


@dataclass(frozen=True)
class ArmRun:
    """Both stages on one simulated arm.

    Attributes
    ----------
    counts : standard and base parameters
    rank : of the regressor at random states, by its singular values
    base : expression, value, standard deviation and truth of every base parameter, by stage 2 with friction frozen
    cylinders : stage 1
    joints : names
    floor, fitted, unseen : (n,) N m: noise floor, error of the two stages on the fitted motions and on ``validate``
    compared : two stages against one (:func:`fitting.pipeline.comparison.compare`)
    """

    arm: Arm
    seed: int
    counts: tuple[int, int]
    rank: int
    base: tuple[tuple[str, float, float, float], ...]
    cylinders: tuple[CylinderRun, ...]
    joints: tuple[str, ...]
    floor: FloatArray
    fitted: FloatArray
    unseen: FloatArray
    compared: Mapping[str, Any]


@dataclass(frozen=True)
class Claims:
    """All runs of a page.

    Attributes
    ----------
    shown : the arm whose tables are printed in full
    arms : every simulated arm
    measured : two stages against one on measured machines, by name
    stribeck : an arm with Stribeck friction that its model lacks
    skipped : measured machines whose data is not there
    """

    shown: ArmRun
    arms: tuple[ArmRun, ...]
    measured: Mapping[str, Mapping[str, Any]]
    stribeck: StribeckRun
    skipped: tuple[str, ...]


def claims_of(count: int, seed: int, data: Path, show: Show) -> Claims:
    """Make the runs: so many arms of each kind, the bump, and the measured machines whose data is there."""
    arms = []
    for kind in ARMS:
        for number in range(seed, seed + count):
            show(f"{kind} arm {number}: both stages, one-shot")
            arms.append(_arm_run(kind, number))
    show("folding arm with Stribeck friction: the loop")
    found = _stribeck_run(seed)
    measured, skipped = _measured(data, show)
    return Claims(arms[0], tuple(arms), measured, found, skipped)


def _arm_run(arm: Arm, seed: int) -> ArmRun:
    """Run both stages and the one-shot regression on a simulated arm without any undeclared effect."""
    case = simulate_case(arm, seed)
    session = Session(case.machine, recordings_of(case.machine, case.recordings), Options(loop=False))
    compared, results = compare_ways(session)
    design = session.plain.design
    two, first = results[RigidBody].two_stage, len(design.parameters.names) - len(session.base)
    truth = truth_vector(case.machine, case.truth, design)
    base = tuple(
        (name, float(two.theta[k]), float(two.std[k]), float(truth[k]))
        for k, name in enumerate(design.parameters.names)
        if k >= first
    )
    return ArmRun(
        arm,
        seed,
        (session.base.standard_count, len(session.base)),
        rank(case.machine, seed),
        base,
        _cylinders(case, session, results),
        tuple(joint.name for joint in case.machine.joints),
        np.asarray(results[Residual].noise_floor, dtype=float),
        np.array(two.errors["train"], dtype=float),
        np.array(two.errors["validate"], dtype=float),
        compared,
    )


def rank(machine: Machine, seed: int) -> int:
    """Compute the rank of the regressor of all standard parameters, by singular values at random states."""
    rng = np.random.default_rng([seed, 52])
    limits = np.array([joint.limits.position for joint in machine.joints])
    q = rng.uniform(limits[:, 0], limits[:, 1], (_STATES, len(limits)))
    qd, qdd = rng.normal(size=(2, *q.shape))
    W = rigid_body_regressor(machine, q, qd, qdd)
    values = np.linalg.svd(W.reshape(-1, W.shape[-1]), compute_uv=False)
    return int(np.count_nonzero(values > _RANK_TOLERANCE * values[0]))


def _cylinders(case: Case, session: Session, results: StageResults) -> tuple[CylinderRun, ...]:
    free = next(r for r in session.recordings if r.role == "unloaded")
    found = []
    for own in results[Cylinders].cylinders:
        position = np.asarray(free.values[f"{own.joint}.piston_position"])
        speed = np.abs(np.gradient(position, free.time))
        truth = vars(case.truth.cylinders[own.joint])
        found.append(
            CylinderRun(
                own.joint,
                own.names,
                own.theta,
                np.array(own.covariance, dtype=float),
                np.array([truth[name] for name in own.names]),
                own.residual_std,
                float(np.quantile(speed, 0.99)),
            )
        )
    return tuple(found)


def _measured(data: Path, show: Show) -> tuple[dict[str, Mapping[str, Any]], tuple[str, ...]]:
    found: dict[str, Mapping[str, Any]] = {}
    skipped = []
    with TemporaryDirectory(prefix="hilfit-paper-") as scratch:
        for name, folder in sets.FOLDERS.items():
            shown = f"{name}, last 30 %" if name == "TX40" else name
            session = sets.session(name, data, Path(scratch))
            if session is None:
                skipped.append(f"{shown}: no data in {data.name}/{folder}, left out")
                show(skipped[-1])
                continue
            show(f"{shown}: both stages, one-shot")
            found[shown] = compare_ways(session)[0]
    return found, tuple(skipped)


def checks(claims: Claims) -> tuple[Check, ...]:
    """Check the page's claims, as numbers beside targets."""
    own = claims.shown
    folding = [each for each in claims.arms if each.arm == "folding"]
    counts = {each.counts for each in folding}
    ranks = {each.rank for each in folding}
    worst = {name: max(c.apart(name) for each in claims.arms for c in each.cylinders) for name in ("f_c", "K")}
    bump, unseen = claims.stribeck, "error on the unseen motion"
    return (
        fact("parameters of a folding arm", counts == {PUBLISHED_COUNTS}, f"{own.counts[0]} to {own.counts[1]}"),
        fact("rank of its regressor by singular values", ranks == {PUBLISHED_COUNTS[1]}, str(own.rank)),
        Check("stage 1: f_c apart from the truth, worst cylinder", worst["f_c"], f"{100 * worst['f_c']:.1f} %"),
        Check("stage 1: K apart from the truth, worst cylinder", worst["K"], f"{100 * worst['K']:.1f} %"),
        figure(f"{unseen} over the noise floor, all joints of the arm shown", over_floor(own), "{:.2f}", most=1.2),
        fact("Stribeck friction is named at its joint", bump.named, bump.findings),
        Check(
            "friction curve after the loop over before, distance from the truth",
            bump.after / bump.before,
            f"{bump.before:.1f} N before, {bump.after:.1f} N after",
            "at most",
            1.0,
        ),
    )


def over_floor(own: ArmRun) -> float:
    """Compute the RMS over the joints of the error on ``validate`` in noise floors."""
    return float(np.sqrt(np.mean((own.unseen / own.floor) ** 2)))


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
    findings : what the loop names
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
    findings: str
    errors: tuple[float, float, float]


def _stribeck_run(seed: int) -> StribeckRun:
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
    findings = ", ".join(" or ".join(f"{name} at {joint}" for name, joint in own) for own in sets) or "nothing"
    return StribeckRun(
        case.undeclared[0].size,
        speed,
        truth,
        curves[0],
        curves[1],
        before,
        after,
        any(("stribeck", JOINT) in own for own in sets),
        findings,
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
