"""Motion from efforts outside of hilfit: the exported C and FMU beside :func:`fitting.model.simulation.simulate`."""

from __future__ import annotations

import ctypes
import subprocess
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from model_examples import model_with, session_of, term_of, true_model
from synthetic_arm import truth
from test_exports import needs_compiler
from test_more_exports import needs_fmpy

from benchmarks.exports.conformance import NEEDS, STRICT
from fitting.model import motion
from fitting.model.arm_model import ArmModel
from fitting.model.export import export_model
from fitting.model.export.functions import identifier
from fitting.model.simulation import simulate

PERIOD, STEPS = 0.02, 25
#: Largest difference of positions and speeds, as a share of what each of them goes through.
TOLERANCE = 1e-4


@cache
def exact() -> ArmModel:
    session = session_of(2)
    return true_model(session.machine, truth(2), session)


def held_by_force() -> ArmModel:
    """Friction that grows with the force: an acceleration is in its own equation."""
    session = session_of(2)
    names = ("load_dependent_friction", "stribeck", "presliding_hysteresis")
    return model_with([term_of(session, name, n % 2) for n, name in enumerate(names)], session, 3.0)


def slides() -> ArmModel:
    return model_with((), session_of(3, "RPr"))


MODELS: dict[str, Callable[[], ArmModel]] = {"exact": exact, "held by force": held_by_force, "slides": slides}


class Compiled:
    """The exported C of forward dynamics; the test is skipped where there is no compiler."""

    def __init__(self, model: ArmModel, folder: Path, possible: bool = False) -> None:
        if not NEEDS["c"][0]():
            pytest.skip(NEEDS["c"][1])
        self.n, self.done = len(model.joints), export_model(model, "c", folder, possible=possible)
        self.name = f"{identifier(model.machine.name)}_forward"
        command = ["cc", *STRICT, "-fPIC", "-shared", "-o", "forward.so", f"{self.name}.c", "-lm"]
        subprocess.run(command, cwd=folder, check=True)
        self.library = ctypes.CDLL(str(folder / "forward.so"))
        self.state = (ctypes.c_double * (2 * self.n + 1))()

    def call(self, name: str, *given: object) -> int:
        own = [
            ctypes.c_double(x) if isinstance(x, float) else (ctypes.c_double * len(x))(*x) if isinstance(x, list) else x
            for x in given
        ]
        return int(getattr(self.library, f"{self.name}_{name}")(*own))


def start_and_efforts(model: ArmModel, oil: float | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Where the arm begins, at rest, and joint efforts of each period: what holds it there, and swings about that."""
    middle = np.array([np.mean(joint.limits.position) for joint in model.machine.joints])
    held, n = motion.gravity(model, middle, temperature=oil)[0], len(middle)
    rest = motion.inertia_matrix(model, middle)[0].diagonal()
    rub = motion.friction(model, middle, 0.1 + 0.0 * middle, temperature=oil)[0]
    size = 8.0 * np.abs(rest) + 1.2 * np.abs(rub)
    t = PERIOD * np.arange(STEPS)[:, None]
    return middle, held + size * np.sin(9.0 * t + 1.0 + np.arange(n))


def simulated(model: ArmModel, q: np.ndarray, efforts: np.ndarray) -> np.ndarray:
    """Positions and speeds at the end of each period, (STEPS + 1, 2 n)."""
    rows, n = [np.concatenate([q, 0 * q])], len(q)
    for held in efforts:
        before = rows[-1][:n], rows[-1][n:]
        own = simulate(model, lambda *_, held=held: held, *before, seconds=PERIOD, rate_hz=1 / PERIOD)
        rows.append(np.concatenate([own.q[-1], own.qd[-1]]))
    return np.array(rows)


@cache
def simulated_exactly() -> np.ndarray:
    return simulated(exact(), *start_and_efforts(exact()))


def assert_same_motion(found: np.ndarray, right: np.ndarray) -> None:
    through = np.ptp(right, axis=0)
    assert np.all(through[: through.size // 2] > 1e-4)
    assert np.max(np.abs(found - right) / through) <= TOLERANCE


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELS)
def test_the_c_moves_as_the_simulation_does(name: str, tmp_path: Path) -> None:
    model = motion.nearest_possible(MODELS[name]())
    q, efforts = start_and_efforts(model)
    own = Compiled(model, tmp_path)
    own.call("init", q.tolist(), [0.0] * own.n, own.state)
    rows = [list(own.state)[: 2 * own.n]]
    for k, effort in enumerate(efforts.tolist()):
        assert own.call("step", own.state, effort, PERIOD * k, PERIOD) == 0
        rows.append(list(own.state)[: 2 * own.n])
    assert_same_motion(np.array(rows), simulated(model, q, efforts))
    if name == "held by force":
        assert "forward dynamics: what remembers is settled in it" in own.done.left_out


@pytest.mark.slow
@needs_compiler
@needs_fmpy
@pytest.mark.parametrize("version", [2, 3])
def test_the_unit_moves_as_the_simulation_does(version: int, tmp_path: Path) -> None:
    """Half of every effort as an effort, half as the pressure of a head: both at once."""
    from fmpy import simulate_fmu

    model = exact()
    q, efforts = start_and_efforts(model)
    right = simulated_exactly()
    export_model(model, "fmu", tmp_path)
    (path,) = tmp_path.glob(f"*_forward_fmi{version}.fmu")
    names = [f"{word}[{k + 1}]" for word in ("effort", "head", "rod") for k in range(len(q))]
    inputs = np.zeros(2 * STEPS, dtype=[("time", float), *((name, float) for name in names)])
    inputs["time"] = np.repeat(PERIOD * np.arange(STEPS), 2) + np.tile([0.0, PERIOD], STEPS)
    for k, joint in enumerate(model.arm.joints):
        assert joint.cylinder is not None
        inputs[f"effort[{k + 1}]"] = np.repeat(efforts[:, k], 2)
        inputs[f"rod[{k + 1}]"] = 6e5
        inputs[f"head[{k + 1}]"] = 6e5 * joint.cylinder.rod_area / joint.cylinder.head_area  # a force of zero
    found = simulate_fmu(
        str(path),
        input=inputs,
        start_values={f"q_start[{k + 1}]": own for k, own in enumerate(q.tolist())},
        output=[f"{word}[{k + 1}]" for word in ("q", "qd", "qdd") for k in range(len(q))],
        start_time=0.0,
        stop_time=PERIOD * STEPS,
        output_interval=PERIOD,
        step_size=PERIOD,
    )
    rows = np.column_stack([found[f"{word}[{k + 1}]"] for word in ("q", "qd") for k in range(len(q))])
    assert_same_motion(rows, right)
    first = motion.forward(motion.integrable(model), q, 0 * q, effort=efforts[0])[0]
    np.testing.assert_allclose([found[f"qdd[{k + 1}]"][0] for k in range(len(q))], first, rtol=1e-9)


@pytest.mark.slow
def test_pressures_are_efforts_by_areas_and_lever_arms(tmp_path: Path) -> None:
    model = MODELS["slides"]()
    own, q = Compiled(motion.nearest_possible(model), tmp_path), np.array([0.2, 0.2, -0.1])
    head, rod = np.array([1e6, 2e6, 3e6]), np.array([4e5, 5e5, 6e5])
    tau = (ctypes.c_double * 3)()
    own.call("pressed", q.tolist(), head.tolist(), rod.tolist(), tau)
    right = [
        0.0 if j.cylinder is None else lever * (j.cylinder.head_area * p1 - j.cylinder.rod_area * p2)
        for j, lever, p1, p2 in zip(model.arm.joints, motion.levers(model, q[None])[0], head, rod, strict=True)
    ]
    np.testing.assert_allclose(list(tau), right, rtol=1e-12)


def with_inertia(value: float) -> ArmModel:
    """The exact arm with another moving mass of its second cylinder."""
    model = exact()
    theta = model.theta.copy()
    theta[model.parameter_names.index("joint2.m")] = value
    return replace(model, passes=(replace(model.passes[-1], theta=theta),))


def test_a_model_that_cannot_move_has_no_forward_dynamics_without_possible(tmp_path: Path) -> None:
    model = with_inertia(-1e4)
    done = export_model(model, "c", tmp_path)
    (line,) = (own for own in done.left_out if own.startswith("forward dynamics"))
    assert "not positive definite" in line and "--possible" in line
    assert not [path for path in done.files if "forward" in path.name]
    again = export_model(model, "c", tmp_path, possible=True)
    assert any("none is below zero here" in own for own in again.left_out)
    assert [path.name for path in again.files if "forward" in path.name] == [
        f"{identifier(model.machine.name)}_forward.{end}" for end in "hc"
    ]


@pytest.mark.slow
def test_the_c_says_why_there_is_no_motion(tmp_path: Path) -> None:
    """A mass matrix that is not positive definite; an effort that is not a number. Nothing hangs."""
    own = Compiled(exact(), tmp_path)
    source = tmp_path / f"{own.name}.c"
    text = source.read_text(encoding="utf-8")
    assert "    matrix[3] = " in text
    source.write_text(text.replace("    matrix[3] = ", "    matrix[3] = -1.0 * "), encoding="utf-8")
    subprocess.run(["cc", "-fPIC", "-shared", "-o", "wrong.so", source.name, "-lm"], cwd=tmp_path, check=True)
    qdd, zero = (ctypes.c_double * 2)(), [0.0, 0.0]
    assert own.call("acceleration", zero, zero, [np.nan, 0.0], 0.0, qdd) == 2
    own.library = ctypes.CDLL(str(tmp_path / "wrong.so"))
    assert own.call("acceleration", zero, zero, zero, 0.0, qdd) == 1
    own.call("init", zero, zero, own.state)
    assert own.call("step", own.state, zero, 0.0, 0.02) == 1 and list(own.state)[:4] == [0.0] * 4
