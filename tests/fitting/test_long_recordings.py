"""Long recordings: piece by piece and from a file, the numbers are those of everything in memory at once."""

from __future__ import annotations

from dataclasses import fields, replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic_arm import clean_session, exact_design, make_recordings, planar_machine, truth

import fitting.loop.session
import fitting.signals.preparation
from daq.scratch import Scratch
from fitting.arm.geometry import geometry_of
from fitting.estimators import OrdinaryLeastSquares
from fitting.estimators.effort_fit import EffortRows
from fitting.loop.session import Options, Session
from fitting.pipeline.stage_two import identify_one_shot
from fitting.regression.design import (
    Design,
    JointBlock,
    build_design,
    effort_errors,
    reduced_residual,
    white_noise_model,
)
from fitting.regression.plausible_arm import plausible_arm
from fitting.regression.prior import mass_prior
from fitting.regression.stored import StoredBlock, StoredSegment, storing
from fitting.regression.streamed import fit_rows, triangle
from fitting.signals.filters import edge_frequency, filter_bank
from fitting.signals.preparation import Segment, pieces, segments_of

MACHINE, ARM = planar_machine(2), truth(2)
RECORDINGS = (("unloaded", 1), ("train", 2), ("repeat", 2), ("validate", 3))


def noisy(design: Design) -> Design:
    """The same with noise in its efforts, so that residuals say something."""
    rng = np.random.default_rng(8)
    segments = []
    for segment in design.segments:
        own = {item.name: getattr(segment, item.name) for item in fields(Segment)}
        own["effort"] = segment.effort + rng.normal(size=segment.effort.shape) * 5.0
        segments.append(Segment(**own))
    return build_design(design.machine, design.parameters.base, design.bank, design.noise, segments)


@pytest.fixture(scope="module")
def dense() -> Design:
    return noisy(exact_design(MACHINE, ARM, RECORDINGS))


@pytest.fixture(scope="module")
def stored(dense: Design) -> Design:
    store = storing(dense.bank, Scratch())
    return build_design(dense.machine, dense.parameters.base, dense.bank, dense.noise, dense.segments, store)


def test_what_lies_in_the_file_is_what_was_computed(dense: Design, stored: Design) -> None:
    assert stored.stored and not dense.stored
    for first, second in zip(dense.segments, stored.segments, strict=True):
        assert isinstance(second, StoredSegment) and len(first) == len(second)
        for item in fields(Segment):
            one, other = getattr(first, item.name), getattr(second, item.name)
            assert np.array_equal(one, other, equal_nan=True) if isinstance(one, np.ndarray) else one == other
    for joint, row in enumerate(dense.blocks):
        for index, first_block in enumerate(row):
            block = stored.blocks[joint][index]
            assert isinstance(block, StoredBlock)
            for item in fields(JointBlock):
                assert np.array_equal(getattr(first_block, item.name), getattr(block, item.name)), item.name
            r = dense.segments[index].r[:, joint]
            for one, other in zip(first_block.effort(dense.bank, r), block.effort(dense.bank, r), strict=True):
                assert np.array_equal(one, other)
    with pytest.raises(AttributeError, match="nothing"):
        stored.blocks[0][0].nothing  # type: ignore[attr-defined] # noqa: B018


def test_residuals_and_errors_are_the_same_from_the_file(dense: Design, stored: Design) -> None:
    theta = 1.1 * ARM.theta(MACHINE)
    for first, second in zip(effort_errors(dense, theta, (1, 3)), effort_errors(stored, theta, (1, 3)), strict=True):
        assert np.allclose(first, second, rtol=0, atol=1e-9 * np.abs(first).max())
    for joint in range(2):
        assert np.array_equal(reduced_residual(dense, theta, joint, 0), reduced_residual(stored, theta, joint, 0))


@given(st.integers(1, 9), st.integers(1, 40), st.integers(0, 3))
def test_a_triangle_stands_for_all_rows(columns: int, rows: int, seed: int) -> None:
    A = np.random.default_rng(seed).normal(size=(rows, columns))
    ends = sorted({0, rows // 3, rows // 2, rows})
    R = triangle(A[a:b] for a, b in pairwise(ends))
    assert len(R) <= columns
    assert np.allclose(R.T @ R, A.T @ A, atol=1e-12 * rows)


def test_a_triangle_of_nothing_is_refused() -> None:
    with pytest.raises(ValueError, match="no rows"):
        triangle([])


def test_the_joint_fit_is_that_of_all_rows_at_once(dense: Design, stored: Design) -> None:
    rows = EffortRows(dense, (0, 1, 2))
    arm = plausible_arm(geometry_of(MACHINE), dense.parameters.base, dense.parameters.drives, rows.triangles)
    prior = replace(mass_prior(MACHINE), arm=arm)
    noise = white_noise_model(2)
    first, second = (fit_rows(d, noise, (0, 1, 2), None, prior)[0] for d in (dense, stored))
    assert np.allclose(first.theta, second.theta, rtol=1e-9)
    assert np.allclose(first.covariance, second.covariance, rtol=1e-8, atol=1e-12 * first.covariance.max())
    assert np.array_equal(first.determined, second.determined)
    assert first.condition_number == pytest.approx(second.condition_number, rel=1e-9)
    assert [len(r) for r in first.residual] == [len(r) for r in second.residual]
    assert first.chi_square == pytest.approx(second.chi_square, rel=1e-9)
    for one, other in zip(first.residual, second.residual, strict=True):
        assert np.allclose(one, other, atol=1e-9 * np.abs(one).max())
    # A basis is any rotation of another one; what it projects on is the same.
    for one, other in zip(first.orthonormal, second.orthonormal, strict=True):
        assert np.allclose(one @ one.T, other @ other.T, atol=1e-9)


@pytest.mark.parametrize("colour", ["white", 3, "hac"])
def test_stage_two_is_ordinary_least_squares_of_all_rows(dense: Design, stored: Design, colour: str | int) -> None:
    columns, target, groups = EffortRows(dense, dense.indices("train", "repeat"), posed=True).stacked()
    # Segments are series of their own, in both.
    series = 10 * groups + np.concatenate(
        [np.full(int(dense.blocks[j][i].keep.sum()), i) for j in range(2) for i in (1, 2)]
    )
    expected = OrdinaryLeastSquares(colour=colour).fit(columns, target, groups=series)  # type: ignore[arg-type]
    spread = OrdinaryLeastSquares().fit(columns, target, groups=groups)
    everything = np.arange(columns.shape[1])
    found = EffortRows(stored, stored.indices("train", "repeat"), posed=True).ordinary(
        everything,
        np.zeros(len(everything)),
        colour,  # type: ignore[arg-type]
    )
    assert np.allclose(found.theta, expected.theta, rtol=1e-9)
    assert np.array_equal(found.determined, expected.determined)
    assert found.condition_number == pytest.approx(expected.condition_number, rel=1e-9)
    assert np.allclose(found.residual_std, spread.residual_std, rtol=1e-9)
    # The window of `hac` is chosen from the scores in the basis at hand, whose order rounding decides.
    assert np.allclose(found.std, expected.std, rtol=0.02 if colour == "hac" else 1e-8)


def test_frozen_columns_stay_where_they_are(dense: Design, stored: Design) -> None:
    columns, target, groups = EffortRows(dense, dense.indices("train"), posed=True).stacked()
    frozen = 0.9 * ARM.theta(MACHINE)
    wanted = np.arange(10, columns.shape[1])
    expected = OrdinaryLeastSquares().fit(columns[:, wanted], target - columns[:, :10] @ frozen[:10], groups=groups)
    found = EffortRows(stored, stored.indices("train"), posed=True).ordinary(wanted, frozen, "white")
    assert np.allclose(found.theta, expected.theta, rtol=1e-9)
    assert np.allclose(found.covariance, expected.covariance, rtol=1e-8)


def test_one_shot_of_a_stored_design_is_that_of_memory(dense: Design, stored: Design) -> None:
    first, second = identify_one_shot(dense, colour="white"), identify_one_shot(stored, colour="white")
    assert np.allclose(first.theta, second.theta, rtol=1e-9) and np.allclose(first.std, second.std, rtol=1e-8)


@settings(max_examples=30)
@given(st.integers(600, 4000), st.integers(0, 500), st.integers(150, 900))
def test_pieces_together_give_each_reduced_row_once(samples: int, start: int, most: int) -> None:
    bank = filter_bank(50.0, 3.0)
    raw = np.random.default_rng(samples).normal(size=start + samples)
    cut = pieces(slice(start, start + samples), bank, most)
    whole = bank.reduce(bank.smoothed(raw[start:]))
    parts = [bank.reduce(bank.smoothed(raw[piece])) for piece in cut]
    assert np.allclose(np.concatenate(parts), whole, atol=1e-9)
    assert all(len(part) for part in parts)
    assert max(piece.stop - piece.start for piece in cut) <= most + 2 * (bank.margin + bank.half) + bank.decimation


def test_segments_of_long_recordings_are_pieces_on_one_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fitting.signals.preparation, "PIECE_SAMPLES", 2 * 700)
    bank = filter_bank(50.0, 3.0)
    recordings = make_recordings(MACHINE, ARM)
    whole = list(segments_of(MACHINE, recordings, bank))
    cut = list(segments_of(MACHINE, recordings, bank, long=True))
    assert len(cut) > len(whole)
    for segment in whole:
        own = [piece for piece in cut if piece.recording == segment.recording]
        for piece in own:
            rows = slice(piece.start - segment.start, piece.start - segment.start + len(piece))
            assert np.array_equal(piece.t, segment.t[rows])
            assert np.allclose(piece.qdd, segment.qdd[rows], atol=1e-9 * np.abs(segment.qdd).max())
            assert np.array_equal(piece.effort, segment.effort[rows])


def test_a_long_session_finds_what_a_short_one_finds(monkeypatch: pytest.MonkeyPatch) -> None:
    short = clean_session()
    first, bandwidth = short.base_model.fit, short.bank.bandwidth_hz
    assert not short.long
    monkeypatch.setattr(fitting.loop.session, "LONG_SAMPLES", 1000)
    monkeypatch.setattr(fitting.signals.preparation, "PIECE_SAMPLES", 2 * 1000)
    long = Session(short.machine, short.recordings, Options(loop=False))
    assert long.long and long.bank.bandwidth_hz == pytest.approx(bandwidth, rel=0.05)
    long.require_excitation()
    second = long.base_model.fit
    assert np.array_equal(first.determined, second.determined)
    # The noise is heard on half as long stretches, so rows weigh a little otherwise.
    assert np.all(np.abs(first.theta - second.theta) < first.std)
    assert np.all((second.std / first.std > 0.5) & (second.std / first.std < 2.0))


def test_the_edge_of_a_spectrum_is_that_of_its_stretches_together() -> None:
    t = np.arange(6000) / 50.0
    tone = np.sin(2 * np.pi * 0.5 * t) + 0.2 * np.sin(2 * np.pi * 4.0 * t)
    assert edge_frequency([tone], 50.0, 0.9) == pytest.approx(0.5, abs=0.05)
    assert edge_frequency([tone[:2000], tone[2000:]], 50.0, 0.99) == pytest.approx(4.0, abs=0.1)
    assert edge_frequency([np.zeros(500)], 50.0, 0.99) == 0.0
