"""Rows beyond what was recorded: positions, speeds, the oil's temperature, and what is no number."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from model_examples import fitted, law_of, model_with, report_of, session_of, term_of
from synthetic_arm import make_recordings, planar_machine, truth
from test_conformance import NEEDS, Conformance
from test_forward import Compiled, start_and_efforts

from benchmarks.exports.structured_text import Library
from daq.errors import InputError
from daq.machine.machine_file import Machine
from daq.recordings.recording import Recording
from fitting.loop.session import Options, Session
from fitting.model import motion
from fitting.model.arm_model import ArmModel
from fitting.model.codec import model_from_json, model_to_json
from fitting.model.export import export_model
from fitting.model.export.functions import identifier
from fitting.model.handover import hand_over
from fitting.model.prediction import predict
from fitting.model.simulation import simulate

#: Oil that warms up in every recording of the fit, K.
COLD, WARM = 300.0, 306.0


def with_oil() -> tuple[Machine, list[Recording]]:
    """An arm with a sensor of its oil, and recordings in which that warms up."""
    machine = planar_machine(2)
    recordings = make_recordings(machine, truth(2), seconds=14.0)
    channel = machine.channels[0].model_copy(
        update={"name": "oil", "quantity": "oil_temperature", "joint": None, "unit": "K"}
    )
    machine = machine.model_copy(update={"channels": (*machine.channels, channel)})
    warming = [replace(r, values={**r.values, "oil": np.linspace(COLD, WARM, len(r))}) for r in recordings]
    return machine, warming


MACHINE, RECORDINGS = with_oil()


@pytest.fixture(scope="module")
def model() -> ArmModel:
    session = Session(MACHINE, RECORDINGS, Options(loop=False))
    return hand_over(session, (), fitted(session, ()), report_of(session))


def at(recording: Recording, oil: np.ndarray) -> Recording:
    return replace(recording, values={**recording.values, "oil": oil})


def test_the_model_knows_the_oil_of_its_recordings(model: ArmModel) -> None:
    assert model.temperature == pytest.approx((COLD, WARM), abs=0.4)  # the ends of a recording go with the filter
    assert model_with((), session_of(2)).temperature is None  # no channel
    content = json.loads(json.dumps(model_to_json(model)))
    assert model_from_json(content).temperature == model.temperature
    del content["temperature"], content["sha256"]
    assert model_from_json(content).temperature is None  # a file of an earlier version
    content["temperature"] = [-1.0, 3.0]
    with pytest.raises(InputError, match="temperature"):
        model_from_json(content)


def test_rows_with_other_oil_are_flagged_at_every_joint(model: ArmModel) -> None:
    validate = RECORDINGS[-1]
    usual = predict(model, validate)
    assert not usual.beyond.all(axis=1).any()
    oil = np.where(np.arange(len(validate)) < len(validate) // 2, 303.0, WARM + 4.0)
    found = predict(model, at(validate, oil))
    late = found.t - validate.time[0] > 0.6 * (validate.time[-1] - validate.time[0])
    early = found.t - validate.time[0] < 0.4 * (validate.time[-1] - validate.time[0])
    assert found.beyond[late].all() and np.array_equal(found.beyond[early], usual.beyond[early])
    np.testing.assert_array_equal(found.predicted, usual.predicted)
    assert predict(model, at(validate, np.full(len(validate), COLD - 3.0))).beyond.all()


@pytest.mark.slow
@pytest.mark.parametrize("to", sorted(NEEDS))
def test_exports_take_the_temperature_and_flag_it(to: str, model: ArmModel, tmp_path: Path) -> None:
    possible, why = NEEDS[to]
    if not possible():
        pytest.skip(why)
    for number, oil in enumerate((COLD - 5.0, 303.0)):
        own = Conformance(model, tmp_path / str(number), oil=oil)
        own.folder.mkdir()
        assert own.right["beyond"].all() == (number != 1)
        assert max(own.differences(to).values()) <= 1e-9


@pytest.fixture(scope="module")
def heated() -> ArmModel:
    """The same with laws of the oil's temperature: one that pushes, one that is friction; and a film that remembers."""
    session = Session(MACHINE, RECORDINGS, Options(loop=False))
    terms = [law_of(session, "oil_temperature", 0), law_of(session, "oil_temperature", 1, signed=True)]
    return model_with([*terms, term_of(session, "lubricant_film_lag", 0)], session)


@pytest.mark.slow
@pytest.mark.parametrize("to", sorted(NEEDS))
def test_a_law_of_the_temperature_is_in_every_function(to: str, heated: ArmModel, tmp_path: Path) -> None:
    possible, why = NEEDS[to]
    if not possible():
        pytest.skip(why)
    cold, warm = (Conformance(heated, tmp_path, oil=oil) for oil in (301.0, 305.0))
    for what in ("gravity", "friction", "inverse_dynamics", "walk.tau"):
        assert np.max(np.abs(cold.right[what] - warm.right[what])) > 1e-3 * np.max(np.abs(warm.right[what]))
    found = warm.differences(to)
    assert max(found.values()) <= 1e-9, found


def test_a_file_with_a_law_of_the_temperature_comes_back(heated: ArmModel) -> None:
    again = model_from_json(json.loads(json.dumps(model_to_json(heated))))
    q = [[0.1, -0.2]]
    held = [motion.gravity(own, q, temperature=304.0) for own in (again, heated)]
    np.testing.assert_array_equal(*held)
    with pytest.raises(InputError, match="give temperature= in K"):
        motion.gravity(again, q)


def test_tables_have_no_temperature_and_say_so(heated: ArmModel, tmp_path: Path) -> None:
    done = export_model(heated, "csv", tmp_path)
    assert sum("needs the oil's temperature" in line for line in done.left_out) == 2
    assert any("the rest was fitted again without it" in line for line in done.left_out)


@pytest.mark.slow
def test_a_motion_follows_at_the_temperature_that_is_given(heated: ArmModel, tmp_path: Path) -> None:
    model = motion.nearest_possible(heated)
    q, efforts = start_and_efforts(model, 303.0)
    with pytest.raises(InputError, match="give temperature="):
        simulate(model, lambda *_: efforts[0], q, seconds=0.02)
    own = Compiled(model, tmp_path)
    ends = []
    for oil in (301.0, 305.0):
        right = simulate(model, lambda *_: efforts[0], q, seconds=0.2, temperature=oil)
        own.call("init", q.tolist(), [0.0, 0.0], own.state)
        assert own.call("step", own.state, efforts[0].tolist(), 0.0, oil, 0.2) == 0
        through = np.ptp(right.q, axis=0)
        assert np.max(np.abs(np.array(own.state[:2]) - right.q[-1]) / through) <= 1e-4
        ends.append(right.q[-1])
    assert np.max(np.abs(ends[0] - ends[1])) > 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("to", ["python", "st"])
def test_what_is_no_number_is_beyond_and_makes_no_effort(to: str, model: ArmModel, tmp_path: Path) -> None:
    export_model(model, to, tmp_path / "arm")
    text, name = (tmp_path / "arm").read_text(encoding="utf-8"), identifier(model.machine.name)
    zero = [0.0, 0.0]
    moment: dict[str, Any] = {"q": zero, "qd": [0.1, 0.1], "qdd": zero}

    def asked(function: str, **given: Any) -> list[float]:
        if to == "python":
            names: dict[str, Any] = {}
            exec(text, names)
            return [float(own) for own in names[function](**given)]
        named = {{"t": "t_s"}.get(word, word): own for word, own in given.items()}
        return list(*Library(text).block(f"{name}_{function}")(**named).values())

    assert asked("beyond", q=zero, qd=zero, temperature=303.0) == [0.0, 0.0]
    for what in ("q", "qd"):
        wrong = {**moment, what: [np.nan, 0.0]}
        assert asked("beyond", q=wrong["q"], qd=wrong["qd"], temperature=303.0)[0] == 1.0
        assert np.isnan(asked("inverse_dynamics", **wrong, t=0.0)[0])
    assert asked("beyond", q=zero, qd=zero, temperature=np.nan) == [1.0, 1.0]
    assert np.isnan(asked("inverse_dynamics", **{**moment, "qdd": [0.0, np.nan]}, t=0.0)[1])
