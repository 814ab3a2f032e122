"""The claims that hilfit began with, made again in kind: counts, cylinders, errors, friction, two stages.

Simulated arms whose truth is known, one of them with Stribeck friction that its model lacks, and measured machines.
Truth is read here after the fits, and never by them. Nothing on the page is typed: numbers and verdicts are the run's.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import hilfit
from benchmarks.attribution.judging import recordings_of
from benchmarks.attribution.verdicts import truth_vector
from benchmarks.measured import sets
from benchmarks.pages import AFTER, BEFORE, TRUTH, filled, svg, write
from benchmarks.samples import identified, named
from benchmarks.stages import compare_ways
from benchmarks.targets import ARMS, Arm, Check, Outcome, Show, fact, figure
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
#: The joint, and its extra friction at breakaway over its Coulomb friction.
JOINT, SHARE = "joint2", 0.6
#: Speeds of the curves, shares of the fastest piston speed of the fitted motions.
_LOWEST = 0.01
_UNITS = {"m": "kg", "K": "N/m", "f_c": "N", "f_v": "N s/m", "f_s": "N (s/m)^(1/3)"}
#: Percent: differences below are none.
_EQUAL = 0.05
#: Errors on an unseen motion of up to so many noise floors are noise.
_MOST_FLOORS = 1.2
#: Deviations from the truth beyond which a 95 % interval does not hold it.
_Z95 = 1.96


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


def run(count: int, seed: int, data: Path, page: Path | None, show: Show) -> Outcome:
    """Make the runs, and the page where one is wanted."""
    claims = claims_of(count, seed, data, show)
    if page is not None:
        figures = {"cylinders": _cylinders_figure(claims.shown), "stribeck": _stribeck_figure(claims.stribeck)}
        write(page, text(claims, page.stem), figures)
    return Outcome(checks(claims), claims.skipped)


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
    return tuple(
        CylinderRun(
            own.joint,
            own.names,
            own.theta,
            np.array(own.covariance, dtype=float),
            np.array([getattr(case.truth.cylinders[own.joint], name) for name in own.names]),
            own.residual_std,
            _fastest(free.values[f"{own.joint}.piston_position"], free.time),
        )
        for own in results[Cylinders].cylinders
    )


def _fastest(position: FloatArray, time: FloatArray) -> float:
    """Compute the largest speed of a piston (N,), but for one row in a hundred, m/s."""
    return float(np.quantile(np.abs(np.gradient(np.asarray(position), time)), 0.99))


def _speeds(fastest: float, count: int) -> FloatArray:
    """List so many speeds each way, (2 count,) m/s, from a hundredth of the fastest."""
    half = np.geomspace(_LOWEST * fastest, fastest, count)
    return np.concatenate([-half[::-1], half])


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


def _stribeck_run(seed: int) -> StribeckRun:
    """Identify a folding arm with Stribeck friction at :data:`JOINT`, with the loop, through ``import hilfit``."""
    with TemporaryDirectory(prefix="hilfit-paper-") as scratch:
        folder = Path(scratch)
        case = _case(folder, seed)
        found, base = identified(folder), identified(folder, loop=False)
    train = case.recordings["train-1"]
    speed = _speeds(_fastest(train[f"{JOINT}.piston_position"], train["time"]), 60)
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


def text(claims: Claims, folder: str) -> str:
    """Write the page; ``folder`` has its figures."""
    own, simulated = claims.shown, [each.compared for each in claims.arms]
    machines = {f"{each.arm} arm {each.seed}": each.compared for each in claims.arms} | dict(claims.measured)
    contenders = [compared["contenders"] for compared in machines.values()]
    estimates = [estimate for each in own.cylinders for estimate in each.estimates]
    better, worse, _ = sides(machines.values(), "one_shot_with_unloaded")
    return filled(
        "paper.md.j2",
        claims=claims,
        folder=folder,
        folding=sum(each.arm == "folding" for each in claims.arms),
        deviations=_deviations,
        as_published=own.counts == PUBLISHED_COUNTS and own.rank == own.counts[1],
        base_inside=sum(_deviations(*estimate) < _Z95 for _, *estimate in own.base),
        units=_UNITS,
        inside=sum(_deviations(*estimate) < _Z95 for estimate in estimates),
        total=len(estimates),
        worst={name: max(each.apart(name) for each in own.cylinders) for name in _UNITS},
        curves_apart=max(_curve_error(each) for each in own.cylinders),
        residuals=(
            ("published, motion that was fitted", PUBLISHED_STD),
            ("here, motions that were fitted", own.fitted),
            ("here, another motion", own.unseen),
            ("here, noise floor", own.floor),
        ),
        lower=sum(a < b for a, b in zip(own.fitted, PUBLISHED_STD, strict=True)),
        floors=over_floor(own),
        most_floors=_MOST_FLOORS,
        machines=machines,
        simulated=simulated,
        sides=sides,
        conditioned=_conditioned(contenders),
        gains=better > worse,
        refits=(sum(own["joint_refit"]["overall"] < own["one_shot"]["overall"] for own in contenders), len(contenders)),
    )


def _deviations(value: float, std: float, truth: float) -> float:
    """Compute how many standard deviations an estimate is from the truth."""
    return abs(value - truth) / std if std > 0 else float("inf")


def _curve_error(own: CylinderRun) -> float:
    """Compute the RMS distance of a friction curve from the truth over the RMS of the truth, over the speeds."""
    v = np.linspace(-own.fastest, own.fastest, 201)
    found, _, truth = curve(own, v)
    return float(np.linalg.norm(found - truth) / np.linalg.norm(truth))


def sides(compared: Iterable[Mapping[str, Any]], against: str) -> tuple[int, int, int]:
    """Count where the two stages are better, worse, and the same within the interval, against another way."""
    intervals = [own["against"][against]["ci95_percent"] for own in compared if against in own["against"]]
    known = [interval for interval in intervals if interval is not None]
    better, worse = sum(high < -_EQUAL for _, high in known), sum(low > _EQUAL for low, _ in known)
    return better, worse, len(known) - better - worse


def _conditioned(contenders: Iterable[Mapping[str, Any]]) -> tuple[int, int]:
    """Count the machines on which the two stages are better conditioned, and those of which that is known."""
    pairs = [(own["hierarchical"]["condition_number"], own["one_shot"]["condition_number"]) for own in contenders]
    known = [(a, b) for a, b in pairs if a is not None and b is not None]
    return sum(a < (1.0 - _EQUAL / 100.0) * b for a, b in known), len(known)


def curve(own: CylinderRun, v: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Compute stage 1's friction (N,) in N at piston speeds (N,) in m/s, its standard deviation, and the truth."""
    k = [own.names.index(name) for name in ("f_c", "f_v", "f_s")]
    B = np.column_stack([np.sign(v), v, np.cbrt(v)])
    std = np.sqrt(np.einsum("ni,ij,nj->n", B, own.covariance[np.ix_(k, k)], B))
    return np.asarray(B @ own.theta[k]), np.asarray(std), np.asarray(B @ own.truth[k])


def _cylinders_figure(own: ArmRun) -> str:
    """Plot friction over piston speed of every cylinder: stage 1, its 95 % band, and the truth."""

    def draw(figure: Any) -> None:
        for ax, each in zip(figure.subplots(2, 3).flat, own.cylinders, strict=False):
            v = _speeds(each.fastest, 50)
            found, std, truth = curve(each, v)
            ax.fill_between(1e3 * v, found - _Z95 * std, found + _Z95 * std, color=AFTER, alpha=0.25, linewidth=0)
            ax.plot(1e3 * v, found, color=AFTER, linewidth=1.3, label="stage 1, 95 % band")
            ax.plot(1e3 * v, truth, "--", color=TRUTH, linewidth=1.0, label="truth")
            ax.set_title(each.joint, fontsize=10)
        figure.axes[0].legend(loc="upper left", fontsize=8)
        for ax in figure.axes[3:]:
            ax.set_xlabel("piston speed [mm/s]")
        for ax in (figure.axes[0], figure.axes[3]):
            ax.set_ylabel("friction [N]")

    return svg(draw, 9.0, 5.0)


def _stribeck_figure(own: StribeckRun) -> str:
    """Plot friction with a bump that the base model lacks, before and after the loop."""

    def draw(figure: Any) -> None:
        ax = figure.subplots()
        v = 1e3 * own.speed
        ax.plot(v, own.base, color=BEFORE, linewidth=1.3, label=f"base model: {own.before:.1f} N off")
        ax.plot(v, own.corrected, color=AFTER, linewidth=1.3, label=f"after the loop: {own.after:.1f} N off")
        ax.plot(v, own.truth, "--", color=TRUTH, linewidth=1.0, label="truth")
        ax.set_xlabel("piston speed [mm/s]")
        ax.set_ylabel("friction with damping [N]")
        ax.legend(loc="upper left")

    return svg(draw, 6.4, 3.8)
