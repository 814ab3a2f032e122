"""Laws of one signal: what is computed of the past, and that it is found."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic_arm import (
    RATE,
    USUAL,
    Motion,
    back_pressure,
    force,
    make_motion,
    make_recordings,
    make_session,
    planar_machine,
    truth,
)

from fitting.effects.base import DriveView
from fitting.effects.variables import OWN
from fitting.loop.residual_loop import run_attribution
from fitting.loop.session import Options, Session
from fitting.regression.design import Design
from fitting.regression.solving import solve
from fitting.regression.streamed import fit_rows
from fitting.residual.laws import Law, Way, laws
from fitting.residual.terms import Term, fit_model
from fitting.signals.corrections import Corrections


def ages(v: np.ndarray) -> np.ndarray:
    """Seconds since each sample's speed had another sign, by walking through them."""
    found, age = np.zeros(len(v)), 0
    for k in range(1, len(v)):
        age = 0 if np.sign(v[k]) != np.sign(v[k - 1]) else age + 1
        found[k] = age / RATE
    return found


def only_law(force_on: Callable[[Motion], np.ndarray]) -> Law:
    """The law, and nothing else, that is found where joint 2 of two has a further force on its piston, N (N,)."""
    machine, arm = planar_machine(2), truth(2)
    added = []
    for role, seed in USUAL:
        motion = make_motion(machine, role, seed, 60.0)
        extra = np.zeros_like(force(machine, arm, motion))
        extra[:, 1] = force_on(motion)
        added.append(extra)
    session = make_session(machine, arm, added=added, seconds=60.0, options=Options(bootstrap=0))
    found = run_attribution(session, Corrections(machine))
    assert found.verdict == "unexplained"
    (item,) = found.accepted
    law = item.score.term.content
    assert isinstance(law, Law) and item.score.term.joint == 1
    return law


@given(
    frequency=st.floats(0.05, 0.5), phase=st.floats(0.1, 6.0), noise=st.floats(0.0, 0.01), seed=st.integers(0, 9)
)  # fmt: skip
@settings(deadline=None, max_examples=40)
def test_time_since_reversal_is_the_time_since_a_sine_was_zero(
    frequency: float, phase: float, noise: float, seed: int
) -> None:
    t = np.arange(2000) / RATE
    v = np.sin(2 * np.pi * frequency * t + phase) + noise * np.random.default_rng(seed).standard_normal(len(t))
    view = SimpleNamespace(
        v=v, joint=0, noise=[SimpleNamespace(sign=max(noise, 1e-6))], bank=SimpleNamespace(rate_hz=RATE)
    )
    found = OWN["time_since_reversal"][1](cast(DriveView, view))
    half = 0.5 / frequency
    since = (t + phase / (2 * np.pi * frequency)) % half
    counted = t - since >= 0  # the first reversal was before the recording
    # The moment of a reversal is known as well as noise lets a zero be known; speed passes it at 2 pi f.
    slack = 2.0 / RATE + 8 * noise / (2 * np.pi * frequency)
    sure = counted & (since > slack) & (since < half - slack)
    assert np.all(np.abs(found - since)[sure] <= slack)
    assert found[0] == 0.0


@pytest.mark.parametrize(("only", "shown"), [("positive", (1.0, 0.5, 0.0)), ("negative", (0.0, 0.5, 1.0))])
def test_a_law_of_one_direction_acts_in_that_direction_only(only: Way, shown: tuple[float, ...]) -> None:
    law = Law("piston_position", None, False, False, (0.0,) * 4 + (1.0,) * 4, only)
    view = cast(DriveView, SimpleNamespace(s=np.array([1.0, 0.0, -1.0]), segment=SimpleNamespace(loaded=True)))
    assert law.acting(np.ones((3, 2)), view) == pytest.approx(np.repeat(np.array(shown)[:, None], 2, axis=1))


def test_oil_of_neighbours_acts_with_the_arm_off_and_their_poses_do_not() -> None:
    machine, arm = planar_machine(2), truth(2)
    session = Session(machine, make_recordings(machine, arm, seconds=30.0), Options(bootstrap=0))
    model = session.base_model
    found = [law for law in laws(model.views, 0, tuple(model.fitted)) if law.other is not None]
    assert {law.signal for law in found if law.loaded_only} == {"joint_position", "cylinder_force", "link_angle"}
    assert {"head_pressure", "rod_pressure", "piston_speed"} <= {law.signal for law in found if not law.loaded_only}
    assert {(law.signed, law.only) for law in found if law.signal == "head_pressure"} == {
        (False, ""), (True, ""), (False, "positive"), (False, "negative")
    }  # fmt: skip


@pytest.mark.slow
def test_a_valve_that_a_neighbours_pressure_opens_is_said_as_a_law_of_that_pressure() -> None:
    machine, arm = planar_machine(2), truth(2)
    cylinder = machine.joints[0].cylinder
    assert cylinder is not None

    def valve(motion: Motion) -> np.ndarray:
        head = force(machine, arm, motion)[:, 0] + back_pressure(motion)[:, 0] * cylinder.rod_area
        return -40.0 / (1.0 + (head / cylinder.head_area / 1.0e6) ** 2) * (motion.v[:, 1] < 0)

    law = only_law(valve)
    assert law.other == 0 and law.signal in ("head_pressure", "cylinder_force") and law.only == "negative"


@pytest.mark.slow
def test_friction_that_settles_after_a_reversal_is_said_as_its_law() -> None:
    law = only_law(lambda motion: -25.0 * np.expm1(-ages(motion.v[:, 1]) / 1.5) * np.sign(motion.v[:, 1]))
    assert law.signal == "time_since_reversal" and law.signed


@pytest.mark.slow
def test_a_law_is_fitted_as_smooth_as_its_evidence_expects(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where no row tells a curve its coefficients are those between their neighbours, and nothing else changes."""
    machine, arm = planar_machine(2), truth(2)
    added = []
    for role, seed in USUAL:
        motion = make_motion(machine, role, seed, 60.0)
        extra = np.zeros_like(force(machine, arm, motion))
        extra[:, 1] = 900.0 * (motion.x[:, 1] - 0.15)
        added.append(extra)
    session = make_session(machine, arm, added=added, seconds=60.0, options=Options(bootstrap=0))
    model = session.base_model
    (law,) = (own for own in laws(model.views, 1, model.fitted) if own.signal == "time" and not own.signed)
    # Twice as long as the recordings: no row reaches its second half.
    knots = np.linspace(law.knots[0], 2.0 * law.knots[-1], len(law.knots) - 6)
    wide = replace(law, knots=(*[knots[0]] * 3, *knots.tolist(), *[knots[-1]] * 3))
    rows = np.diff(np.eye(wide.functions), n=2, axis=0)
    free, smooth = (
        fit_model(model.design, model.noise, model.fitted, [Term(wide, 1, expected=own)], session.prior)
        for own in (None, rows)
    )
    part = smooth.term_slice(0)
    assert not free.fit.determined[part].all() and smooth.fit.determined[part].all()
    values = smooth.fit.theta[part]
    assert np.diff(values, n=2)[-4:] == pytest.approx(0.0, abs=1e-6 * np.abs(values).max())
    assert [len(own) for own in smooth.fit.residual] == [len(own) for own in model.fit.residual]
    assert len(smooth.rows()) == 3, "what is expected of a law is a block of its own"
    solved = solve(smooth.rows())
    assert solved.theta == pytest.approx(smooth.fit.theta, rel=1e-6, abs=1e-6 * np.abs(values).max())
    monkeypatch.setattr(Design, "stored", True)
    long = fit_rows(model.design, model.noise, model.fitted, smooth.extra, session.prior)[0]
    assert long.theta == pytest.approx(smooth.fit.theta, rel=1e-5, abs=1e-5 * np.abs(values).max())
    assert [len(own) for own in long.orthonormal] == [len(own) for own in long.residual]
