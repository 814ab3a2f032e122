"""Pressures as motion and force make them expect: of free cylinders and of loaded ones by laws of their own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic_arm import clean_session

from daq.recordings.recording import Recording
from fitting.effects import effect
from fitting.loop.session import Options, Session
from fitting.residual.scoring import score_terms
from fitting.residual.terms import Term

JOINT = 1


def session_with(back_pressure: float, span: float = 1.0) -> Session:
    """The clean arm with that much more in both chambers of its free cylinder, and a rod transducer of that span."""
    clean = clean_session(2)
    machine, joint = clean.machine, clean.machine.joints[JOINT]
    names = [machine.channel(quantity, joint.name).name for quantity in ("rod_pressure", "head_pressure")]  # type: ignore[union-attr]
    assert joint.cylinder is not None
    balance = joint.cylinder.rod_area / joint.cylinder.head_area  # the force stays

    def changed(recording: Recording) -> Recording:
        more = back_pressure if recording.role == "unloaded" else 0.0
        rod, head = (recording.values[name] for name in names)
        own = {names[0]: span * (rod + more), names[1]: head + balance * more}
        return replace(recording, values={**recording.values, **own})

    return Session(machine, [changed(r) for r in clean.recordings], Options(bootstrap=0))


@pytest.mark.slow
@settings(max_examples=3, deadline=None)
@given(st.floats(-0.3e6, 8e6))
def test_a_free_cylinder_is_expected_to_have_the_pressures_that_it_has(more: float) -> None:
    clean, model = clean_session(2).base_model, session_with(more).base_model
    for index in model.fitted:
        segment, expected = model.design.segments[index], model.views[index][JOINT].p2
        if segment.loaded:
            np.testing.assert_allclose(expected, clean.views[index][JOINT].p2, rtol=1e-9)
        else:
            measured = segment.p2[:, JOINT]
            assert abs(np.mean(expected - measured)) < 1e-3 * abs(np.mean(measured))
            assert np.std(expected - measured) < 0.5 * np.std(measured)


@pytest.mark.slow
def test_the_span_of_a_transducer_is_found_where_free_cylinders_have_another_back_pressure() -> None:
    model = session_with(4e6, span=1.08).base_model
    (score,) = score_terms(model, [Term(effect("pressure_gain"), JOINT, {"chamber": 2.0})], [1])
    assert score.gain > 1000
    assert score.values[0] == pytest.approx(1 - 1 / 1.08, rel=0.05)
