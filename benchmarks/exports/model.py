"""The model outside its report: exports against it, C's time beside Pinocchio, and what the 95 % band is worth.

Every format goes through one conformance class (:mod:`benchmarks.exports.conformance`), on made-up arms of six
cylinders with friction, stiffness and effects (six parallel axes, six twisted ones, each memory, faults of sensors),
and on the models of sample recordings and of measured machines. The band is tried on the sample recordings of an
independent plant, with the effects that are really there or a law in their place, and on measured machines without any;
what those have that the model lacks is no noise: where their share is not what a band says, the model has to report so.
"""

from __future__ import annotations

import csv
import ctypes
import importlib
import tempfile
import timeit
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path
from time import thread_time
from types import ModuleType
from typing import Any

import numpy as np
from scipy.interpolate import RegularGridInterpolator

import sim_backends
from benchmarks.exports.conformance import NEEDS, STRICT, Conformance, compiled, handed_over
from benchmarks.exports.conformance import run as run_command
from benchmarks.exports.cortex import cortex
from benchmarks.measured import sets
from benchmarks.targets import Check, Outcome, Show, figure
from daq.errors import InputError
from daq.machine.machine_file import Machine, load_machine
from daq.recordings.recording import Recording, read_recording
from fitting.arm.base_parameters import base_regressor, reduce_parameters
from fitting.arrays import FloatArray
from fitting.effects import effect
from fitting.effects.base import Ranges
from fitting.loop.session import Options, Session
from fitting.model import motion
from fitting.model.arm_model import ArmModel, Pass, Provenance
from fitting.model.evaluation import narrow
from fitting.model.export import export_model
from fitting.model.export.functions import identifier, states
from fitting.model.prediction import predict
from fitting.model.simulation import simulate
from fitting.regression.drive import drive_names
from fitting.residual.laws import OWN_FUNCTIONS, Law
from fitting.residual.terms import Term
from fitting.signals.preparation import PositionNoise
from fitting.signals.splines import spline_knots

Trial = tuple[Machine, list[Recording]]

TWISTED = (np.pi / 2, 0.0, np.pi / 2, -np.pi / 2, np.pi / 2, 0.0)
#: Made-up arms: twists, and effects with their shapes and values.
MADE: dict[str, tuple[Sequence[float] | None, tuple[tuple[str, int | None, dict[str, float], float], ...]]] = {
    "six parallel axes": (None, (("position_dependent_friction", 1, {}, 1200.0),)),
    "six axes, twisted": (TWISTED, (("position_dependent_friction", 1, {}, 1200.0),)),
    "presliding": (None, (("presliding_hysteresis", 1, {"x_s": 4e-4}, 300.0),)),
    "film": (None, (("lubricant_film_lag", 2, {"tau": 0.12, "n": 1 / 3}, 500.0),)),
    "liquid": (None, (("carried_liquid", 3, {"frequency": 0.8, "zeta": 0.02}, 4.0),)),
    "faults of sensors": (
        None,
        (
            ("pressure_offset", 0, {}, 400.0),
            ("pressure_gain", 1, {"chamber": 1.0}, 0.03),
            ("pressure_drift", 2, {"tau": 0.0}, 9.0),
        ),
    ),
}
#: Sample cases, and the effects that are really there: name, joint, shape.
CASES: dict[str, tuple[tuple[str, int | None, dict[str, float]], ...]] = {
    "nothing-missing": (),
    "position-friction-joint2": (("position_dependent_friction", 1, {}),),
    "load-friction-joint2": (("load_dependent_friction", 1, {"knee": 0.0}),),
    "tilted-base": (("base_tilt", None, {}),),
    "latency-joint3": (("sensor_latency", 2, {}),),
}
#: Sample cases, and the law that stands in the place of what is really there: signal, joint.
LAWS = {"bent-guide-joint1": ("piston_position", 0), "position-friction-joint2 by a law": ("piston_position", 1)}
_CALLS, _REPEATS = 2_000, 300  # short turns: what else the computer does spares some of them


def run(samples: Path, data: Path, show: Show) -> Outcome:
    """Run all checks."""
    checks: list[Check] = []
    notes: list[str] = []
    for name, (twists, effects) in MADE.items():
        show(name)
        model = _made_up(twists, effects)
        checks += [*_conforms(name, model), *cortex(name, model), *(_exports(name, model) if "six" in name else ())]
    trials, missing = _trials(samples, data)
    notes += [f"{name}: no data in {folder}, skipped" for name, folder in missing]
    for name, trial in trials.items():
        show(name)
        model = _model_of(name, trial)
        checks += [*_band(name, trial, model), *_conforms(name, model), *_moves(name, model)]
    return Outcome(tuple(checks), tuple(notes))


def _conforms(name: str, model: ArmModel) -> list[Check]:
    """Check every format that can be run against the model: the largest difference of all answers."""
    checks = []
    for to, (possible, why) in NEEDS.items():
        if not possible():
            checks.append(Check(f"{name}: {to}", None, why))
            continue
        with tempfile.TemporaryDirectory() as place:
            found = Conformance(model, Path(place)).differences(to)
        worst = max(found, key=lambda what: found[what])
        shown = f"{found[worst]:.1e} ({len(found)} answers, {worst})"
        checks.append(Check(f"{name}: {to} against the model", found[worst], shown, "at most", 1e-9, "1e-09"))
    return [*checks, _forward(name, model)]


def _forward(name: str, model: ArmModel) -> Check:
    """Compare motion from efforts, in C and as units, with the simulation."""
    possible, why = NEEDS["c"]
    what = f"{name}: motion in C and as units against simulate"
    if not possible():
        return Check(what, None, why)
    with tempfile.TemporaryDirectory() as place:
        found = Conformance(model, Path(place)).forward()
    shown = ", ".join(f"{kind} {share:.1e}" for kind, share in found.items())
    return Check(what, max(found.values()), f"{shown} of what each goes through", "at most", 1e-4, "1e-04")


def _made_up(
    twists: Sequence[float] | None, effects: Sequence[tuple[str, int | None, dict[str, float], float]]
) -> ArmModel:
    """Make the demonstration's arm, with twist angles in rad if given, numbers of its size and effects."""
    machine = load_machine(Path(sim_backends.__file__).parent / "machines" / "folding_arm.yaml")
    if twists is not None:
        joints = [
            joint.model_copy(update={"dh": joint.dh.model_copy(update={"alpha": twist, "d": 0.1})})
            for joint, twist in zip(machine.joints, twists, strict=True)
        ]
        machine = machine.model_copy(update={"joints": tuple(joints)})
    base, n = reduce_parameters(machine), len(machine.joints)
    rng = np.random.default_rng(3)
    links = []
    for mass in np.geomspace(120.0, 4.0, n):
        centre = np.array([-0.3, 0.03, 0.02]) + 0.05 * rng.normal(size=3)
        about = mass * (0.04 * np.eye(3) + centre @ centre * np.eye(3) - np.outer(centre, centre))
        links.append([mass, *(mass * centre), *about[np.triu_indices(3)]])
    sizes = {"m": 8.0, "K": 300.0, "f_c": 90.0, "f_v": 800.0, "f_s": 50.0}
    drive = [sizes[name] for names in drive_names(machine) for name in names]
    ranges = tuple(
        Ranges((0.0, joint.cylinder.stroke if joint.cylinder else 1.0), 0.3, 5e4, (0.0, 60.0))
        for joint in machine.joints
    )
    terms = tuple(Term(effect(own), joint, shape) for own, joint, shape, _ in effects)
    values = [
        value * (-1.0 / 0.15 if own == "position_dependent_friction" else 1.0) ** np.arange(len(effect(own).parameters))
        for own, _, _, value in effects
    ]
    theta = np.concatenate([drive, base.from_standard(np.concatenate(links)), *values])
    return ArmModel(
        machine=machine,
        steps=(),
        base=base,
        bandwidth_hz=3.0,
        noise=(PositionNoise(1e-5, 1e-4, 1e-3),) * n,
        terms=terms,
        passes=(Pass(theta, ranges, (None,) * n),),
        covariance=np.diag((0.01 * theta) ** 2),
        told=np.ones(len(theta), dtype=bool),
        residual_std=np.ones(n),
        provenance=Provenance(datetime.now(UTC).isoformat(timespec="seconds"), {}, (), "not_examined"),
    )


def _exports(name: str, model: ArmModel) -> list[Check]:
    """Check tables, engines and times on states that no file holds."""
    q, qd, qdd, _ = states(model, 400)
    links = np.asarray(base_regressor(model.arm, model.base, q, qd, qdd) @ model.theta[model.parameters.base_slice])
    checks = []
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        ours = _compiled(model, folder)
        if ours is not None:
            checks.append(Check(f"{name}: size of the C's object code", ours[1], f"{ours[1] / 1000:.1f} kB"))
        checks += _tables(name, model, folder / "csv")
        if find_spec("cvxpy") is not None:
            checks += _engines(name, model, folder, (q, qd, qdd), links, None if ours is None else ours[0])
    return checks


def _compiled(model: ArmModel, folder: Path) -> tuple[ctypes.CDLL, int] | None:
    """Compile the C as a library, with a loop around it; return its object size too; None without a compiler."""
    if not NEEDS["c"][0]():
        return None
    name, n = identifier(model.machine.name), len(model.joints)
    export_model(model, "c", folder)
    (folder / "many.c").write_bytes(Path(__file__).with_name("many.c").read_bytes())
    (folder / "model.h").write_text(
        f'#include "{name}.h"\n#define JOINTS {n}\n#define INVERSE_DYNAMICS {name}_inverse_dynamics\n'
    )
    run_command(["cc", *STRICT, "-fPIC", "-c", f"{name}.c"], folder)
    library = compiled(folder, f"{name}.c", "many.c")
    library.many.restype = ctypes.c_double
    return library, (folder / f"{name}.o").stat().st_size


def _engines(
    name: str,
    model: ArmModel,
    folder: Path,
    state: tuple[FloatArray, FloatArray, FloatArray],
    links: FloatArray,
    library: ctypes.CDLL | None,
) -> list[Check]:
    """Check URDF in Pinocchio and MJCF in MuJoCo against the links, and Pinocchio's time beside C's."""
    checks = []

    def differs(what: str, found: FloatArray) -> None:
        share = float(np.max(np.abs(found - links)) / np.max(np.abs(links)))
        checks.append(figure(f"{name}: {what} against the links", share, "{:.1e}", most=1e-6))

    pinocchio, mujoco = installed("pinocchio"), installed("mujoco")
    if mujoco is not None:
        export_model(model, "mjcf", folder / "arm.xml")
        plant = mujoco.MjModel.from_xml_path(str(folder / "arm.xml"))
        plant.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        for own in (plant.tendon_stiffness, plant.tendon_damping, plant.tendon_armature):  # cylinders are no links
            own[:] = 0.0
        data, rows = mujoco.MjData(plant), []
        for data.qpos[:], data.qvel[:], data.qacc[:] in zip(*state, strict=True):
            mujoco.mj_inverse(plant, data)
            rows.append(data.qfrc_inverse.copy())
        differs("MJCF in MuJoCo", np.array(rows))
    if pinocchio is None:
        return [*checks, Check(f"{name}: Pinocchio", None, "is not installed (pip install 'hilfit[bench]')")]
    export_model(model, "urdf", folder / "arm.urdf")
    arm = pinocchio.buildModelFromUrdf(str(folder / "arm.urdf"))
    arm.gravity.linear = np.array(model.arm.gravity)
    scratch = arm.createData()
    differs("URDF in Pinocchio", np.array([pinocchio.rnea(arm, scratch, *row) for row in zip(*state, strict=True)]))
    return checks if library is None else [*checks, _time(name, library, pinocchio, arm, state)]


def _time(
    name: str, library: ctypes.CDLL, pinocchio: ModuleType, arm: Any, state: tuple[FloatArray, FloatArray, FloatArray]
) -> Check:
    """Time a call of the C, in a loop of C, beside Pinocchio's, less what a call from Python costs."""
    rows = np.ascontiguousarray(np.hstack(state))
    pointer, count = rows.ctypes.data_as(ctypes.POINTER(ctypes.c_double)), len(rows)
    scratch, (q, qd, qdd) = arm.createData(), (values[0].copy() for values in state)
    calls = _CALLS // 4
    # Processor time, taken in turns: what else the computer does meets all of them alike; the shortest count.
    times = np.array(
        [
            (
                timeit.timeit(lambda: library.many(pointer, count, _CALLS), number=1, timer=thread_time) / _CALLS,
                timeit.timeit(lambda: pinocchio.rnea(arm, scratch, q, qd, qdd), number=calls, timer=thread_time)
                / calls,
                timeit.timeit(lambda: pinocchio.integrate(arm, q, qd), number=calls, timer=thread_time) / calls,
            )
            for _ in range(_REPEATS)
        ]
    ).min(axis=0)
    ours, theirs, call = times.tolist()
    ratio = ours / max(theirs - call, 1e-12)
    shown = (
        f"{ratio:.2f}: {1e9 * ours:.0f} ns with friction and an effect, RNEA {1e9 * (theirs - call):.0f} ns "
        f"({1e9 * theirs:.0f} ns from Python, less {1e9 * call:.0f} ns for the call: one that adds two vectors)"
    )
    return Check(f"{name}: time of the C over Pinocchio's RNEA", ratio, shown, "at most", 0.5, "half")


def installed(name: str) -> ModuleType | None:
    """Import a module, None where it is not installed."""
    return importlib.import_module(name) if find_spec(name) is not None else None


def _trials(samples: Path, data: Path) -> tuple[dict[str, Trial], list[tuple[str, Path]]]:
    """Collect machine and recordings by name, and what was not found."""
    found: dict[str, Trial] = {}
    missing = []
    for case in (*CASES, *LAWS):
        folder = samples / case.partition(" ")[0]
        if not folder.is_dir():
            missing.append((case, samples))
            continue
        machine = load_machine(folder / "machine.yaml")
        files = [(path.stem.partition("-")[0], path) for path in sorted(folder.glob("*.parquet"))]
        found[case] = machine, [read_recording(path, machine, role) for role, path in files]
    for name, folder_name in sets.FOLDERS.items():
        with tempfile.TemporaryDirectory() as place:
            measured = sets.read(name, data, Path(place))
        if measured is None:
            missing.append((folder_name, data))
            continue
        machine, recordings = measured
        if len(recordings) == 1:  # the first three quarters to fit, the rest to predict
            recordings = list(sets.cut(recordings[0], 0.75))
        found[folder_name] = machine, recordings
    return found, missing


def _model_of(name: str, trial: Trial) -> ArmModel:
    """Return the model of a trial, with the effects that are there or the law in their place."""
    session = Session(*trial, Options(loop=False))
    terms = [Term(effect(own), joint, shape) for own, joint, shape in CASES.get(name, ())]
    if name in LAWS:
        signal, joint = LAWS[name]
        views, law = session.base_model.views, Law(signal, None, name != "bent-guide-joint1", False, (0.0, 1.0))
        values = np.concatenate([law.values(views[index][joint]) for index in session.plain.fitted])
        terms.append(Term(replace(law, knots=tuple(spline_knots(values, OWN_FUNCTIONS).tolist())), joint))
    return handed_over(session, terms)


def _band(name: str, trial: Trial, model: ArmModel) -> list[Check]:
    """Check the share of held-out samples in the 95 % band, and its width over what the errors are."""
    found = [predict(model, own) for own in trial[1] if own.role == "validate"]
    inside = np.sum([own.coverage * own.moving.sum(axis=0) for own in found], axis=0)
    shares = inside / np.sum([own.moving.sum(axis=0) for own in found], axis=0)
    overall = float(inside.sum() / np.sum([own.moving.sum() for own in found]))
    widths = [
        np.median(own.std[own.moving[:, k], k]) / np.sqrt(np.mean(own.residual[own.moving[:, k], k] ** 2))
        for own in found
        for k in range(len(own.joints))
    ]
    sentences = narrow(model)
    shown = f"{overall:.1%} (by joint {', '.join(f'{share:.1%}' for share in shares)}; {len(sentences)} sentences)"
    what = f"{name}: in the 95 % band of another motion"
    width = f"{max(widths):.2f} (by joint {', '.join(f'{own:.2f}' for own in widths)})"
    known = name in CASES or name in LAWS
    checks = [Check(what, overall, shown, *(("at least", 0.93, "93 %") if known else ()))]
    if known:
        checks.append(Check(f"{name}: the same, from above", overall, shown, "at most", 0.97, "97 %"))
        checks.append(Check(f"{name}: middle width over the true deviation", max(widths), width, "at most", 1.5, "1.5"))
    else:
        silent = sum(not 0.92 <= own <= 0.98 for own in shares) - len(sentences)
        checks.append(figure(f"{name}: joints outside 92 to 98 % that nothing is said of", silent, most=0))
    return checks


def _moves(name: str, model: ArmModel) -> list[Check]:
    """Check motions and links of a model, or one line of refusal; and of the nearest movable one."""
    middle = np.array([np.mean(joint.limits.position) for joint in model.machine.joints])
    held = motion.gravity(model, middle)[0]

    def links(folder: Path, possible: bool) -> object:
        return export_model(model, "urdf", folder / "arm.urdf", possible=possible)

    def moved(folder: Path, possible: bool) -> object:
        return simulate(model, lambda *_: held, middle, seconds=0.02, possible=possible)

    answers = []
    with tempfile.TemporaryDirectory() as place:
        for possible in (False, True):
            for call in (links, moved):
                try:
                    call(Path(place), possible)
                    answers.append("done")
                except InputError as error:
                    answers.append("refused" if "\n" not in str(error) else "refused in several lines")
    price = motion.price(model, motion.nearest_possible(model))
    shown = f"links {answers[0]}, motion {answers[1]}; possible: {answers[2]}, {answers[3]}"
    shown += "" if price is None else f", at {100 * price:+.1f} % of error"
    return [Check(f"{name}: moves, refused with --possible", answers[2:].count("refused"), shown, "at most", 0, "0")]


_TABLE_POINTS = 4000


def _tables(name: str, model: ArmModel, folder: Path) -> list[Check]:
    """Check drives' friction by table between rows: share of the largest value, and of the stated error."""
    done = export_model(model, "csv", folder)
    with (folder / "tables.csv").open(encoding="utf-8") as file:
        index = {row["value"]: row for row in csv.DictReader(file)}
    rng, limits = np.random.default_rng(7), np.array([joint.limits.position for joint in model.machine.joints])
    q = rng.uniform(limits[:, 0], limits[:, 1], (_TABLE_POINTS, len(limits)))
    lever = motion.levers(model, q)
    shares, stated = [], []
    for k, joint in enumerate(model.joints):
        row = index.get(f"friction_{joint}")
        if row is None:
            continue
        table = _interpolated(folder / row["file"])
        speed = rng.uniform(-1.0, 1.0, _TABLE_POINTS) * float(np.max(table.grid[0]))
        qd = np.zeros_like(q)
        qd[:, k] = speed / lever[:, k]
        right = motion.friction(model, q, qd)[:, k] / lever[:, k]
        points = np.column_stack([speed, q[:, k]])[:, : len(table.grid)]
        error = float(np.max(np.abs(table(points) - right)))
        shares.append(error / float(np.max(np.abs(right))))
        stated.append(error / float(row["interpolation_error"]))
    shown = f"{max(shares):.1e} of the largest value, {max(stated):.2f} of the error that tables.csv states"
    shown += f" ({len(index)} tables, {len(done.left_out)} left out, {sum(p.stat().st_size for p in done.files)} bytes)"
    return [figure(f"{name}: friction by tables between their rows", max(stated), "{:g} of it", most=1.2, shown=shown)]


def _interpolated(path: Path) -> RegularGridInterpolator:
    rows = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)
    axes = [np.unique(column) for column in rows[:, :-1].T]
    return RegularGridInterpolator(axes, rows[:, -1].reshape([len(axis) for axis in axes]))
