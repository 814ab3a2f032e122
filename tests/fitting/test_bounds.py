"""Signs: what an effect gains inside what is physically possible, and what is left outside is a law."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import optimize
from synthetic_arm import exact_views, make_session, planar_machine, truth

from fitting.effects import effect
from fitting.effects.base import Parameter, Shape
from fitting.effects.bounds import inside, limits
from fitting.effects.stribeck import Stribeck
from fitting.loop.residual_loop import run_attribution
from fitting.loop.session import Session
from fitting.residual.findings import Attribution
from fitting.residual.scoring import Score, score_terms
from fitting.residual.terms import Term, fit_model
from fitting.signals.corrections import Corrections

MACHINE, ARM = planar_machine(2), truth(2)
RECORDINGS = (("unloaded", 1), ("train", 2), ("train", 4), ("repeat", 2), ("validate", 3))


class Bounded(Stribeck):
    """Three parameters: one of either sign, one that is not negative, one within an interval."""

    parameters = (Parameter("a", "N"), Parameter("b", "N", low=0.0), Parameter("c", "N", low=-0.5, high=0.5))


@given(st.integers(0, 10_000))
def test_the_gain_inside_is_that_of_bounded_least_squares(seed: int) -> None:
    rng = np.random.default_rng(seed)
    C, e = rng.normal(size=(12, 3)) * [1.0, 100.0, 0.01], rng.normal(size=12) * 3.0
    gram, products = C.T @ C, C.T @ e
    free = np.linalg.solve(gram, products)
    low, high = limits(Bounded())
    oracle = optimize.lsq_linear(C, e, (low, high), method="bvls", tol=1e-12)
    found = inside(limits(Bounded()), gram, products, free)
    values = free if found is None else found.values
    gain = 2 * products @ values - values @ gram @ values
    assert gain == pytest.approx(e @ e - 2.0 * oracle.cost, rel=1e-6, abs=1e-9)
    assert np.all(values >= low - 1e-9) and np.all(values <= high + 1e-9)
    if found is not None:
        assert found.gain == pytest.approx(gain, rel=1e-9, abs=1e-12)


@cache
def session_with(name: str, *values: float) -> tuple[Session, Term]:
    """Recordings with an effect of a catalogue's shape on joint 2, with any values, possible or not."""
    _, views = exact_views(MACHINE, ARM, recordings=RECORDINGS)
    kind = effect(name)
    shapes = kind.shapes(views[1][1])
    shape: Shape = shapes[len(shapes) // 2]
    if name == "end_cushion":  # one that the motion enters, by a fifth of the stroke that it used
        (low, high), ends = views[1][1].range.x, [kind.references(views[1][1], s)["x_c"][0] for s in shapes]
        stroke = (max(ends) - min(ends)) / (1.0 - 2.0 * shapes[0]["share"])
        top = max(ends) + shapes[0]["share"] * stroke
        shape = {"side": 1.0, "share": (top - high + 0.2 * (high - low)) / stroke, "n": 1.0}
    added = []
    for own in views:
        extra = np.zeros((len(own[1]), 2))
        extra[:, 1] = kind.columns(own[1], shape) @ np.array(values)
        added.append(extra)
    return make_session(MACHINE, ARM, RECORDINGS, added=added), Term(kind, 1, shape)


@cache
def score(name: str, *values: float) -> Score:
    session, term = session_with(name, *values)
    return score_terms(session.base_model, [term], [1])[0]


@given(
    st.lists(st.floats(-3, 3), min_size=4, max_size=4),
    st.lists(st.floats(0.2, 2), min_size=4, max_size=4),
    st.integers(0, 2**32 - 1),
)
def test_what_is_possible_of_a_posterior_is_counted(values: list[float], stds: list[float], seed: int) -> None:
    """A line's loss grows with the flow: of its linear and its quadratic part neither works against the other."""
    drawn = np.array(values) + np.array(stds) * np.random.default_rng(seed).normal(size=(4000, 4))
    same = (drawn[:, 0] * drawn[:, 1] >= 0) & (drawn[:, 2] * drawn[:, 3] >= 0)
    assert effect("cross_cylinder_coupling").possible(values, stds) == pytest.approx(np.mean(same), abs=0.05)
    braking = np.mean((drawn[:, 0] >= 0) & (drawn[:, 0] <= 0.5))
    assert effect("load_dependent_friction").possible(values[:1], stds[:1]) == pytest.approx(braking, abs=0.05)


@pytest.mark.parametrize("square", [0.0, -1e-19])
def test_a_parameter_of_which_only_rounding_is_left_is_zero_and_gains_nothing(square: float) -> None:
    rounding = 1e-18
    gram = np.array([[2e-3, 1e-3, rounding], [1e-3, 5e-3, rounding], [rounding, rounding, square]])
    low, high = np.zeros(3), np.full(3, np.inf)
    found = inside((low, high), gram, np.array([-1.0, 2.0, 1e-9]), np.array([-500.0, 400.0, 2e-6]))
    assert found is not None and found.held == (0,)
    assert found.values == pytest.approx([0.0, 400.0, 0.0]) and found.gain == pytest.approx(800.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "values"),
    [("stribeck", (60.0,)), ("end_cushion", (4e4, 0.0)), ("quadratic_loss", (9000.0,))],
)
def test_an_effect_with_an_impossible_value_gains_nothing(name: str, values: tuple[float, ...]) -> None:
    possible = score(name, *values)
    impossible = score(name, *(-v for v in values))
    assert possible.gain > 60.0
    assert impossible.gain < 0.1 * possible.gain
    assert all(v >= 0 for v in impossible.values) and min(impossible.free) < 0


def run(name: str, *values: float) -> Attribution:
    session, _ = session_with(name, *values)
    return run_attribution(session, Corrections(session.machine))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "values"),
    [("stribeck", (-60.0,)), ("end_cushion", (-4e4, 0.0)), ("quadratic_loss", (-9000.0,))],
)
def test_a_friction_that_drives_a_cushion_that_pulls_and_a_loss_that_pumps_are_never_names(
    name: str, values: tuple[float, ...]
) -> None:
    found = run(name, *values)
    assert name not in [item.score.term.id for item in found.accepted]
    assert all(name != term.id for h in found.hypotheses for term in h.terms)
    assert found.verdict in ("unexplained", "effect_added") and found.nothing < 0.5
    if name != "quadratic_loss":  # less friction at high speed is also power-law friction, which is possible
        assert found.verdict == "unexplained"


@pytest.mark.slow
def test_a_parameter_that_would_be_impossible_is_held_at_zero_in_the_refit() -> None:
    """A cushion that pushes at rest and pulls as it is driven into: its push stays, without the other."""
    session, term = session_with("end_cushion", 4e4, -3e5)
    base = session.base_model
    (free,) = score_terms(base, [term], [1])
    assert free.values[0] > 0 and free.values[1] == 0.0 and free.free[1] < 0
    held = Term(term.content, 1, term.shape, held=(1,))
    model = fit_model(base.design, base.noise, base.fitted, [held], session.prior)
    part = model.term_slice(0)
    assert model.fit.determined[part].tolist() == [True, False] and model.fit.theta[part][1] == 0.0
    assert base.fit.chi_square - model.fit.chi_square == pytest.approx(free.gain, rel=1e-6)
