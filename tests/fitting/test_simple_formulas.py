"""The simple formula nearest to a law: curves of each family are told as what they are."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fitting.residual.simple_formulas import nearest_formula, simple_curves
from fitting.signals.splines import evaluate, spline_knots

X = np.linspace(0.1, 0.6, 61)
V = np.linspace(-0.2, 0.2, 61)


@pytest.mark.parametrize(
    ("x", "curve", "kind", "shape"),
    [
        (V, 900 * np.sign(V) * np.abs(V) ** 2, "power", 2.0),
        (V, -40 * np.abs(V) ** 0.5 + 7, "power", 0.5),
        (X, 12 * np.exp(X / 0.07), "exponential", 0.07),
        (X, 30 * np.exp(-X / 0.1), "exponential", 0.1),
        (X, 5 + 2e3 * np.maximum(0, X - 0.42), "threshold", 0.42),
        (X, -2e3 * np.maximum(0, 0.25 - X), "threshold", 0.25),
        (X, 80 * np.sin(2 * np.pi * X / 0.21 + 0.4) - 3, "sine", 0.21),
        (X, np.where(X > 0.333, 50.0, -10.0), "step", 0.333),
    ],
)
def test_a_curve_of_a_family_of_formulas_is_recognised(
    x: np.ndarray, curve: np.ndarray, kind: str, shape: float
) -> None:
    found = nearest_formula(x, curve, np.full(len(x), 0.01))
    assert found is not None
    assert found.kind == kind
    assert found.shape == pytest.approx(shape, rel=0.03)
    assert found.share > 0.995
    assert found.amplitude == pytest.approx(np.ptp(curve), rel=0.02)


def test_where_a_threshold_acts_is_told() -> None:
    above, below = (nearest_formula(X, np.maximum(0, sign * (X - 0.3)), np.ones(len(X))) for sign in (1.0, -1.0))
    assert above is not None and above.rising
    assert below is not None and not below.rising


def test_points_that_are_hardly_known_hardly_count() -> None:
    """A curve is loose where there are few samples: what it does there is no part of the formula."""
    curve, std = 100 * X, np.full(len(X), 0.1)
    curve[-5:], std[-5:] = curve[-5:] + 400, 500.0
    found = nearest_formula(X, curve, std)
    assert found is not None and found.kind == "power" and found.share > 0.95


def test_a_flat_curve_has_no_formula() -> None:
    assert nearest_formula(X, np.full(len(X), 3.0), np.ones(len(X))) is None
    assert nearest_formula(X, np.zeros(len(X)), np.zeros(len(X))) is None


@pytest.mark.slow
@settings(deadline=None, max_examples=25)
@given(st.lists(st.floats(-1e4, 1e4), min_size=61, max_size=61))
def test_a_share_is_a_share(values: list[float]) -> None:
    found = nearest_formula(X, values, np.ones(len(X)))
    assert found is None or (0.0 <= found.share <= 1.0 + 1e-9 and np.isfinite(found.shape))


def test_the_short_list_as_splines_is_the_formulas_themselves() -> None:
    knots = tuple(spline_knots(np.random.default_rng(0).uniform(-1.0, 1.0, 4000), 16).tolist())
    curves, shares = simple_curves(knots)
    assert shares.sum() == pytest.approx(1.0)
    assert shares.min() > 0
    assert curves.shape == (len(shares), 16, 2)
    x = np.linspace(knots[0], knots[-1], 300)
    drawn = np.einsum("xn,fnk->fxk", evaluate(np.asarray(knots), x), curves)
    own = {
        "linear": x,
        "square": x**2,
        "beyond": np.maximum(0.0, x - 0.3),
        "below": np.maximum(0.0, -0.3 - x),
        "from the left": np.exp((x[0] - x) / 0.5),
    }
    for name, wanted in own.items():
        # By the best of the list, amplitude free: none is farther off than half a step of its shape makes it.
        likeness = [_explained(curve, wanted) for curve in drawn]
        assert max(likeness) > 0.99, name
    # No formula has an offset: what is zero below a threshold stays zero.
    assert all(_explained(curve, np.ones_like(x)) < 0.999 for curve in drawn)


def _explained(curve: np.ndarray, wanted: np.ndarray) -> float:
    used = curve[:, np.abs(curve).max(axis=0) > 1e-12]
    left = wanted - used @ np.linalg.lstsq(used, wanted, rcond=None)[0]
    return 1.0 - float(left @ left / (wanted @ wanted))
