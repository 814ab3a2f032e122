"""The handed-over model predicts what the pipeline predicts, for every effect, also after a way through its file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np
import pytest
from model_examples import applies, fitted, law_of, report_of, session_of, term_of

from fitting.effects import effect, effects
from fitting.loop.refits import SessionSignals
from fitting.model.arm_model import ArmModel
from fitting.model.codec import model_from_json, model_to_json
from fitting.model.handover import hand_over
from fitting.model.prediction import on_recording
from fitting.regression.design import predicted_effort
from fitting.residual.stored_terms import corrections_from_json
from fitting.residual.terms import Term, fit_model
from fitting.signals.preparation import Segment


def groups() -> list[list[str]]:
    """All effects that can be fitted to efforts, those that hold the model's force by themselves, a few at a time."""
    machine = session_of(2).machine
    names = [e.id for e in effects() if applies(e, machine) is not None]
    holding = [e.id for e in effects() if e.id in names and (e.uses_model or e.machine_wide)]
    plain = [name for name in names if name not in holding]
    return [chosen[start::3] for chosen in (plain, holding) for start in range(3)]


def through_its_file(model: ArmModel) -> ArmModel:
    return model_from_json(json.loads(json.dumps(model_to_json(model), allow_nan=False)))


def assert_reproduced(terms: Sequence[Term], refitted: bool = False) -> None:
    session = session_of(2)
    pipeline = fitted(session, terms)
    if refitted:  # as where the prior holds other parameters than it held at first
        plain = session.plain
        pipeline = fit_model(plain.design, plain.noise, plain.fitted, terms, session.prior, pipeline)
    handed = hand_over(session, (), pipeline, report_of(session))
    model = through_its_file(handed)
    # A model is of a machine with its links: free cylinders have pressures of their own.
    for index, segment in enumerate(pipeline.design.segments):
        if not segment.loaded:
            continue
        found, lines = on_recording(model, session.recordings[segment.recording])
        assert not lines
        expected = [predicted_effort(pipeline.design, pipeline.fit.theta, j, index, pipeline.extra) for j in (0, 1)]
        # The same functions on the same numbers: not one digit is lost.
        np.testing.assert_allclose(found.drive_effort(0), np.stack(expected, axis=1), rtol=1e-12, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("names", groups(), ids=lambda names: "-".join(name[:6] for name in names))
def test_efforts_are_the_pipelines(names: list[str]) -> None:
    session = session_of(2)
    joints = {e.id: applies(e, session.machine) or 0 for e in effects()}
    assert_reproduced([term_of(session, name, joints[name]) for name in names])


@pytest.mark.slow
def test_a_fit_that_began_at_another_one_is_reproduced() -> None:
    session = session_of(2)
    assert_reproduced([term_of(session, name, 1) for name in ("load_dependent_friction", "stribeck")], refitted=True)


def test_every_effect_of_the_catalogue_was_tried() -> None:
    tried = {name for names in groups() for name in names}
    # Found between two position sensors, or only where one of them is missing; rebuilt into the signals then.
    assert {e.id for e in effects()} - tried == {"backlash", "encoder_offset", "encoder_eccentricity"}


@pytest.mark.slow
def test_laws_are_reproduced() -> None:
    session = session_of(2)
    signals = ("piston_position", "cylinder_force", "rod_pressure", "time_since_reversal")
    assert_reproduced([law_of(session, signal, n % 2, signed=n < 2) for n, signal in enumerate(signals)])


STEPS = (
    {"effect": "encoder_offset", "joint": 0, "shape": {}, "values": [0.01]},
    {"effect": "linkage_geometry", "joint": 1, "shape": {"parameter": 0.0}, "values": [0.002, 0.0, 0.0]},
    {"effect": "backlash", "joint": 1, "shape": {"sensor": 0.0}, "values": [0.0005]},
)


@pytest.mark.slow
@pytest.mark.parametrize("resampled", [False, True])
def test_corrected_positions_linkages_and_delays_are_reproduced(resampled: bool) -> None:
    session = session_of(2)
    late = Term(effect("sensor_latency"), 0, {}, (0.031,), resampled)
    signals = SessionSignals(session, corrections_from_json(session.machine, STEPS))
    pipeline = signals.refit([late, term_of(session, "stribeck", 1)])
    model = through_its_file(hand_over(session, STEPS, pipeline, report_of(session)))
    validate = session.plain.validate[0]
    found, _ = on_recording(model, session.recordings[pipeline.design.segments[validate].recording])
    expected = [predicted_effort(pipeline.design, pipeline.fit.theta, j, validate, pipeline.extra) for j in (0, 1)]
    np.testing.assert_allclose(found.drive_effort(0), np.stack(expected, axis=1), rtol=1e-12, atol=1e-9)
    # The measured side of a residual is moved as well.
    np.testing.assert_array_equal(found.design.segments[0].effort, pipeline.design.segments[validate].effort)
    assert np.max(np.abs(found.design.segments[0].q - session.plain.design.segments[validate].q)) > 0.005


def test_a_parameter_without_a_finite_variance_gives_an_infinite_band() -> None:
    session = session_of(2)
    handed = hand_over(session, (), fitted(session, ()), report_of(session))
    covariance = handed.covariance.copy()
    covariance[0, :] = covariance[:, 0] = np.inf
    model = through_its_file(replace(handed, covariance=covariance))
    found, _ = on_recording(model, session.recordings[3])
    assert np.all(np.isinf(found.parameter_std(0)[:, 0])) and np.all(np.isfinite(found.parameter_std(0)[:, 1]))


ONE_MOMENT = [e.id for e in effects() if not e.over_time and applies(e, session_of(2).machine) is not None]


@pytest.mark.parametrize("name", ONE_MOMENT)
def test_an_effect_that_is_not_over_time_sees_one_moment(name: str) -> None:
    """What a column says at a sample does not change when all other samples are gone."""

    session = session_of(2)
    joint = applies(next(e for e in effects() if e.id == name), session.machine) or 0
    view = session.base_model.views[1][joint]
    picked = np.arange(0, len(view), 37)

    def part(values: object) -> object:
        return values[picked] if isinstance(values, np.ndarray) and len(values) == len(view) else values

    segment = Segment(**{f.name: part(getattr(view.segment, f.name)) for f in fields(Segment)})
    pressures = view.rod_pressures()[picked]
    less = replace(
        view,
        segment=segment,
        forces=view.forces[picked],
        loads=view.loads[picked],
        clock=view.clock[picked],
        rod_pressures=lambda: pressures,
        cache={},
        shared={},
    )
    term = term_of(session, name, joint)
    whole = [replace(view, joint=j, cache={}) for j in (0, 1)]
    few = [replace(less, joint=j, cache={}) for j in (0, 1)]
    np.testing.assert_allclose(term.columns(few), term.columns(whole)[picked], rtol=1e-12, atol=1e-12)
