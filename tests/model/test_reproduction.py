"""The handed-over model predicts what the pipeline predicts, for every effect, also after a way through its file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np
import pytest
from model_examples import applies, fitted, law_of, report_of, session_of, term_of

from fitting.effects import effects
from fitting.model.codec import model_from_json, model_to_json
from fitting.model.handover import hand_over
from fitting.model.prediction import on_recording
from fitting.preparation import Segment
from fitting.regression import predicted_effort
from fitting.residual.terms import Term


def groups() -> list[list[str]]:
    """All effects that can be fitted to efforts, those that hold the model's force by themselves, a few at a time."""
    machine = session_of(2).machine
    names = [e.id for e in effects() if applies(e, machine) is not None]
    holding = [e.id for e in effects() if e.id in names and (e.uses_model or e.machine_wide)]
    plain = [name for name in names if name not in holding]
    return [chosen[start::3] for chosen in (plain, holding) for start in range(3)]


def assert_reproduced(terms: Sequence[Term]) -> None:
    session = session_of(2)
    pipeline = fitted(session, terms)
    handed = hand_over(session, (), pipeline, report_of(session))
    model = model_from_json(json.loads(json.dumps(model_to_json(handed), allow_nan=False)))
    for index, segment in enumerate(pipeline.design.segments):
        found, lines = on_recording(model, session.recordings[segment.recording])
        assert not lines
        expected = [predicted_effort(pipeline.design, pipeline.fit.theta, j, index, pipeline.extra) for j in (0, 1)]
        # The same functions on the same numbers: not one digit is lost.
        np.testing.assert_allclose(found.drive_effort(0), np.stack(expected, axis=1), rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize("names", groups(), ids=lambda names: "-".join(name[:6] for name in names))
def test_efforts_are_the_pipelines(names: list[str]) -> None:
    session = session_of(2)
    joints = {e.id: applies(e, session.machine) or 0 for e in effects()}
    assert_reproduced([term_of(session, name, joints[name]) for name in names])


def test_every_effect_of_the_catalogue_was_tried() -> None:
    tried = {name for names in groups() for name in names}
    # Found between two position sensors, or only where one of them is missing; rebuilt into the signals then.
    assert {e.id for e in effects()} - tried == {"backlash", "encoder_offset", "encoder_eccentricity"}


def test_laws_are_reproduced() -> None:
    session = session_of(2)
    signals = ("piston_position", "cylinder_force", "rod_pressure", "time_since_reversal")
    assert_reproduced([law_of(session, signal, n % 2, signed=n < 2) for n, signal in enumerate(signals)])


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

    segment = Segment(**{f.name: part(getattr(view.segment, f.name)) for f in fields(Segment) if f.name != "derived"})
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
