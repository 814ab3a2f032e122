"""The 95 % band of a model that was identified from recordings with a second that went wrong."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from model_examples import fitted, report_of
from synthetic_arm import RATE, make_recordings, planar_machine, truth

from daq.recordings.recording import Recording
from fitting.loop.session import Options, Session
from fitting.model.handover import hand_over, without_single
from fitting.model.prediction import predict

MACHINE = planar_machine(2)
RECORDINGS = make_recordings(MACHINE, truth(2), seconds=40.0)
PRESSURES = [f"{joint.name}.{side}" for joint in MACHINE.joints for side in ("head", "rod")]


def with_a_wrong_second(recording: Recording) -> Recording:
    """Pressures that a loose plug leaves: two bar to and fro for a second, a hundred times the noise of the effort."""
    rng = np.random.default_rng(3)
    values = {name: np.array(own) for name, own in recording.values.items()}
    for name in PRESSURES:
        values[name][500 : 500 + round(RATE)] += 2e5 * rng.normal(size=round(RATE))
    return replace(recording, values=values)


def coverage(recordings: Sequence[Recording]) -> np.ndarray:
    session = Session(MACHINE, recordings, Options(bandwidth_hz=3.0))
    model = hand_over(session, (), fitted(session, ()), report_of(session))
    return predict(model, RECORDINGS[3]).coverage


@pytest.mark.slow
def test_one_wrong_second_does_not_widen_the_band_of_all_others() -> None:
    unloaded, train, repeat, validate = RECORDINGS
    assert np.all(np.abs(coverage(RECORDINGS) - 0.95) < 0.02)
    assert np.all(np.abs(coverage([unloaded, with_a_wrong_second(train), repeat, validate]) - 0.95) < 0.02)


def noise(seconds: int, seed: int) -> list[np.ndarray]:
    return list(np.random.default_rng(seed).normal(size=(seconds, 50)))


@pytest.mark.parametrize("seed", range(5))
def test_seconds_of_plain_noise_all_count(seed: int) -> None:
    seconds = noise(60, seed)
    assert all(a is b for a, b in zip(without_single(seconds), seconds, strict=True))


def test_only_seconds_that_are_far_out_are_left_out() -> None:
    seconds = noise(60, 1)
    seconds[7], seconds[30] = 10 * seconds[7], 10 * seconds[30]
    usual = without_single(seconds)
    assert len(usual) == 58
    assert np.std(np.concatenate(usual)) == pytest.approx(1.0, abs=0.05)


def test_an_error_of_every_tenth_second_is_what_the_model_is_like() -> None:
    seconds = noise(60, 2)
    for number in range(0, 60, 8):
        seconds[number] = 10 * seconds[number]
    assert len(without_single(seconds)) == 60


def test_an_error_that_differs_from_pose_to_pose_all_counts() -> None:
    seconds = [size * own for size, own in zip(np.geomspace(1.0, 8.0, 60), noise(60, 3), strict=True)]
    assert len(without_single(seconds)) == 60


def test_no_seconds_are_none() -> None:
    assert without_single([]) == []
