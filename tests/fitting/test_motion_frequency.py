"""The bandwidth follows the motion, not the noise of the sensors that see it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from synthetic_arm import Noise, make_recordings, planar_machine, truth

from daq.recordings.recording import Recording
from fitting.loop.session import Session

MACHINE, ARM = planar_machine(2, sensors="joint"), truth(2)


def frequency(position_std: float) -> float:
    recordings = make_recordings(MACHINE, ARM, noise=Noise(joint=position_std))
    return Session(MACHINE, recordings).motion_frequency


def test_a_noisy_encoder_does_not_pass_for_a_fast_motion() -> None:
    clean = frequency(1e-7)
    assert 0 < clean < 2.0
    for std in (1e-4, 1e-3):
        assert frequency(std) == pytest.approx(clean, rel=0.15)


@pytest.mark.parametrize("held_in", ["one recording", "all recordings"])
def test_a_held_joint_that_trembles_does_not_pass_for_a_fast_motion(held_in: str) -> None:
    recordings = make_recordings(MACHINE, ARM, noise=Noise(joint=1e-6))
    moves = Session(MACHINE, recordings).motion_frequency
    channel = MACHINE.channel("joint_position", MACHINE.joints[1].name)
    assert channel is not None

    def held(own: Recording) -> Recording:
        trembling = 0.3 + 3e-5 * np.sin(2 * np.pi * 6.0 * np.arange(len(own)) / MACHINE.rate_hz)
        return replace(own, values={**own.values, channel.name: trembling})

    loaded = [own for own in recordings if own.role != "unloaded"]
    found = Session(MACHINE, [*recordings, held(loaded[0])] if held_in == "one recording" else [*map(held, recordings)])
    assert 0 < found.motion_frequency <= moves
