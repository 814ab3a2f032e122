"""What a format cannot hold: the rest is fitted again, its error is said, and motions need a model that can move."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from model_examples import fitted, law_of, model_with, report_of, session_of, term_of, true_model
from synthetic_arm import truth

from daq.errors import HilfitError, InputError
from fitting.loop.weighting import weighed
from fitting.model import motion, simulation
from fitting.model.arm_model import ArmModel
from fitting.model.evaluation import beyond, without
from fitting.model.export import export_model
from fitting.model.export.tracing.tracing import tracer_of
from fitting.model.handover import hand_over
from fitting.model.prediction import predict
from fitting.model.simulation import simulate
from fitting.regression.design import effort_errors


def rms(errors: tuple[np.ndarray, ...]) -> np.ndarray:
    return np.array([np.sqrt(np.mean(own**2)) for own in errors])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["presliding_hysteresis", "structural_flexibility", "time_since_reversal"])
def test_the_rest_is_the_fit_without_it_and_its_error_is_said(name: str, tmp_path: Path) -> None:
    session = session_of(2)
    term = law_of(session, name, 1) if name == "time_since_reversal" else term_of(session, name, 1)
    pipeline = fitted(session, [term, term_of(session, "stribeck", 0)])
    model = hand_over(session, (), pipeline, report_of(session))
    alone = fitted(session, [term_of(session, "stribeck", 0)])
    rest = model.rest({0})
    assert rest is not None and [own.id for own in rest.terms] == ["stribeck"]
    np.testing.assert_allclose(rest.theta, alone.fit.theta, rtol=1e-3, atol=1e-3 * np.max(np.abs(alone.fit.theta)))
    validate = pipeline.design.indices("validate")
    assert model.errors is not None and rest.errors is not None
    np.testing.assert_allclose(
        model.errors, rms(effort_errors(pipeline.design, pipeline.fit.theta, validate, pipeline.extra)), rtol=1e-9
    )
    done = export_model(model, "csv", tmp_path)
    (line,) = (own for own in done.left_out if "fitted again" in own)
    assert all(f"joint{k + 1} {own[k]:.3g} N m" in line for own in (rest.errors, model.errors) for k in range(2))
    assert line in (tmp_path / "card.txt").read_text(encoding="utf-8")
    carried = name == "presliding_hysteresis"
    tracer = tracer_of(model)
    assert bool(tracer.left_out) != carried
    np.testing.assert_array_equal(tracer.model.theta, model.theta if carried else rest.theta)


def test_a_model_without_memories_has_no_rests() -> None:
    session = session_of(2)
    assert model_with([term_of(session, "stribeck", 0)], session).rests == ()


@pytest.fixture(scope="module")
def direct() -> ArmModel:
    """A drive that acts directly, whose inertia came out far below zero."""
    session = session_of(2, "Rr")
    model = model_with((), session)
    place = model.parameter_names.index("joint2.J")
    # Along what the recordings leave open, as a fit that cannot tell it would have it.
    theta = model.theta - (100.0 + model.theta[place]) * model.covariance[place] / model.covariance[place, place]
    return replace(model, passes=(replace(model.passes[-1], theta=theta),))


def test_a_model_that_cannot_move_is_refused_everywhere_and_the_nearest_can(direct: ArmModel, tmp_path: Path) -> None:
    q = np.zeros((1, 2))
    calls: list[Callable[[bool], object]] = [
        lambda possible: motion.forward(direct, q, q, effort=q, possible=possible),
        lambda possible: simulate(direct, lambda *_: np.zeros(2), q[0], seconds=0.02, possible=possible),
        lambda possible: export_model(direct, "mjcf", tmp_path / "arm.xml", possible=possible),
        lambda possible: export_model(direct, "urdf", tmp_path / "arm.urdf", possible=possible),
    ]
    for call in calls:
        with pytest.raises(InputError) as caught:
            call(False)
        text = str(caught.value)
        assert "the drive inertia of joint2 is below zero" in text and "possible" in text and "\n" not in text
        call(True)
    assert not [path for path in tmp_path.iterdir() if path.suffix not in (".xml", ".urdf")]
    own = motion.nearest_possible(direct)
    assert motion.indefinite(own) is None and own.theta[own.parameter_names.index("joint2.J")] == 0.0
    price = motion.price(direct, own)
    assert price is not None and price != 0.0
    text = (tmp_path / "arm.xml").read_text(encoding="utf-8")
    assert f"{100 * price:+.1f} % of the model's own" in text


def test_a_simulation_ends_in_time() -> None:
    session = session_of(2)
    model = true_model(session.machine, truth(2), session)
    clock = iter(np.arange(0.0, 1e6, 0.5))
    with pytest.raises(HilfitError, match="give within_s="):
        simulate(model, lambda *_: np.zeros(2), [0.0, 0.0], seconds=5.0, within_s=3.0, clock=lambda: float(next(clock)))


def test_rows_beyond_what_was_recorded_are_marked() -> None:
    session = session_of(2)
    model = model_with((), session)
    ranges = tuple(replace(own, v=0.5 * own.v) if k == 0 else own for k, own in enumerate(model.passes[-1].ranges))
    slow = replace(model, passes=(replace(model.passes[-1], ranges=ranges),))
    found = predict(slow, session.recordings[3])
    assert 0.01 < found.beyond[:, 0].mean() < 0.9 and not found.beyond[:, 1].any()
    segment = motion.on_motion(slow, *(np.zeros((1, 2)) for _ in range(3))).design.segments[0]
    assert not beyond(slow, segment).any()


@pytest.mark.slow
def test_a_band_that_does_not_hold_is_said() -> None:
    session = session_of(2)
    model = model_with((), session)
    assert model.coverage is not None and np.all(np.abs(model.coverage - 0.95) < 0.02)
    found = predict(model, session.recordings[3])
    np.testing.assert_allclose(found.coverage, model.coverage, atol=1e-9)
    narrow = replace(model, coverage=np.array([0.6, 0.95]))
    (line,) = predict(narrow, session.recordings[3]).left_out
    assert line.startswith("of joint1, 60%") and "more than on the motion of the fit" in line


@pytest.mark.slow
def test_a_law_widens_no_band_by_what_it_makes_up_for() -> None:
    """Parameters of a law's joint may be off by what the law hides; the effort of both together is known."""
    session = session_of(2)
    pipeline = weighed(fitted(session, [law_of(session, "piston_position", 1, signed=True)]), session.prior).model
    model = hand_over(session, (), pipeline, report_of(session))
    assert model.hidden is not None and model.hidden.max() > 0
    found = predict(model, session.recordings[3])
    moving = found.moving[:, 1]
    width = np.sqrt(np.mean(found.std[moving, 1] ** 2)) / np.sqrt(np.mean(found.residual[moving, 1] ** 2))
    assert 0.67 < width < 1.5 and 0.93 <= found.coverage[1] <= 0.97
    plain = without(model, {0})
    assert plain.hidden is not None and np.all(plain.std >= np.sqrt(plain.hidden))


def test_a_fault_of_a_sensor_makes_no_simulation_iterate(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is in no effort asks for no search of the force that it would hold."""
    made: list[bool] = []
    plant = simulation._Plant

    def noted(*given: object) -> object:
        made.append(bool(given[2]))
        return plant(*given)  # type: ignore[arg-type]

    monkeypatch.setattr(simulation, "_Plant", noted)
    session = session_of(2)
    for name in ("pressure_gain", "load_dependent_friction"):
        model = true_model(session.machine, truth(2), session)
        theta = np.append(model.theta, 0.01)
        model = replace(
            model,
            terms=(term_of(session, name, 1),),
            passes=(replace(model.passes[-1], theta=theta),),
        )
        simulate(model, lambda *_: motion.gravity(model, np.zeros(2))[0], [0.0, 0.0], seconds=0.02)  # noqa: B023
    assert made == [False, True]
