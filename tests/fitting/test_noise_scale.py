"""Noise that was never measured, in the size of the rows that are fitted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from synthetic_arm import make_session, planar_machine, truth

from fitting.loop.noise_scale import on_fitted_rows, words
from fitting.regression.streamed import fit_rows

MACHINE, ARM = planar_machine(2), truth(2)
ALONE = (("unloaded", 1), ("train", 2), ("validate", 3))


def sizes(design, noise, fitted) -> list[float]:
    """Mean square that the base model leaves of each joint's whitened rows."""
    return [float(np.mean(r**2)) for r in fit_rows(design, noise, fitted)[0].residual]


@pytest.mark.slow
@pytest.mark.parametrize("off", [0.1, 1.0, 10.0])
def test_a_noise_that_is_off_by_ten_is_the_same_as_one_that_is_not(off: float) -> None:
    prepared = make_session(MACHINE, ARM, ALONE).plain
    whitenings = prepared.noise.whitenings
    first = replace(whitenings[0], innovation=off * whitenings[0].innovation, std=off * whitenings[0].std)
    wrong = replace(prepared.noise, whitenings=(first, whitenings[1]))
    found, factors = on_fitted_rows(prepared.design, wrong, prepared.fitted)
    assert found.std == pytest.approx(prepared.noise.std, rel=2e-3)
    assert factors[0] == pytest.approx(1 / off, rel=2e-3) and factors[1] == pytest.approx(1.0, rel=2e-3)
    share = 2 * prepared.design.bank.bandwidth_hz / prepared.design.bank.reduced_rate_hz
    assert sizes(prepared.design, found, prepared.fitted) == pytest.approx([share] * 2, rel=0.08)
    said = words(("boom", "arm"), factors)
    assert [line.split(":")[0] for line in said] == ([] if off == 1.0 else ["boom"])
    assert off == 1.0 or f"{off:.2g} times the noise" in said[0]


def test_a_noise_that_was_measured_stays_as_it_is() -> None:
    prepared = make_session(MACHINE, ARM, (*ALONE, ("repeat", 2))).plain
    assert prepared.noise.measured and prepared.rescaled == (1.0, 1.0)
    again = on_fitted_rows(prepared.design, prepared.noise, prepared.fitted)[0]
    assert again.std.tolist() == prepared.noise.std.tolist()
    unloaded = [own.std for own in prepared.noise.unloaded]
    assert [own.std for own in again.unloaded] == pytest.approx(unloaded, rel=1e-3), "these were not"
