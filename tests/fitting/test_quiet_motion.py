"""Where motion ends and its sensors' noise begins, and what is left of both."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from fitting.signals.filters import filter_bank
from fitting.signals.motion_frequency import motion_edge, quiet_motion
from fitting.signals.preparation import PositionNoise, Segment

RATE, SECONDS = 50.0, 60.0
BANK = filter_bank(RATE, 3.0)


def sines(rng: np.random.Generator, highest: float) -> tuple[np.ndarray, np.ndarray]:
    """A position of five sines up to ``highest`` Hz, rad, and its exact fourth derivative."""
    t = np.arange(round(RATE * SECONDS)) / RATE
    w = 2 * np.pi * highest * np.array([0.2, 0.4, 0.6, 0.8, 1.0])
    phase = rng.uniform(0, 2 * np.pi, 5)
    q = np.sin(t[:, None] * w + phase).sum(axis=1) * 0.05
    return q, (w**4 * np.sin(t[:, None] * w + phase)).sum(axis=1) * 0.05


@settings(max_examples=20, deadline=None)
@given(highest=st.floats(0.3, 1.5), exponent=st.floats(-4.5, -3.5), seed=st.integers(0, 999))
def test_the_edge_lies_where_the_motion_ends(highest: float, exponent: float, seed: int) -> None:
    rng, std = np.random.default_rng(seed), 10.0**exponent
    q, _ = sines(rng, highest)
    _, _, acceleration = BANK.smooth(q + std * rng.standard_normal(len(q)))
    # The window lets a strong line leak into its neighbours.
    assert highest - 3 / SECONDS <= motion_edge(acceleration, std, BANK) <= highest + 0.5


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 999))
def test_a_joint_that_only_shows_noise_does_not_move(seed: int) -> None:
    noise = 1e-4 * np.random.default_rng(seed).standard_normal(round(RATE * SECONDS))
    assert motion_edge(BANK.smooth(noise)[2], 1e-4, BANK) < 0.3


def test_without_noise_everything_is_motion() -> None:
    q, _ = sines(np.random.default_rng(0), 1.0)
    assert motion_edge(BANK.smooth(q)[2], 0.0, BANK) == BANK.bandwidth_hz


def test_a_quiet_motion_is_nearer_to_the_true_one() -> None:
    rng = np.random.default_rng(4)
    q, exact = sines(rng, 1.0)
    std = 1e-4
    smooth = BANK.smooth(q + std * rng.standard_normal(len(q)))
    q_, qd, qdd = (np.column_stack([values, np.zeros(len(values))]) for values in smooth)
    nothing = np.zeros_like(q_)
    segment = Segment(
        recording=0, role="train", start=0, t=np.arange(len(q_)) / RATE, q=q_, qd=qd, qdd=qdd, x=q_, v=qd, a=qdd,
        r=np.ones_like(q_), effort=nothing, p1=nothing, p2=nothing, rest=np.zeros(q_.shape, dtype=bool), loaded=True,
        temperature=None, gap=nothing,
    )  # fmt: skip
    known = PositionNoise(std, BANK.speed_noise(std), BANK.acceleration_noise(std))
    found = quiet_motion(segment, [known, known], BANK)
    # What a compliance needs of it: the acceleration of the acceleration.
    fourth = [BANK.rate(BANK.rate(each))[100:-100] for each in (smooth[2], found[2][:, 0])]
    raw, quiet = (np.std(each - BANK.trimmed(exact)[100:-100]) for each in fourth)
    assert quiet < 0.3 * raw
    assert not found[2][:, 1].any(), "a joint that is not moved"
    assert np.array_equal(segment.qdd[:, 0], smooth[2]), "what was given stays as it was"
