"""Two witnesses: estimates are those of an explicit fit, verdicts are right and rarely accuse."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fitting.residual.confirmation.witness import Witness, objection, witness


class Rows:
    """A shared base model on unloaded and loaded rows, and a candidate's columns."""

    def __init__(self, seed: int, k: int = 1, unloaded: int = 300, loaded: int = 900, base: int = 8) -> None:
        self.rng = np.random.default_rng(seed)
        self.unloaded = np.arange(unloaded + loaded) < unloaded
        self.A = self.rng.normal(size=(unloaded + loaded, base))
        self.A[:unloaded, base // 2 :] = 0.0  # rigid body
        self.columns = self.rng.normal(size=(unloaded + loaded, k)) + 0.8 * self.A[:, :1]
        self.Q = np.linalg.qr(self.A)[0]

    def witness(self, unloaded: float = 0.0, loaded: float = 0.0) -> Witness:
        """The witness where the candidate has these coefficients."""
        size = np.where(self.unloaded, unloaded, loaded)
        b = self.A @ np.arange(1.0, self.A.shape[1] + 1) + size * self.columns.sum(axis=1)
        b = b + self.rng.standard_normal(len(b))
        self.b = b
        return witness(self.columns, b - self.Q @ (self.Q.T @ b), self.Q, self.unloaded)


@pytest.mark.parametrize("k", [1, 3])
def test_estimates_are_those_of_a_fit_with_two_sets_of_coefficients(k: int) -> None:
    rows = Rows(1, k)
    found = rows.witness(0.3, 0.5)
    halves = [rows.columns * mask[:, None] for mask in (rows.unloaded, ~rows.unloaded)]
    whole = np.hstack([rows.A, *halves])
    theta = np.linalg.lstsq(whole, rows.b, rcond=None)[0][-2 * k :]
    covariance = np.linalg.inv(whole.T @ whole)[-2 * k :, -2 * k :]
    assert found.unloaded == pytest.approx(theta[:k])
    assert found.loaded == pytest.approx(theta[k:])
    if k == 1:
        std = np.sqrt(np.diag(covariance))
        assert found.unloaded_z == pytest.approx(abs(theta[0]) / std[0])
        assert found.loaded_z == pytest.approx(abs(theta[1]) / std[1])
        assert found.expected_unloaded == pytest.approx(abs(theta[1]) / std[0])
        both = np.sqrt(std[0] ** 2 + std[1] ** 2 - 2 * covariance[0, 1])
        assert found.difference_z == pytest.approx(abs(theta[0] - theta[1]) / both)


@pytest.mark.parametrize(
    ("unloaded", "loaded", "verdict"),
    [
        (0.5, 0.5, "both"),
        (0.0, 0.6, "gone_unloaded"),
        (0.6, 0.0, "only_unloaded"),
        (0.5, 1.5, "different"),
        (0.0, 0.0, "neither"),
    ],
)
@pytest.mark.parametrize("k", [1, 3])
def test_large_effects_are_told_apart(unloaded: float, loaded: float, verdict: str, k: int) -> None:
    for seed in range(10):
        assert Rows(seed, k).witness(unloaded, loaded).verdict == verdict


def test_a_witness_that_could_not_have_seen_it_is_silent() -> None:
    for seed in range(10):
        rows = Rows(seed)
        rows.columns[rows.unloaded] *= 0.02
        found = rows.witness(0.0, 0.5)
        assert found.verdict == "silent"
        assert objection("cylinder", found) == ""


def test_without_unloaded_rows_nothing_is_said() -> None:
    found = Rows(3, unloaded=0).witness(0.0, 0.5)
    assert found.verdict == "silent"
    assert (found.unloaded_z, found.expected_unloaded) == (0.0, 0.0)


def test_a_column_that_the_base_absorbs_is_no_evidence() -> None:
    rows = Rows(4)
    rows.columns = rows.A[:, :1].copy()
    found = witness(rows.columns, np.zeros(len(rows.columns)), rows.Q, rows.unloaded)
    assert found.verdict == "neither"


@settings(max_examples=40)
@given(st.integers(0, 10_000), st.floats(0.1, 0.6), st.sampled_from([1, 2]))
def test_what_is_in_both_is_never_said_to_be_gone(seed: int, size: float, k: int) -> None:
    # A difference of four standard errors comes once in 16 000 cases by chance.
    rows = Rows(seed, k, unloaded=80)
    assert rows.witness(size, size).verdict not in ("gone_unloaded", "only_unloaded")


@settings(max_examples=20)
@given(st.floats(1e-6, 1e6), st.integers(0, 100))
def test_units_of_a_column_do_not_matter(scale: float, seed: int) -> None:
    first, second = Rows(seed, 2), Rows(seed, 2)
    second.columns[:, 0] *= scale
    a, b = first.witness(0.2, 0.5), witness_like(second, scale)
    assert a.verdict == b.verdict
    assert a.loaded_z == pytest.approx(b.loaded_z, rel=1e-6)
    assert a.difference_z == pytest.approx(b.difference_z, rel=1e-6, abs=1e-6)


def witness_like(rows: Rows, scale: float) -> Witness:
    """As `Rows.witness(0.2, 0.5)` on the columns before they were scaled."""
    columns = rows.columns.copy()
    rows.columns[:, 0] /= scale
    rows.witness(0.2, 0.5)
    b = rows.b
    return witness(columns, b - rows.Q @ (rows.Q.T @ b), rows.Q, rows.unloaded)


def test_what_is_gone_without_a_load_is_not_the_cylinders() -> None:
    gone, there = Rows(7).witness(0.0, 0.6), Rows(7).witness(0.6, 0.6)
    assert "gone when unloaded" in objection("cylinder", gone)
    assert "gone when unloaded" in objection("measurement", gone)
    assert objection("joint", gone) == ""
    assert objection("cylinder", there) == ""


def test_words_name_what_was_seen() -> None:
    for unloaded, loaded in ((0.0, 0.0), (0.6, 0.6), (0.0, 0.6), (0.6, 0.0), (0.3, 1.5)):
        found = Rows(9).witness(unloaded, loaded)
        assert "\n" not in found.words
        assert any(character.isdigit() for character in found.words)
