"""How unsure the sign of a speed is: as the sensors say, or as friction shows where it turns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from synthetic_arm import clean_session

from fitting.arm.expected import expected_sign
from fitting.regression.design import build_design, with_targets
from fitting.regression.unsure_signs import unsure_speeds

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("times", [1.0, 4.0, 8.0])
def test_a_joint_that_turns_less_surely_than_its_sensors_say_is_found_to(times: float) -> None:
    """Friction of the second joint turns where a speed does that is off by so many times the sensors' noise."""
    session = clean_session(2)
    prepared, theta = session.plain, session.base_model.fit.theta
    design = prepared.design
    # Twice the change of speed from one sample to the next, where it is zero.
    turning = [np.flatnonzero(np.diff(np.sign(own.v[:, 1]))) for own in design.segments]
    steps = [np.abs(np.diff(own.v[:, 1]))[rows] for own, rows in zip(design.segments, turning, strict=True)]
    width = 2.0 * float(np.median(np.concatenate(steps)))
    sensors = tuple(replace(own, speed=width / 8.0) for own in design.noise)
    part = design.parameters.drive_slice(1)
    friction = theta[part][design.parameters.drive[1].index("f_c")]
    rng, segments = np.random.default_rng(5), []
    for own in design.segments:
        true = np.sign(own.v[:, 1] + times * width / 8.0 * rng.standard_normal(len(own)))
        effort = own.effort.copy()
        effort[:, 1] += friction * (true - expected_sign(own.v[:, 1], design.noise[1].speed))
        segments.append(replace(own, effort=effort))
    made = with_targets(build_design(design.machine, session.base, design.bank, sensors, design.segments), segments)
    found = unsure_speeds(made, prepared.noise, prepared.fitted, sensors, [1])
    assert found[0] == sensors[0], "nobody asked of the first joint"
    assert found[1].sign == pytest.approx(times * sensors[1].speed)
    assert found[1].speed == sensors[1].speed, "what is at rest is not another matter"
