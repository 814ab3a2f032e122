"""Weights of the fit that is handed out: those of the noise where the model is right, equal ones where it is not."""

from __future__ import annotations

import numpy as np
import pytest
from synthetic_arm import USUAL, clean_session, make_motion, make_session, planar_machine, truth

from fitting.estimators.effort_fit import EffortRows
from fitting.loop.session import Options, Session
from fitting.loop.weighting import MOST_LOST


def with_slow_error(size: float) -> Session:
    """An arm with a slow force on joint 1 that no formula of the base knows and every run of the motion repeats."""
    machine = planar_machine(2)
    added = []
    for role, seed in USUAL:
        motion = make_motion(machine, role, seed, 40.0, None)
        wave = np.sin(2 * np.pi * 0.07 * motion.t) + np.cos(2 * np.pi * 0.045 * motion.t)
        force = np.zeros((len(motion.t), 2))
        force[:, 0] = size * wave
        added.append(force)
    return make_session(machine, truth(2), added=added, options=Options(loop=False))


def training_error(session: Session, theta: np.ndarray) -> float:
    rows = EffortRows(session.plain.design, session.plain.fitted)
    return float(np.sqrt(np.sum(rows.rows * rows.errors(theta) ** 2)))


def held_out_error(session: Session, theta: np.ndarray) -> float:
    rows = EffortRows(session.plain.design, session.plain.design.indices("validate"))
    return float(np.sqrt(np.sum(rows.rows * rows.errors(theta) ** 2)))


def test_a_right_model_keeps_the_weights_of_its_noise() -> None:
    session = clean_session()
    base = session.weighted_base
    assert base.weights == "whitened"
    assert base.ratio < 1.01
    np.testing.assert_array_equal(base.model.fit.theta, session.base_model.fit.theta)


@pytest.mark.slow
@pytest.mark.parametrize("size", [60.0, 300.0])
def test_a_slow_error_of_the_model_is_not_called_noise(size: float) -> None:
    session = with_slow_error(size)
    base = session.weighted_base
    assert base.weights == "equal"
    assert base.ratio > MOST_LOST
    # On another motion; on the training motion the whitened fit may be bent to where no machine is.
    bent = held_out_error(session, session.base_model.fit.theta)
    assert held_out_error(session, base.model.fit.theta) <= 1.02 * bent
    assert base.model.fit.theta == pytest.approx(base.tried["equal"], rel=1e-9)


@pytest.mark.slow
def test_what_is_handed_out_never_costs_more_than_is_said() -> None:
    for size in (0.0, 2.0, 8.0, 20.0):
        session = with_slow_error(size)
        base = session.weighted_base
        least = training_error(session, base.tried["equal"])
        # The bound is per degree of freedom; the number of rows is more than ten times that of the parameters.
        assert training_error(session, base.model.fit.theta) <= 1.05 * MOST_LOST * least, size


def test_deviations_of_equal_weights_hold_the_truth() -> None:
    session = with_slow_error(60.0)
    fit, own = session.weighted_base.model.fit, truth(2).theta(session.machine)
    names = session.plain.design.parameters.names
    friction = [n for n, name in enumerate(names) if name.startswith("joint2.f_")]
    assert np.all(np.abs(fit.theta[friction] - own[friction]) < 4.0 * fit.std[friction])
