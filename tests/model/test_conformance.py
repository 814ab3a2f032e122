"""Every format against the model, on models with each memory, a law, faults of sensors, joints that slide."""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from model_examples import law_of, model_with, session_of, term_of
from synthetic_arm import make_motion

from benchmarks.exports.conformance import NEEDS, Answers, Conformance
from daq.errors import InputError
from fitting.effects import effect
from fitting.model import motion
from fitting.model.arm_model import ArmModel
from fitting.model.evaluation import without
from fitting.model.export import export_model
from fitting.model.export.functions import identifier
from fitting.model.export.tracing.tracing import Tracer
from fitting.residual.terms import Term

MEMORIES = ("presliding_hysteresis", "lubricant_film_lag", "carried_liquid")
FAULTS = ("pressure_offset", "pressure_gain", "pressure_drift", "sensor_latency")


def model_of_terms(names: Sequence[str], kinds: str | None = None) -> ArmModel:
    session = session_of(len(kinds) if kinds else 2, kinds)
    return model_with(
        [term_of(session, name, 1 if len(names) == 1 else k % 2) for k, name in enumerate(names)], session
    )


def everything() -> ArmModel:
    session = session_of(2)
    names = (*MEMORIES, "stribeck", "base_tilt", "load_dependent_friction", "pressure_offset")
    names += ("position_dependent_friction",)
    terms = [term_of(session, name, number % 2) for number, name in enumerate(names)]
    return model_with([*terms, law_of(session, "piston_position", 1, signed=True)], session)


MODELS: dict[str, Callable[[], ArmModel]] = {
    **{name: lambda name=name: model_of_terms([name]) for name in (*MEMORIES, *FAULTS)},  # type: ignore[misc]
    "law": lambda: model_with([law_of(session_of(2), "piston_position", 1)], session_of(2)),
    "slides": lambda: model_of_terms(["presliding_hysteresis"], "RPR"),
    "direct": lambda: model_of_terms(["stribeck"], "rR"),
    "everything": everything,
}


def assert_conforms(model: ArmModel, to: str, folder: Path) -> None:
    possible, why = NEEDS[to]
    if not possible():
        pytest.skip(why)
    found = Conformance(model, folder).differences(to)
    assert found and max(found.values()) <= 1e-9, found


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELS)
def test_python_says_what_the_model_says(name: str, tmp_path: Path) -> None:
    assert_conforms(MODELS[name](), "python", tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("to", sorted(set(NEEDS) - {"python"}))
@pytest.mark.parametrize("name", ["everything", "slides", "direct"])
def test_other_formats_say_what_the_model_says(name: str, to: str, tmp_path: Path) -> None:
    assert_conforms(MODELS[name](), to, tmp_path)


class Both(Conformance):
    """A format that has what it says to leave out."""

    def python(self) -> Answers:
        """Answer what the module does, and that."""
        answers = super().python()
        (name,) = self.gone
        return answers | {name: np.ones(1), f"right.{name}": np.ones(1)}


def test_what_a_format_has_it_must_not_say_to_leave_out(tmp_path: Path) -> None:
    model = model_of_terms(["pressure_offset"])
    assert Conformance(model, tmp_path).differences("python")
    with pytest.raises(AssertionError, match="the export has an offset of a pressure sensor at joint2, and says"):
        Both(model, tmp_path).differences("python")


@pytest.mark.parametrize("name", MEMORIES)
def test_a_history_is_carried_and_counts(name: str) -> None:
    model = model_of_terms([name])
    tracer = Tracer(model)
    assert not tracer.left_out and 1 <= len(tracer.memory) <= 2
    moved = make_motion(model.machine, "validate", 4, 3.0)
    rows = moved.q, moved.qd, moved.qdd, moved.t
    whole = motion.on_motion(model, *rows).joint_effort(0)
    settled = motion.on_motion(motion.at_rest(model), *rows).joint_effort(0)
    assert np.max(np.abs(whole - settled)) > 1e-3 * np.max(np.abs(whole))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["structural_flexibility", "time_since_reversal", "distance_since_reversal"])
def test_what_is_no_recurrence_is_named_and_left_out(name: str) -> None:
    session = session_of(2)
    term = law_of(session, name, 1) if "reversal" in name else term_of(session, name, 1)
    (line,) = Tracer(model_with([term], session)).left_out
    assert "what it remembers" in line


@pytest.mark.slow
@given(st.floats(25.0, 400.0))
@settings(max_examples=8, deadline=None)
def test_a_history_goes_on_at_any_rate(rate: float) -> None:
    """A film's lag is a first-order one in time: at every rate it is the equation's own solution."""
    model = LAG
    term = model.terms[0]
    t = np.arange(round(2.0 * rate)) / rate
    q = np.column_stack([0.0 * t, 0.2 * np.sin(3.0 * t)])
    qd, qdd = np.gradient(q, t, axis=0), np.gradient(np.gradient(q, t, axis=0), t, axis=0)
    found = motion.on_motion(model, q, qd, qdd, t)
    without_it = motion.on_motion(without(model, {0}), q, qd, qdd, t)
    part = (found.drive_effort(0) - without_it.drive_effort(0))[:, 1] / model.theta[-1]
    view = found.views(0)[1]
    steady, film = np.abs(view.power(term.shape["n"])), 0.0
    film = steady[0]
    for k, own in enumerate(steady):
        film += (1.0 - np.exp(-1.0 / (rate * term.shape["tau"]))) * (own - film)
        assert part[k] == pytest.approx(view.s[k] * (own - film), abs=1e-9 * max(steady))


LAG = model_of_terms(["lubricant_film_lag"])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["presliding_hysteresis", "structural_flexibility"])
def test_a_motion_without_its_times_is_refused_where_the_model_needs_them(name: str) -> None:
    model = model_of_terms([name])
    moved = make_motion(model.machine, "validate", 4, 3.0)
    rows = moved.q, moved.qd, moved.qdd
    uneven = moved.t.copy()
    uneven[7] += 0.004
    for times in (None, uneven, moved.t[::-1], 0.0 * moved.t):
        with pytest.raises(InputError, match=f"{name} needs the motion before each moment; give t=") as caught:
            motion.on_motion(model, *rows, times)
        assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match="needs 15 rows a second or more"):
        motion.on_motion(model, *(own[::10] for own in rows), moved.t[::10])


@pytest.mark.slow
@pytest.mark.parametrize("name", FAULTS)
def test_faults_of_sensors_are_no_forces_of_the_machine(name: str) -> None:
    session = session_of(2)
    rebuilt = (0.031,) if name == "sensor_latency" else ()
    term = Term(effect(name), 1, term_of(session, name, 1).shape, rebuilt)
    model = model_with([term], session)
    moved = make_motion(model.machine, "validate", 4, 3.0)
    rows = moved.q, moved.qd, moved.qdd, moved.t
    plain = motion.on_motion(without(model, {0}), *rows).joint_effort(0)
    np.testing.assert_array_equal(motion.on_motion(model, *rows).joint_effort(0), plain)
    (line,) = Tracer(model).left_out
    assert line.endswith("it belongs to the sensors")


@pytest.mark.parametrize("name", ["base_tilt", "hose_stiffness", "asymmetric_friction"])
def test_gravity_is_the_effort_at_rest(name: str) -> None:
    model = model_of_terms([name])
    q = np.random.default_rng(3).uniform(-0.5, 0.5, (20, 2))
    at_rest = motion.on_motion(model, q, 0 * q, 0 * q).joint_effort(0)
    np.testing.assert_allclose(motion.gravity(model, q), at_rest, rtol=1e-12)
    assert np.max(np.abs(at_rest - motion.gravity(without(model, {0}), q))) > 1e-3 * np.max(np.abs(at_rest))


@pytest.mark.slow
def test_the_self_test_fails_where_a_memory_is_wrong(tmp_path: Path) -> None:
    if not NEEDS["c"][0]():
        pytest.skip(NEEDS["c"][1])
    model = model_of_terms(["presliding_hysteresis"])
    export_model(model, "c", tmp_path)
    name = identifier(model.machine.name)
    source = tmp_path / f"{name}.c"
    text = source.read_text(encoding="utf-8")
    assert "    memory[1] = " in text
    source.write_text(text.replace("    memory[1] = ", "    memory[1] = 1.01 * "), encoding="utf-8")
    subprocess.run(["cc", "-o", "selftest", source.name, f"{name}_selftest.c", "-lm"], cwd=tmp_path, check=True)
    assert subprocess.run([tmp_path / "selftest"], capture_output=True, timeout=30).returncode == 1
