"""The bandwidth follows the motion, not the noise of the sensors that see it."""

from __future__ import annotations

import pytest
from synthetic_arm import Noise, make_recordings, planar_machine, truth

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
