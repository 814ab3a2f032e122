"""Conformance of estimators; call it from a test of your own estimator::

from fitting.estimators.conformance import check_estimator

def test_conforms() -> None:
    check_estimator(MyEstimator())
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fitting.arrays import FloatArray
from fitting.estimators.base import Estimate, Estimator

_TRUTH = np.array([3.0, -0.02, 4.0e5, 1.5])
# Columns of a cylinder: acceleration, sign of speed, position, constant; sizes as far apart as on a machine.
_SIZES = np.array([1.0, 1.0e3, 1.0e-4, 1.0])


def check_estimator(estimator: Estimator) -> None:
    """Raise ``AssertionError``, with a text that names what is wrong, if the estimator breaks the contract.

    Checked: shapes and types of the result; exact data give exact parameters; a known noise level is found, and
    errors agree with the covariance; the unit of a column changes nothing but its parameter; weights of zero remove
    rows; undetermined columns are marked, and still predict; bad input raises ``ValueError``; nothing that
    was handed in is changed; the same input gives the same result.

    Parameters
    ----------
    estimator : an object of the class, as its entry point names it
    """
    _require(isinstance(estimator, Estimator), "it has no `name` and `fit` as the protocol `Estimator` says")
    _require(isinstance(estimator.name, str) and bool(estimator.name), "its name is empty")
    rng = np.random.default_rng(20)
    A = rng.standard_normal((400, 4)) * _SIZES
    groups = np.repeat([2, 5], 200)
    _check_exact(estimator, A, groups)
    _check_noise(estimator, A, groups, rng)
    _check_scaling(estimator, A, groups, rng)
    _check_weights(estimator, A, groups, rng)
    _check_rank(estimator, A, groups, rng)
    _check_refusals(estimator, A)


def _require(condition: bool, text: str) -> None:
    if not condition:
        raise AssertionError(f"estimator does not conform: {text}")


def _shaped(estimate: Estimate, p: int, groups: int) -> None:
    _require(isinstance(estimate, Estimate), "fit does not return an Estimate")
    _require(estimate.theta.shape == (p,), "theta is not (p,)")
    _require(estimate.covariance.shape == (p, p), "covariance is not (p, p)")
    _require(estimate.determined.shape == (p,) and estimate.determined.dtype == bool, "determined is not (p,) of bool")
    _require(estimate.residual_std.shape == (groups,), "residual_std has not one entry per group")
    _require(estimate.condition_number >= 1.0 - 1e-9, "the condition number is below one")


def _check_exact(estimator: Estimator, A: FloatArray, groups: npt.NDArray[np.int_]) -> None:
    b = A @ _TRUTH
    kept_A, kept_b = A.copy(), b.copy()
    estimate = estimator.fit(A, b, groups=groups)
    _shaped(estimate, 4, 2)
    _require(bool(np.array_equal(A, kept_A) and np.array_equal(b, kept_b)), "fit changes its arguments")
    _require(bool(estimate.determined.all()), "it does not tell parameters that the rows tell")
    _require(bool(np.array_equal(estimate.groups, [2, 5])), "groups are not the labels, ascending")
    _require(
        bool(np.allclose(estimate.theta, _TRUTH, rtol=1e-8, atol=0)),
        "exact data do not give exact parameters",
    )
    again = estimator.fit(A, b, groups=groups)
    _require(bool(np.array_equal(estimate.theta, again.theta)), "the same input gives another result")


def _check_noise(estimator: Estimator, A: FloatArray, groups: npt.NDArray[np.int_], rng: np.random.Generator) -> None:
    noise = np.where(groups == 2, 0.1, 0.3)
    distances = []
    for _ in range(50):
        estimate = estimator.fit(A, A @ _TRUTH + noise * rng.standard_normal(len(A)), groups=groups)
        _require(bool(np.allclose(estimate.residual_std, [0.1, 0.3], rtol=0.25)), "residual_std is not the noise's")
        _require(bool(np.allclose(estimate.covariance, estimate.covariance.T)), "covariance is not symmetric")
        error = estimate.theta - _TRUTH
        distances.append(error @ np.linalg.solve(estimate.covariance, error))
    # Mean of 50 chi-squares with 4 degrees of freedom: 4 +- 0.4; the rest is room for approximate covariances.
    _require(2.0 < float(np.mean(distances)) < 8.0, "errors do not agree with the covariance")


def _check_scaling(estimator: Estimator, A: FloatArray, groups: npt.NDArray[np.int_], rng: np.random.Generator) -> None:
    b = A @ _TRUTH + 0.1 * rng.standard_normal(len(A))
    scale = np.array([1.0e6, 1.0, 1.0e-6, 1.0])
    one = estimator.fit(A, b, groups=groups).theta
    other = estimator.fit(A * scale, b, groups=groups).theta * scale
    _require(bool(np.allclose(one, other, rtol=1e-6, atol=0)), "the unit of a column changes the result")


def _check_weights(estimator: Estimator, A: FloatArray, groups: npt.NDArray[np.int_], rng: np.random.Generator) -> None:
    b = A @ _TRUTH + 0.1 * rng.standard_normal(len(A))
    weights = (rng.uniform(size=len(A)) < 0.8).astype(float)
    spoiled = np.where(weights > 0, b, 1.0e6)
    chosen = weights > 0
    one = estimator.fit(A, spoiled, groups=groups, weights=weights).theta
    other = estimator.fit(A[chosen], b[chosen], groups=groups[chosen]).theta
    _require(bool(np.allclose(one, other, rtol=1e-6, atol=0)), "rows of weight zero count")


def _check_rank(estimator: Estimator, A: FloatArray, groups: npt.NDArray[np.int_], rng: np.random.Generator) -> None:
    # Columns 4 and 1 are the same but for a factor, column 5 is zero: none of them is determined.
    wide = np.column_stack([A, -2.0 * A[:, 1], np.zeros(len(A))])
    b = A @ _TRUTH + 0.01 * rng.standard_normal(len(A))
    estimate = estimator.fit(wide, b, groups=groups)
    _shaped(estimate, 6, 2)
    _require(
        estimate.determined.tolist() == [True, False, True, True, False, False],
        f"columns 1, 4 and 5 cannot be told from these rows, it says {estimate.determined.tolist()}",
    )
    _require(bool(np.isfinite(estimate.theta).all()), "theta is not finite where parameters cannot be told")
    _require(bool(np.isinf(estimate.std[[1, 4, 5]]).all()), "a parameter that is not told has a finite variance")
    _require(
        float(np.std(b - wide @ estimate.theta)) < 0.02,
        "the prediction is wrong where parameters cannot be told",
    )


def _check_refusals(estimator: Estimator, A: FloatArray) -> None:
    b = A @ _TRUTH
    spoiled = b.copy()
    spoiled[7] = np.nan
    cases: dict[str, tuple[FloatArray, FloatArray, FloatArray | None]] = {
        "a target of another length": (A, b[:-1], None),
        "a target with NaN": (A, spoiled, None),
        "no rows": (A[:0], b[:0], None),
        "negative weights": (A, b, -np.ones(len(b))),
    }
    for what, (rows, target, weights) in cases.items():
        try:
            estimator.fit(rows, target, weights=weights)
        except ValueError:
            continue
        _require(False, f"it takes {what} without a ValueError")
