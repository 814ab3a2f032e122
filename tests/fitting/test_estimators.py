"""Estimators: against exact arithmetic, against each other, and against what noise of a known kind must give."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction

import numpy as np
import numpy.typing as npt
import pytest
from coloured import automatic_lags, hac_covariance
from hypothesis import given, settings
from hypothesis import strategies as st

from fitting.estimators import Estimate, Estimator, OrdinaryLeastSquares, estimator_ids
from fitting.estimators.conformance import check_estimator
from fitting.estimators.least_squares import solve
from fitting.estimators.possible import PossibleFit
from fitting.estimators.recursive import RecursiveLeastSquares
from fitting.estimators.ridge import RidgeTowardPrior
from fitting.estimators.wls import WeightedLeastSquares

Array = npt.NDArray[np.float64]
ESTIMATORS: tuple[Estimator, ...] = (
    OrdinaryLeastSquares(),
    OrdinaryLeastSquares(colour=5),
    OrdinaryLeastSquares(colour="bootstrap"),
    WeightedLeastSquares(),
    WeightedLeastSquares(colour="hac"),
    RidgeTowardPrior(colour="hac"),
    PossibleFit(colour="hac"),
)


@pytest.mark.slow
@pytest.mark.parametrize("estimator", ESTIMATORS, ids=repr)
def test_every_estimator_conforms(estimator: Estimator) -> None:
    check_estimator(estimator)


def test_every_estimator_is_found_by_its_name() -> None:
    assert {own.name for own in ESTIMATORS} <= set(estimator_ids()), "call the file of an estimator as its name"


class _Broken(OrdinaryLeastSquares):
    """Ordinary least squares with one thing done wrong, for the check to find."""

    def __init__(self, spoil: Callable[[Array, Array, dict[str, npt.ArrayLike | None]], Estimate]) -> None:
        super().__init__()
        object.__setattr__(self, "_spoil", spoil)

    def fit(self, A: npt.ArrayLike, b: npt.ArrayLike, **options: npt.ArrayLike | None) -> Estimate:  # type: ignore[override]
        return self._spoil(np.asarray(A), np.asarray(b), options)  # type: ignore[attr-defined,no-any-return]


def _with(estimate: Estimate, **changes: object) -> Estimate:
    return Estimate(**{**vars(estimate), **changes})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("what", "spoil"),
    [
        ("exact data", lambda A, b, o: _with(e := OrdinaryLeastSquares().fit(A, b, **o), theta=e.theta * 1.001)),
        ("covariance", lambda A, b, o: _with(e := OrdinaryLeastSquares().fit(A, b, **o), covariance=e.covariance / 9)),
        ("weight zero", lambda A, b, o: OrdinaryLeastSquares().fit(A, b, groups=o.get("groups"))),
        ("cannot be told", lambda A, b, o: _with(e := OrdinaryLeastSquares().fit(A, b, **o), determined=e.theta < 9e9)),
        ("unit of a column", lambda A, b, o: OrdinaryLeastSquares().fit(A + (A.std() > 1e4) * 1e-3, b, **o)),
        ("ValueError", lambda A, b, o: OrdinaryLeastSquares().fit(A, np.nan_to_num(b), **o)),
    ],
)
def test_the_conformance_check_finds_what_is_broken(what: str, spoil: Callable[..., Estimate]) -> None:
    with pytest.raises(AssertionError, match=what):
        check_estimator(_Broken(spoil))


# --- least squares ------------------------------------------------------------------------------------------------


def exact_least_squares(A: Array, b: Array) -> Array:
    """Normal equations in rational arithmetic: no rounding at all."""
    rows = [[Fraction(float(v)) for v in row] for row in A]
    target = [Fraction(float(v)) for v in b]
    p = A.shape[1]
    M = [
        [sum((r[i] * r[j] for r in rows), Fraction(0)) for j in range(p)]
        + [sum((r[i] * t for r, t in zip(rows, target, strict=True)), Fraction(0))]
        for i in range(p)
    ]
    for k in range(p):
        pivot = next(i for i in range(k, p) if M[i][k] != 0)
        M[k], M[pivot] = M[pivot], M[k]
        for i in range(p):
            if i != k:
                factor = M[i][k] / M[k][k]
                M[i] = [x - factor * y for x, y in zip(M[i], M[k], strict=True)]
    return np.array([float(M[k][p] / M[k][k]) for k in range(p)])


def conditioned(rng: np.random.Generator, rows: int, columns: int, condition: float) -> Array:
    """Random (rows, columns) with singular values spread evenly (in ratio) over 1 .. 1/condition."""
    U = np.linalg.qr(rng.standard_normal((rows, columns)))[0]
    V = np.linalg.qr(rng.standard_normal((columns, columns)))[0]
    return np.asarray((U * np.geomspace(1.0, 1.0 / condition, columns)) @ V.T * np.sqrt(rows))


@pytest.mark.parametrize("condition", [1e2, 1e6])
def test_ordinary_least_squares_is_right_to_the_conditions_rounding(condition: float) -> None:
    rng = np.random.default_rng(1)
    A = conditioned(rng, 60, 4, condition)
    b = A @ np.array([1.0, -2.0, 3.0, -4.0]) + 1e-3 * rng.standard_normal(60)
    exact = exact_least_squares(A, b)
    error = np.linalg.norm(OrdinaryLeastSquares().fit(A, b).theta - exact) / np.linalg.norm(exact)
    # Golub and Van Loan 5.3.7: eps times the condition, and its square times the small residual.
    assert error < 50 * np.finfo(float).eps * (condition + condition**2 * 1e-3 / np.linalg.norm(exact))


def test_condition_number_is_of_unit_columns() -> None:
    A = np.column_stack([np.ones(8), np.tile([1.0, -1.0], 4)]) * [1.0e6, 1.0e-6]
    assert OrdinaryLeastSquares().fit(A, np.ones(8)).condition_number == pytest.approx(1.0)


@pytest.mark.parametrize("size", [1e-200, 1e-12, 1.0, 1e12, 1e200])
def test_a_columns_size_does_not_decide_whether_it_counts(size: float) -> None:
    rng = np.random.default_rng(2)
    A = rng.standard_normal((50, 3))
    theta = solve(A * [1.0, size, 1.0], A @ [1.0, 2.0, 3.0]).theta
    assert theta * [1.0, size, 1.0] == pytest.approx([1.0, 2.0, 3.0], rel=1e-12)


@given(st.integers(0, 10_000), st.integers(1, 3))
@settings(max_examples=30, deadline=None)
def test_exactly_the_columns_outside_the_null_space_are_identifiable(seed: int, tied: int) -> None:
    rng = np.random.default_rng(seed)
    free = rng.standard_normal((40, 3))
    group = rng.standard_normal((40, tied))
    mix = rng.uniform(0.5, 2.0, (tied, 1))
    A = np.hstack([free, group, group @ mix])
    order = rng.permutation(A.shape[1])
    b = rng.standard_normal(40)
    solution = solve(A[:, order], b)
    assert solution.determined.tolist() == (order < 3).tolist()
    assert solution.rank == 3 + tied
    projection = A @ np.linalg.pinv(A) @ b
    assert A[:, order] @ solution.theta == pytest.approx(projection, abs=1e-10)


def test_as_many_rows_as_parameters_leave_no_noise_to_tell() -> None:
    estimate = OrdinaryLeastSquares().fit(np.eye(3), [1.0, 2.0, 3.0])
    assert estimate.theta.tolist() == [1.0, 2.0, 3.0]
    assert np.isnan(estimate.residual_std).all() and np.isnan(estimate.std).all()


@pytest.mark.parametrize("estimator", ESTIMATORS, ids=repr)
def test_rows_of_zeros_tell_nothing_and_say_so(estimator: Estimator) -> None:
    estimate = estimator.fit(np.zeros((9, 2)), np.ones(9))
    assert not estimate.determined.any()
    assert estimate.theta.tolist() == [0.0, 0.0]
    assert np.isinf(estimate.std).all()


# --- coloured residuals -------------------------------------------------------------------------------------------


def autoregression(rng: np.random.Generator, n: int, rho: float) -> Array:
    e = np.empty(n)
    e[0] = rng.standard_normal()
    for t in range(1, n):
        e[t] = rho * e[t - 1] + np.sqrt(1 - rho**2) * rng.standard_normal()
    return e


def test_newey_west_agrees_with_the_sum_written_out() -> None:
    rng = np.random.default_rng(3)
    A, e, lags = rng.standard_normal((30, 2)), rng.standard_normal(30), 4
    inverse = np.linalg.inv(A.T @ A)
    S = sum(
        max(0.0, 1 - abs(t - s) / (lags + 1)) * e[t] * e[s] * np.outer(A[t], A[s]) for t in range(30) for s in range(30)
    )
    assert hac_covariance(A, e, lags) == pytest.approx(inverse @ S @ inverse * 30 / 28, rel=1e-10)


def test_products_never_cross_from_one_series_to_another() -> None:
    rng = np.random.default_rng(4)
    A, e = rng.standard_normal((40, 2)), rng.standard_normal(40)
    series = np.repeat([0, 1], 20)
    apart = hac_covariance(A, e, 6, groups=series)
    # Far apart in one series is the same as two series.
    pad = np.zeros((6, 2))
    padded = hac_covariance(np.vstack([A[:20], pad, A[20:]]), np.concatenate([e[:20], np.zeros(6), e[20:]]), 6)
    assert apart * (38 / 40) == pytest.approx(padded * (44 / 46), rel=1e-10)


@pytest.mark.slow
def test_newey_west_knows_coloured_residuals_and_the_textbook_formula_does_not() -> None:
    rng = np.random.default_rng(5)
    n, rho = 1500, 0.93
    A = np.column_stack([np.ones(n), autoregression(rng, n, 0.95)])
    found, promised, white = [], [], []
    for _ in range(100):
        b = autoregression(rng, n, rho)
        plain = OrdinaryLeastSquares().fit(A, b)
        found.append(plain.theta[0])
        white.append(plain.std[0])
        promised.append(OrdinaryLeastSquares(colour=automatic_lags(b - A @ plain.theta)).fit(A, b).std[0])
    spread = float(np.std(found))
    # sqrt((1 + rho) / (1 - rho)) = 5.3 for a constant.
    assert spread / np.mean(white) > 4
    # 100 runs give the spread to 7 %; Bartlett weights promise somewhat too little at this colour.
    assert 1.0 < spread / np.mean(promised) < 1.5


@pytest.mark.parametrize(("rho", "n"), [(0.5, 1000), (0.9, 3000)])
def test_automatic_lags_follow_the_plug_in_rule(rho: float, n: int) -> None:
    e = autoregression(np.random.default_rng(6), n, rho)
    rule = 1.1447 * (4 * rho**2 / (1 - rho**2) ** 2 * n) ** (1 / 3)
    assert automatic_lags(e) == pytest.approx(rule, rel=0.2)
    assert automatic_lags(np.zeros(10)) == 0


def test_negative_lags_are_refused() -> None:
    with pytest.raises(ValueError, match="lags is -1"):
        hac_covariance(np.ones((5, 1)), np.ones(5), -1)


# --- weighted, robust ---------------------------------------------------------------------------------------------


def test_weighting_by_joint_is_worth_it_where_joints_differ() -> None:
    rng = np.random.default_rng(7)
    groups = np.repeat([0, 1], 200)
    noise = np.where(groups == 0, 50.0, 0.5)
    truth = np.array([2.0, -1.0])
    errors: dict[str, list[float]] = {"ols": [], "wls": []}
    for _ in range(60):
        A = rng.standard_normal((400, 2))
        b = A @ truth + noise * rng.standard_normal(400)
        for estimator in (OrdinaryLeastSquares(), WeightedLeastSquares()):
            errors[estimator.name].append(float(np.linalg.norm(estimator.fit(A, b, groups=groups).theta - truth)))
    # Expected: only half the rows are good, with 100 times less noise; unweighted the bad ones decide.
    assert np.mean(errors["wls"]) < 0.03 * np.mean(errors["ols"])


def test_weighted_is_least_squares_on_rows_divided_by_their_groups_spread() -> None:
    rng = np.random.default_rng(8)
    A, groups = rng.standard_normal((60, 3)), np.repeat([4, 9], 30)
    b = A @ [1.0, 2.0, 3.0] + np.where(groups == 4, 1.0, 10.0) * rng.standard_normal(60)
    first = OrdinaryLeastSquares().fit(A, b, groups=groups)
    scale = first.residual_std[(groups == 9).astype(int)]
    expected = np.linalg.lstsq(A / scale[:, None], b / scale, rcond=None)[0]
    assert WeightedLeastSquares().fit(A, b, groups=groups).theta == pytest.approx(expected, rel=1e-10)


@pytest.mark.slow
def test_residual_std_is_unbiased_also_for_a_group_with_few_rows() -> None:
    rng = np.random.default_rng(9)
    groups = np.repeat([0, 1], [8, 92])
    variances = []
    for _ in range(1000):
        A = rng.standard_normal((100, 4)) * np.where(groups == 0, 5.0, 1.0)[:, None]
        estimate = OrdinaryLeastSquares().fit(A, rng.standard_normal(100), groups=groups)
        variances.append(estimate.residual_std**2)
    # Eight rows of five times the size take two of the four degrees of freedom: dividing by 8 would give 0.70.
    assert np.mean(variances, axis=0) == pytest.approx([1.0, 1.0], rel=0.07)


# --- recursive ----------------------------------------------------------------------------------------------------


def difference(A: Array, theta: Array, reference: Array) -> float:
    """How far predictions differ, relative: what rounding does to a backward stable solution, at any condition."""
    return float(np.linalg.norm(A @ (theta - reference)) / np.linalg.norm(A @ reference))


def test_one_row_at_a_time_equals_the_batch() -> None:
    rng = np.random.default_rng(12)
    A = rng.standard_normal((3000, 5)) * [1.0, 0.05, 1.0, 0.1, 0.5]
    b = A @ [7.0, 5.0e4, 600.0, 3000.0, 80.0] + 10 * rng.standard_normal(3000)
    recursion = RecursiveLeastSquares(5)
    for row, value in zip(A, b, strict=True):
        recursion.update(row, value)
    batch = OrdinaryLeastSquares().fit(A, b)
    assert recursion.theta == pytest.approx(batch.theta, rel=1e-11)
    assert recursion.covariance == pytest.approx(batch.covariance, rel=1e-9, abs=1e-12)
    assert recursion.residual_std == pytest.approx(batch.residual_std[0], rel=1e-11)
    assert recursion.condition_number == pytest.approx(batch.condition_number, rel=1e-9)


def test_at_every_moment_it_is_the_batch_of_the_rows_so_far() -> None:
    rng = np.random.default_rng(13)
    A, b = rng.standard_normal((150, 3)), rng.standard_normal(150)
    recursion = RecursiveLeastSquares(3)
    for k in range(150):
        recursion.update(A[k], b[k])
        if k >= 4:
            batch = OrdinaryLeastSquares().fit(A[: k + 1], b[: k + 1])
            assert recursion.theta == pytest.approx(batch.theta, rel=1e-9, abs=1e-11)
            assert recursion.residual_std == pytest.approx(batch.residual_std[0], rel=1e-9)


def test_reading_does_not_change_the_result() -> None:
    rng = np.random.default_rng(14)
    A, b = rng.standard_normal((100, 2)), rng.standard_normal(100)
    watched, alone = RecursiveLeastSquares(2, forgetting=0.98), RecursiveLeastSquares(2, forgetting=0.98)
    for row, value in zip(A, b, strict=True):
        watched.update(row, value)
        alone.update(row, value)
        assert np.isfinite(watched.theta).all() and watched.determined.shape == (2,)
    assert np.array_equal(watched.theta, alone.theta) and np.array_equal(watched.covariance, alone.covariance)


@given(st.lists(st.integers(1, 90), min_size=1, max_size=8), st.sampled_from([1.0, 0.99, 0.9]))
@settings(max_examples=30, deadline=None)
def test_blocks_may_be_cut_anywhere(sizes: list[int], forgetting: float) -> None:
    rng = np.random.default_rng(15)
    n = sum(sizes) + 3
    A, b = rng.standard_normal((n, 2)), rng.standard_normal(n)
    whole, cut = RecursiveLeastSquares(2, forgetting=forgetting), RecursiveLeastSquares(2, forgetting=forgetting)
    whole.update(A, b)
    ends = [*np.cumsum(sizes), n]
    for start, end in zip([0, *ends[:-1]], ends, strict=True):
        cut.update(A[start:end], b[start:end])
    assert cut.theta == pytest.approx(whole.theta, rel=1e-9, abs=1e-12)
    assert cut.residual_std == pytest.approx(whole.residual_std, rel=1e-9)


def test_columns_of_a_cylinder_scaled_eight_decades_apart_lose_nothing() -> None:
    rng = np.random.default_rng(16)
    A = rng.standard_normal((100_000, 5)) * np.geomspace(1e-8, 1.0, 5)
    b = A @ [7.0e8, 5.0e6, 600.0, 30.0, 8.0] + 0.1 * rng.standard_normal(100_000)
    recursion = RecursiveLeastSquares(5)
    for start in range(0, 100_000, 1000):
        recursion.update(A[start : start + 1000], b[start : start + 1000])
    assert recursion.theta == pytest.approx(OrdinaryLeastSquares().fit(A, b).theta, rel=1e-11)


def covariance_recursion(A: Array, b: Array) -> Array:
    """The textbook's recursion on the covariance P, which loses its definiteness: what not to use."""
    P, theta = 1e12 * np.eye(A.shape[1]), np.zeros(A.shape[1])
    for a, value in zip(A, b, strict=True):
        gain = P @ a / (1.0 + a @ P @ a)
        theta = theta + gain * (value - a @ theta)
        P = P - np.outer(gain, a @ P)
    return theta


@pytest.mark.slow
def test_a_hundred_thousand_updates_at_condition_1e8() -> None:
    rng = np.random.default_rng(17)
    n, condition = 100_000, 1e8
    A = conditioned(rng, n, 5, condition)
    truth = np.array([1.0, -2.0, 3.0, -4.0, 5.0])
    b = A @ truth + 1e-6 * rng.standard_normal(n)
    recursion = RecursiveLeastSquares(5)
    for row, value in zip(A, b, strict=True):
        recursion.update(row, value)
    batch = OrdinaryLeastSquares().fit(A, b)
    assert difference(A, recursion.theta, batch.theta) < 1e-9
    # Along the weakest direction the condition number costs eight digits of the sixteen (eps times 1e8 is 2e-8),
    # in any algorithm and in the batch too; the parameters' own uncertainty there is a million times larger.
    assert np.abs(recursion.theta - batch.theta).max() / np.abs(batch.theta).max() < 20e-8
    assert (np.abs(recursion.theta - batch.theta) < 1e-5 * batch.std).all()
    # The covariance form is some hundred thousand times further off by a tenth of the way; how far depends on rounding.
    first, values = A[:10_000], b[:10_000]
    right, early = OrdinaryLeastSquares().fit(first, values), RecursiveLeastSquares(5)
    early.update(first, values)
    off = difference(first, covariance_recursion(first, values), right.theta)
    assert off > 1000 * difference(first, early.theta, right.theta)
    assert off > 1e-10


@pytest.mark.parametrize("forgetting", [0.999, 0.98, 0.9])
def test_forgetting_is_exponentially_weighted_least_squares(forgetting: float) -> None:
    rng = np.random.default_rng(18)
    A, b = rng.standard_normal((700, 3)), rng.standard_normal(700)
    recursion = RecursiveLeastSquares(3, forgetting=forgetting)
    for row, value in zip(A, b, strict=True):
        recursion.update(row, value)
    weights = forgetting ** np.arange(699, -1, -1.0)
    batch = OrdinaryLeastSquares().fit(A, b, weights=weights)
    assert recursion.theta == pytest.approx(batch.theta, rel=1e-10)
    inverse = np.linalg.inv((A * weights[:, None]).T @ A)
    middle = (A * weights[:, None] ** 2).T @ A
    residual = b - A @ batch.theta
    sigma2 = residual @ (weights * residual) / (weights.sum() - np.trace(inverse @ middle))
    assert recursion.residual_std**2 == pytest.approx(sigma2, rel=1e-9)
    assert recursion.covariance == pytest.approx(sigma2 * inverse @ middle @ inverse, rel=1e-9, abs=1e-15)


def test_forgetting_follows_a_parameter_that_changes_and_its_covariance_is_right() -> None:
    rng = np.random.default_rng(19)
    recursion = RecursiveLeastSquares(1, forgetting=0.95)
    recursion.update(np.ones((500, 1)), np.full(500, 10.0))
    distances = []
    for _ in range(400):
        recursion.update(np.ones((100, 1)), 20.0 + rng.standard_normal(100))
        distances.append((recursion.theta[0] - 20.0) ** 2 / recursion.covariance[0, 0])
    # Old rows weigh 0.95^100 = 0.006 after the first block: 10 * 0.006 off; then a chi-square of mean one.
    assert np.mean(distances[5:]) == pytest.approx(1.0, abs=0.25)


def test_parameters_not_excited_yet_are_not_told() -> None:
    recursion = RecursiveLeastSquares(2)
    assert recursion.theta.tolist() == [0.0, 0.0] and not recursion.determined.any()
    for k in range(5):
        recursion.update([1.0, 0.0], 3.0 + 0.1 * (-1) ** k)
    assert recursion.determined.tolist() == [True, False]
    assert np.isinf(recursion.covariance[1, 1]) and np.isfinite(recursion.covariance[0, 0])
    recursion.update([1.0, 2.0], 7.0)
    assert recursion.determined.all()
    assert recursion.theta == pytest.approx([3.02, 1.99])


def test_wrong_rows_are_refused_and_change_nothing() -> None:
    recursion = RecursiveLeastSquares(2)
    recursion.update([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]], [1.0, 2.0, 3.5])
    before = recursion.theta
    for rows, target in (([1.0], 1.0), ([[1.0, 2.0]], [1.0, 2.0]), ([1.0, np.nan], 1.0), ([1.0, 2.0], np.inf)):
        with pytest.raises(ValueError, match=r"do not fit|not finite"):
            recursion.update(rows, target)
    assert np.array_equal(recursion.theta, before)


@pytest.mark.parametrize(("columns", "forgetting"), [(0, 1.0), (2, 0.0), (2, 1.1), (2, -0.5)])
def test_senseless_settings_are_refused(columns: int, forgetting: float) -> None:
    with pytest.raises(ValueError, match=r"needed|must be"):
        RecursiveLeastSquares(columns, forgetting=forgetting)
