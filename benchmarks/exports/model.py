"""The model outside its report: exports against it, C's time beside Pinocchio, and what the 95 % band is worth.

Exports and times are of two made-up arms with six cylinders, friction, stiffness and one effect: six parallel axes, and
six twisted ones. The band is tried on the sample recordings of an independent plant, with the effects that are really
there, and on measured machines without any; what those have that the model lacks is no noise, so their share is only
shown.
"""

from __future__ import annotations

import ctypes
import importlib
import shutil
import subprocess
import tempfile
import timeit
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import numpy.typing as npt

import sim_backends
from benchmarks.exports.model_formats import formats
from benchmarks.measured import DATA, emps, staubli
from benchmarks.samples import SAMPLES
from benchmarks.targets import Check, Outcome
from daq.machine.machine_file import Machine, load_machine
from daq.recordings.recording import Recording, read_recording
from fitting.arm.base_parameters import base_regressor, reduce_parameters
from fitting.effects import effect
from fitting.effects.base import Ranges
from fitting.loop.residual_loop import final_model
from fitting.loop.session import Options, Session
from fitting.model import motion
from fitting.model.arm_model import ArmModel, Pass, Provenance
from fitting.model.export import export_model
from fitting.model.export.bodies import bodies_of
from fitting.model.export.functions import identifier, states
from fitting.model.handover import hand_over
from fitting.model.prediction import predict
from fitting.regression.drive import drive_names
from fitting.residual.terms import Term
from fitting.signals.corrections import Corrections
from fitting.signals.preparation import PositionNoise

FloatArray = npt.NDArray[np.float64]
Trial = tuple[Machine, list[Recording]]

#: Settings under which the C has to compile without a word.
STRICT = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-Werror", "-O2")
TWISTS = {"six parallel axes": None, "six axes, twisted": (np.pi / 2, 0.0, np.pi / 2, -np.pi / 2, np.pi / 2, 0.0)}
#: Sample cases, and the effects that are really there: name, joint, shape.
CASES: dict[str, tuple[tuple[str, int | None, dict[str, float]], ...]] = {
    "nothing-missing": (),
    "position-friction-joint2": (("position_dependent_friction", 1, {}),),
    "load-friction-joint2": (("load_dependent_friction", 1, {"knee": 0.0}),),
    "tilted-base": (("base_tilt", None, {}),),
}
_CALLS, _REPEATS = 100_000, 9
_TIMER = """#include "{name}.h"
double many(const double *rows, int count, int times);
double many(const double *rows, int count, int times)
{{
    double tau[{n}], sum = 0;
    int k;
    for (k = 0; k < times; ++k) {{
        const double *row = rows + (k % count) * {width};
        {name}_inverse_dynamics(row, row + {n}, row + 2 * {n}, 0.0, tau);
        sum += tau[0];
    }}
    return sum;
}}
"""


def run(samples: Path = SAMPLES, data: Path = DATA, show: Callable[[str], None] = lambda line: None) -> Outcome:
    """All checks.

    Parameters
    ----------
    samples, data : folders with the sample cases and the measured data; what is not there is noted and skipped
    show : told what is being worked on
    """
    checks: list[Check] = []
    notes: list[str] = []
    for name, twists in TWISTS.items():
        show(name)
        checks += _exports(name, made_up(twists))
    trials, missing = _trials(samples, data)
    notes += [f"{name}: no data in {folder}, skipped" for name, folder in missing]
    for name, trial in trials.items():
        show(name)
        checks += _band(name, trial)
    return Outcome(tuple(checks), tuple(notes))


def made_up(twists: Sequence[float] | None) -> ArmModel:
    """The demonstration's arm, with twist angles in rad if given, and numbers of its size; friction of one in place."""
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
    worn = effect("position_dependent_friction")
    wear = 1200.0 * (-1.0 / 0.15) ** np.arange(len(worn.parameters))
    theta = np.concatenate([drive, base.from_standard(np.concatenate(links)), wear])
    return ArmModel(
        machine=machine,
        steps=(),
        base=base,
        bandwidth_hz=3.0,
        noise=(PositionNoise(1e-5, 1e-4, 1e-3),) * n,
        terms=(Term(worn, 1),),
        passes=(Pass(theta, ranges, (None,) * n),),
        covariance=np.diag((0.01 * theta) ** 2),
        told=np.ones(len(theta), dtype=bool),
        residual_std=np.ones(n),
        provenance=Provenance(datetime.now(UTC).isoformat(timespec="seconds"), {}, (), "not_examined"),
    )


def _exports(name: str, model: ArmModel) -> list[Check]:
    """Every format against the model on states that no file holds, and the time of C."""
    n = len(model.joints)
    q, qd, qdd, _ = states(model, 400)
    t = np.zeros(len(q))
    expected = motion.on_motion(model, q, qd, qdd, t).joint_effort(0)
    links = np.asarray(base_regressor(model.arm, model.base, q, qd, qdd) @ model.theta[model.parameters.base_slice])
    checks = []

    def differs(what: str, found: FloatArray, right: FloatArray, most: float) -> None:
        share = float(np.max(np.abs(found - right)) / np.max(np.abs(right)))
        checks.append(Check(f"{name}: {what} against the model", share, f"{share:.1e}", "at most", most, f"{most:.0e}"))

    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        export_model(model, "python", folder / "arm.py")
        answers: dict[str, Any] = {}
        exec((folder / "arm.py").read_text(encoding="utf-8"), answers)
        differs("python", answers["inverse_dynamics"](q, qd, qdd, t), expected, 1e-9)
        ours = _compiled(model, folder)
        if ours is None:
            checks.append(Check(f"{name}: C", None, "there is no compiler (cc)"))
        else:
            library, size = ours
            function = getattr(library, f"{identifier(model.machine.name)}_inverse_dynamics")
            array = ctypes.c_double * n
            rows = []
            for row in zip(q, qd, qdd, strict=True):
                tau = array()
                function(*(array(*values) for values in row), ctypes.c_double(0.0), tau)
                rows.append(list(tau))
            differs("C", np.array(rows), expected, 1e-9)
            checks.append(Check(f"{name}: size of the C's object code", size, f"{size / 1000:.1f} kB"))
        checks += formats(name, model, folder, (q, qd, qdd, t), expected)
        if find_spec("cvxpy") is not None:
            checks += _engines(name, model, folder, (q, qd, qdd), links, None if ours is None else ours[0])
    return checks


def _compiled(model: ArmModel, folder: Path) -> tuple[ctypes.CDLL, int] | None:
    """The C as a library, with a loop around it, and the size of its object file; None without a compiler."""
    compiler, name, n = shutil.which("cc"), identifier(model.machine.name), len(model.joints)
    if compiler is None:
        return None
    export_model(model, "c", folder)
    (folder / "many.c").write_text(_TIMER.format(name=name, n=n, width=3 * n), encoding="utf-8")
    subprocess.run([compiler, *STRICT, "-fPIC", "-c", f"{name}.c", "many.c"], cwd=folder, check=True)
    subprocess.run([compiler, "-shared", "-o", "arm.so", f"{name}.o", "many.o", "-lm"], cwd=folder, check=True)
    library = ctypes.CDLL(str(folder / "arm.so"))
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
    """URDF in Pinocchio and MJCF in MuJoCo against the links, and Pinocchio's time beside C's."""
    checks = []

    def differs(what: str, found: FloatArray) -> None:
        share = float(np.max(np.abs(found - links)) / np.max(np.abs(links)))
        checks.append(Check(f"{name}: {what} against the links", share, f"{share:.1e}", "at most", 1e-6, "1e-06"))

    moved = bodies_of(model).moved
    checks.append(Check(f"{name}: base parameters moved for links that can exist", moved, f"{moved:.2g} deviations"))
    pinocchio, mujoco = _module("pinocchio"), _module("mujoco")
    if mujoco is not None:
        export_model(model, "mjcf", folder / "arm.xml")
        plant = mujoco.MjModel.from_xml_path(str(folder / "arm.xml"))
        plant.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
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
    """Time of a call of the C, in a loop of C, beside that of Pinocchio's, less what a call from Python costs."""
    rows = np.ascontiguousarray(np.hstack(state))
    pointer, count = rows.ctypes.data_as(ctypes.POINTER(ctypes.c_double)), len(rows)
    scratch, (q, qd, qdd) = arm.createData(), (values[0].copy() for values in state)
    calls = _CALLS // 4
    # Taken in turns, so that what else the computer does meets all of them; the shortest count.
    times = np.array(
        [
            (
                timeit.timeit(lambda: library.many(pointer, count, _CALLS), number=1) / _CALLS,
                timeit.timeit(lambda: pinocchio.rnea(arm, scratch, q, qd, qdd), number=calls) / calls,
                timeit.timeit(lambda: pinocchio.integrate(arm, q, qd), number=calls) / calls,
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


def _module(name: str) -> ModuleType | None:
    return importlib.import_module(name) if find_spec(name) is not None else None


def _trials(samples: Path, data: Path) -> tuple[dict[str, Trial], list[tuple[str, Path]]]:
    """Machine and recordings by name, and what was looked for in vain."""
    found: dict[str, Trial] = {}
    missing = []
    for case in CASES:
        folder = samples / case
        if not folder.is_dir():
            missing.append((case, samples))
            continue
        files = [(path.stem.partition("-")[0], path) for path in sorted(folder.glob("*.parquet"))]
        found[case] = _read(folder / "machine.yaml", files)
    makers: dict[str, Callable[[Path, Path], Trial]] = {"emps": _emps, "staubli_tx40": _staubli, "kuka_lwr4": _kuka}
    for name, make in makers.items():
        if not (data / name).is_dir():
            missing.append((name, data))
            continue
        with tempfile.TemporaryDirectory() as place:
            found[name] = make(data / name, Path(place))
    return found, missing


def _read(machine: Path, files: Sequence[tuple[str, Path]]) -> Trial:
    described = load_machine(machine)
    return described, [read_recording(path, described, role) for role, path in files]


def _emps(data: Path, directory: Path) -> Trial:
    paths = emps.files(data, directory)
    return _read(emps.MACHINE, [(role, paths[role]) for role in ("train", "repeat", "validate")])


def _staubli(data: Path, directory: Path) -> Trial:
    """The first three quarters to fit, the rest to predict: there is one recording only."""
    machine, (whole,) = _read(staubli.MACHINE, [("train", staubli.recording(data, directory))])
    rows = 3 * len(whole) // 4
    rest = replace(whole.cut(slice(rows, len(whole))), role="validate", sha256="rest")
    return machine, [whole.cut(slice(0, rows)), rest]


def _kuka(data: Path, directory: Path) -> Trial:
    return _read(data / "machine.yaml", [(role, data / f"{role}.parquet") for role in ("train", "repeat", "validate")])


def _band(name: str, trial: Trial) -> list[Check]:
    """Share of the held-out samples that lie in the 95 % band."""
    session = Session(*trial, Options(loop=False))
    terms = [Term(effect(own), joint, shape) for own, joint, shape in CASES.get(name, ())]
    final = final_model(session, Corrections(session.machine), terms)[1].model
    report = {
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "software": {},
        "data": [{"role": r.role, "file": r.file, "sha256": r.sha256, "samples": len(r)} for r in session.recordings],
        "loop": {"verdict": "not_examined"},
    }
    model = hand_over(session, (), final, report)
    found = [predict(model, own) for own in trial[1] if own.role == "validate"]
    inside = np.sum([own.coverage * own.moving.sum(axis=0) for own in found], axis=0)
    shares = inside / np.sum([own.moving.sum(axis=0) for own in found], axis=0)
    joints = ", ".join(f"{share:.1%}" for share in shares)
    overall = float(inside.sum() / np.sum([own.moving.sum() for own in found]))
    shown = f"{overall:.1%} (by joint {joints})"
    if name not in CASES:
        return [Check(f"{name}: in the 95 % band of another motion", overall, shown)]
    return [
        Check(f"{name}: in the 95 % band of another motion", overall, shown, "at least", 0.93, "93 %"),
        Check(f"{name}: the same, from above", overall, shown, "at most", 0.97, "97 %"),
    ]
