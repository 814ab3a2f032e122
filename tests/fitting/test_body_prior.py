"""What is believed beforehand: files of it, and least squares drawn toward it."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from arm_examples import physical_links, planar_arm, standard_parameters
from hypothesis import given, settings
from hypothesis import strategies as st

from daq.errors import InputError
from fitting.arm.base_parameters import BaseParameters, reduce_parameters
from fitting.estimators import StageTwo, within
from fitting.estimators.ridge import RidgeTowardPrior
from fitting.estimators.wls import WeightedLeastSquares
from fitting.regression.body_prior import REPORT_DRIFT, BodyPrior, read_body_prior


def drawing(n: int, **changes: Any) -> tuple[dict[str, Any], np.ndarray]:
    """Content of a drawing of ``n`` links, and their standard parameters."""
    masses, centres, inertias = physical_links(n, np.random.default_rng(1))
    links = [
        {"mass": float(m), "centre": c.tolist(), "inertia": i[np.triu_indices(3)].tolist()}
        for m, c, i in zip(masses, centres, inertias, strict=True)
    ]
    content = {"schema": "hilfit/body-prior/1", "links": links} | changes
    return content, standard_parameters(masses, centres, inertias)


def written(path: Path, content: Any) -> Path:
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return path


def report(base: BaseParameters, value: float = 2.0, std: float = 0.1) -> dict[str, Any]:
    entries = [{"expression": e, "value": value, "std": std} for e in base.expressions]
    return {"schema": "hilfit/report/1", "rigid_body": {"parameters": entries}}


# --- files --------------------------------------------------------------------------------------------------------


def test_a_drawing_gives_the_base_parameters_of_its_links(tmp_path: Path) -> None:
    base = reduce_parameters(planar_arm(3))
    content, pi = drawing(3, relative_std=0.2)
    prior = read_body_prior(written(tmp_path / "links.yaml", content), base)
    assert prior.mean == pytest.approx(base.from_standard(pi), rel=1e-12)
    assert prior.standard == pytest.approx(pi.ravel(), rel=1e-12)
    assert prior.source == "links.yaml"
    twice = read_body_prior(written(tmp_path / "twice.yaml", content | {"relative_std": 0.4}), base)
    assert twice.std == pytest.approx(2 * prior.std, rel=1e-12)


def test_a_drawing_is_as_uncertain_as_its_parts(tmp_path: Path) -> None:
    # One link of length a, frame at its far end: ZZ1 - a^2 m1, MX1 + a m1, MY1.
    arm = planar_arm(1)
    base, a = reduce_parameters(arm), arm.a[0]
    content, pi = drawing(1)
    prior = read_body_prior(written(tmp_path / "links.yaml", content), base)
    link = pi[0]
    mass, moment, inertia = 0.3 * link[0], 0.3 * np.linalg.norm(link[1:4]), 0.1 * (link[4] + link[7] + link[9])
    expected = {"ZZ1": np.hypot(inertia, a**2 * mass), "MX1": np.hypot(moment, a * mass), "MY1": moment}
    assert dict(zip(base.names, prior.std, strict=True)) == pytest.approx(expected, rel=1e-9)


def test_an_earlier_report_is_taken_with_its_deviations_and_a_drift(tmp_path: Path) -> None:
    base = reduce_parameters(planar_arm(2))
    path = tmp_path / "report.json"
    path.write_text(json.dumps(report(base)), encoding="utf-8")
    prior = read_body_prior(path, base)
    assert prior.mean.tolist() == [2.0] * len(base)
    assert prior.std == pytest.approx(np.full(len(base), np.hypot(0.1, REPORT_DRIFT * 2.0)))
    assert prior.standard is None


def test_what_a_report_could_not_tell_is_not_believed(tmp_path: Path) -> None:
    base = reduce_parameters(planar_arm(2))
    content = report(base)
    content["rigid_body"]["parameters"][1]["value"] = None
    prior = read_body_prior(written(tmp_path / "r.json", content), base)
    assert np.isinf(prior.std[1]) and np.isfinite(np.delete(prior.std, 1)).all()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda c: c.update(schema="hilfit/machine/1"), "schema is"),
        (lambda c: c["links"].pop(), "links: 1 are given, the machine has 2"),
        (lambda c: c["links"][0].update(mass=-1.0), r"links\.0\.mass"),
        (lambda c: c["links"][1].update(colour="red"), r"links\.1\.colour"),
        (lambda c: c["links"][1].update(inertia=[1.0, 0, 0, 1.0, 0, 5.0]), r"links\.1\.inertia: no body"),
        (lambda c: c.update(relative_std=0.0), "relative_std"),
    ],
)
def test_a_wrong_drawing_is_refused_by_file_and_key(tmp_path: Path, change: Any, says: str) -> None:
    content, _ = drawing(2)
    change(content)
    with pytest.raises(InputError, match=says) as caught:
        read_body_prior(written(tmp_path / "links.yaml", content), reduce_parameters(planar_arm(2)))
    assert "links.yaml" in str(caught.value) and "\n" not in str(caught.value)


def test_a_report_of_another_machine_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path / "report.json", report(reduce_parameters(planar_arm(2))))
    with pytest.raises(InputError, match="6 are given, the machine has 9"):
        read_body_prior(path, reduce_parameters(planar_arm(3)))
    content = report(reduce_parameters(planar_arm(2)))
    content["rigid_body"]["parameters"][0]["expression"] = "ZZ1 + 2 m2"
    with pytest.raises(InputError, match="is of another machine"):
        read_body_prior(written(path, content), reduce_parameters(planar_arm(2)))


@pytest.mark.parametrize(
    ("key", "value"), [("value", "heavy"), ("value", math.nan), ("std", -1.0), ("expression", None)]
)
def test_a_parameter_of_a_report_that_is_none_is_refused_by_its_key(tmp_path: Path, key: str, value: Any) -> None:
    base = reduce_parameters(planar_arm(2))
    content = report(base)
    content["rigid_body"]["parameters"][1][key] = value
    path = tmp_path / "report.json"
    path.write_text(json.dumps(content))
    with pytest.raises(InputError, match=rf"report\.json: rigid_body\.parameters\.1\.{key}: must be"):
        read_body_prior(path, base)


@pytest.mark.parametrize("content", [b"\xff\xfe\x00", b"{", b"", b"[1, 2]", b"[" * 5000])
def test_what_is_no_file_of_this_kind_is_refused_in_one_line(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "prior.yaml"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"prior\.yaml") as caught:
        read_body_prior(path, reduce_parameters(planar_arm(1)))
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        read_body_prior(tmp_path / "none.yaml", reduce_parameters(planar_arm(1)))


# --- ridge --------------------------------------------------------------------------------------------------------


def prior_of(mean: list[float], std: list[float]) -> BodyPrior:
    return BodyPrior(np.array(mean), np.array(std), None, "test")


def test_one_parameter_is_the_mean_weighted_by_certainty() -> None:
    rng = np.random.default_rng(2)
    b = 3.0 + rng.standard_normal(100)
    free = WeightedLeastSquares().fit(np.ones((100, 1)), b)
    found = RidgeTowardPrior(prior=prior_of([0.0], [0.1]), names=("a",)).fit(np.ones((100, 1)), b)
    # Normal prior, normal mean: Bayes' theorem in one line.
    w, v = 1 / free.std[0] ** 2, 1 / 0.1**2
    assert found.theta[0] == pytest.approx(w * free.theta[0] / (w + v), rel=1e-9)
    assert found.std[0] == pytest.approx((w + v) ** -0.5, rel=1e-9)
    assert found.details["told_by_data"]["a"] == pytest.approx(w / (w + v), rel=1e-9)


@given(st.integers(0, 10_000))
@settings(max_examples=30, deadline=None)
def test_the_posterior_is_that_of_the_textbook(seed: int) -> None:
    rng = np.random.default_rng(seed)
    A, mean, std = rng.standard_normal((40, 3)), rng.standard_normal(3), rng.uniform(0.05, 2.0, 3)
    b = A @ rng.standard_normal(3) + 0.3 * rng.standard_normal(40)
    free = WeightedLeastSquares().fit(A, b)
    found = RidgeTowardPrior(prior=prior_of(mean.tolist(), std.tolist()), names=("a", "b", "c")).fit(A, b)
    information = np.linalg.inv(free.covariance)
    posterior = np.linalg.inv(information + np.diag(std**-2.0))
    assert found.covariance == pytest.approx(posterior, rel=1e-6, abs=1e-12)
    assert found.theta == pytest.approx(posterior @ (information @ free.theta + mean / std**2), rel=1e-6, abs=1e-9)


def test_what_the_rows_cannot_tell_is_the_priors() -> None:
    rng = np.random.default_rng(3)
    a = rng.standard_normal(200)
    A = np.column_stack([a, a, np.zeros(200)])  # only the sum of the first two, and nothing of the third
    b = 5.0 * a + 0.01 * rng.standard_normal(200)
    found = RidgeTowardPrior(prior=prior_of([1.0, 2.0, 7.0], [1.0, 1.0, 0.5]), names=("a", "b", "c")).fit(A, b)
    # The missing 2 are shared alike, because both are believed alike.
    assert found.theta == pytest.approx([2.0, 3.0, 7.0], abs=0.01)
    assert found.std[2] == pytest.approx(0.5) and found.determined.all()
    assert found.details["told_by_data"]["c"] == pytest.approx(0.0, abs=1e-9)


def test_coloured_rows_weigh_less_than_white_ones() -> None:
    rng = np.random.default_rng(4)
    e = np.repeat(rng.standard_normal(60), 20)  # each value twenty times: sixty rows' worth, not 1200
    A, prior = np.ones((1200, 1)), prior_of([0.0], [0.1])
    as_white = RidgeTowardPrior("white", prior, ("a",)).fit(A, 1.0 + e).theta[0]
    known = RidgeTowardPrior("hac", prior, ("a",)).fit(A, 1.0 + e).theta[0]
    assert known < 0.7 * as_white


def test_without_a_prior_it_says_what_to_give() -> None:
    arm = planar_arm(1)
    with pytest.raises(InputError, match=r"^estimator 'ridge' needs a prior: .*--prior FILE$"):
        within(RidgeTowardPrior(), StageTwo(arm, reduce_parameters(arm)))


def test_a_prior_of_another_length_is_refused() -> None:
    with pytest.raises(ValueError, match="the prior has 1 parameters, the regressor 2"):
        RidgeTowardPrior(prior=prior_of([0.0], [1.0]), names=("a",)).fit(np.eye(3)[:, :2], np.ones(3))
