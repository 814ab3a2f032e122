"""A delay between two buses, as the machine file tells it, is a measurement of each joint's delay that the fit uses."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from synthetic_arm import make_session, planar_machine, truth

from daq.machine.machine_file import KnownDelay, Machine, ModbusSource, ModbusTcpBus, machine_problems, machine_to_yaml
from fitting.effects import effect
from fitting.loop.session import Options, Session
from fitting.regression.prior import OWN_FILTER_S, Prior, expected_delays
from fitting.residual.scoring import Score, score_terms
from fitting.residual.terms import Term, fit_model

LATE_S, STD_S = 0.03, 0.0004
NAN = float("nan")
LATENCY = Term(effect("sensor_latency"), 1)
FRICTION = Term(effect("quadratic_loss"), 1)


def on_two_buses(*delays: KnownDelay, efforts: str = "oil") -> Machine:
    """The synthetic arm of two joints with positions on bus ``angles`` and pressures on another."""
    machine = planar_machine(2)
    channels = tuple(
        c.model_copy(
            update={"source": ModbusSource(bus=efforts if "pressure" in c.quantity else "angles", unit=1, register=0,
                                           data_type="float32")}
        )
        for c in machine.channels
    )  # fmt: skip
    buses = tuple(ModbusTcpBus(name=n, type="modbus_tcp", host="127.0.0.1") for n in ("angles", "middle", "oil"))
    return machine.model_copy(update={"channels": channels, "buses": buses, "delays": delays})


def behind(bus: str, other: str, seconds: float, std: float) -> KnownDelay:
    return KnownDelay(bus=bus, behind=other, seconds=seconds, std=std)


def test_a_joint_s_delay_is_that_of_its_effort_s_bus() -> None:
    assert expected_delays(on_two_buses()) is None
    assert expected_delays(on_two_buses(behind("oil", "middle", 0.01, 0.002))) is None  # nothing of the positions
    told = expected_delays(on_two_buses(behind("oil", "angles", 0.012, 0.003)))
    assert told is not None
    own = OWN_FILTER_S  # what a transmitter's filter may add
    np.testing.assert_allclose(told, [[0.012] * 2, [np.hypot(0.003, own)] * 2])
    told = expected_delays(on_two_buses(behind("angles", "middle", -0.01, 0.003), behind("oil", "middle", 0.02, 0.004)))
    assert told is not None
    np.testing.assert_allclose(told, [[0.03] * 2, [np.hypot(0.005, own)] * 2])  # along both
    assert expected_delays(on_two_buses(behind("oil", "angles", 0.01, 0.001), efforts="angles")) is None
    assert expected_delays(on_two_buses(behind("oil", "angles", -0.05, 0.001))) is None  # then positions are late


@pytest.mark.parametrize(
    ("delays", "words"),
    [
        ("[{bus: oil, behind: angels, seconds: 0.01, std: 0.001}]", "delays[0]: there is no bus 'angels'"),
        ("[{bus: oil, behind: oil, seconds: 0.01, std: 0.001}]", "cannot be behind itself"),
        ("[{bus: oil, behind: angles, seconds: 0.01, std: 0}]", "std"),
        (
            "[{bus: oil, behind: angles, seconds: 0.01, std: 0.1}, {bus: angles, behind: oil, seconds: 0, std: 0.1}]",
            "delays[1]: 'angles' and 'oil' are told twice",
        ),
    ],
)
def test_wrong_delays_are_one_line(delays: str, words: str) -> None:
    text = machine_to_yaml(on_two_buses()).replace("delays: []", f"delays: {delays}")
    machine, problems = machine_problems(text)
    assert machine is None
    (problem,) = problems
    assert words in problem.under("machine.yaml")


def known(session: Session, seconds: float, std: float) -> Prior:
    """The session's prior, and what the buses say of joint 2."""
    return replace(session.prior, delay=np.array([NAN, seconds]), delay_std=np.array([NAN, std]))


@cache
def late_session() -> Session:
    """A recording in which the pressures of the second joint are late."""
    return make_session(planar_machine(2), truth(2), late={1: LATE_S})


def scored(prior: Prior, term: Term = LATENCY) -> Score:
    session = late_session()
    base = session.base_model
    model = fit_model(base.design, base.noise, base.fitted, (), prior)
    (score,) = score_terms(model, [term], [1])
    return score


@pytest.mark.parametrize("seconds", [0.0, 0.02, LATE_S])
def test_a_candidate_weighs_data_and_buses_by_their_precision(seconds: float) -> None:
    alone = scored(late_session().prior)
    both = scored(known(late_session(), seconds, STD_S))
    precisions = np.array([alone.stds[0], STD_S]) ** -2.0
    mean = float(precisions @ [alone.values[0], seconds] / precisions.sum())
    assert both.values[0] == pytest.approx(mean, rel=1e-6)
    assert both.stds[0] == pytest.approx(precisions.sum() ** -0.5, rel=1e-6)
    # What it gains: all that data and buses say against no delay, less what they say against each other.
    apart = (alone.values[0] - seconds) ** 2 / (alone.stds[0] ** 2 + STD_S**2)
    assert both.gain == pytest.approx(alone.gain + (seconds / STD_S) ** 2 - apart, rel=1e-6)


def test_a_delay_prior_changes_no_other_candidate_and_no_other_joint() -> None:
    prior = known(late_session(), LATE_S, STD_S)
    for term in (FRICTION, Term(effect("sensor_latency"), 0)):
        with_it, without = scored(prior, term), scored(late_session().prior, term)
        assert with_it.values == pytest.approx(without.values, rel=1e-6)
        assert with_it.gain == pytest.approx(without.gain, rel=1e-6)


@pytest.mark.parametrize("moved", [0.0, 0.01])
def test_the_fit_is_drawn_to_it_also_after_the_signal_was_moved(moved: float) -> None:
    """With the term in the fit, beside it friction; what was moved already counts as explained."""
    session = late_session()
    base, terms = session.base_model, [FRICTION, replace(LATENCY, rebuilt=(moved,))]
    tight = 1e-7
    model = fit_model(base.design, base.noise, base.fitted, terms, known(session, LATE_S, tight))
    (value,), (std,) = model.fit.theta[model.term_slice(1)], model.fit.std[model.term_slice(1)]
    assert value + moved == pytest.approx(LATE_S, abs=5 * tight) and std == pytest.approx(tight, rel=1e-3)
    assert len(model.rows()[1].b) == len(model.fit.residual[1])


def test_a_session_takes_it_from_its_machine_and_replicas_have_no_delay() -> None:
    machine = on_two_buses(behind("oil", "angles", 0.012, 0.003))
    prior = Session(machine, late_session().recordings, Options()).prior
    assert prior.delay_of(1) == pytest.approx((0.012, np.hypot(0.003, OWN_FILTER_S)))
    assert prior.undelayed().delay_of(1) == pytest.approx((0.0, np.hypot(0.003, OWN_FILTER_S)))
    assert late_session().prior.delay_of(1) is None
