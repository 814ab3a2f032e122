"""The model of a fit on live signals: the fit's own residual, late by a stated time; and what it refuses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from live_lever import COULOMB, RATE, TORQUE_STD, handed_over, recording, session, signals
from synthetic_arm import prepare

from daq import Recording
from fitting.effects import effect
from fitting.loop.session import Session
from fitting.regression.design import build_design, full_residual
from fitting.residual.laws import Law
from fitting.residual.terms import Model, Term, fit_model
from fitting.signals.splines import spline_knots
from server.identifications.live_model import JointBlock, LiveModel, NotLiveError
from server.monitor.followed import effective, scores
from server.monitor.residual_blocks import Windows


@pytest.fixture(scope="module")
def fitted() -> tuple[Session, Model]:
    made = session()
    return made, made.base_model


@pytest.fixture(scope="module")
def live(fitted: tuple[Session, Model]) -> LiveModel:
    return LiveModel(handed_over(fitted[0]))


def windows(live: LiveModel, data: Recording, seconds: float = 2.0) -> list[tuple[np.ndarray, dict[str, np.ndarray]]]:
    block = live.block_samples(seconds)
    starts = range(0, len(data) - live.overlap - block + 1, block)
    cuts = [slice(start, start + live.overlap + block) for start in starts]
    return [(data.time[cut], {name: values[cut] for name, values in data.values.items()}) for cut in cuts]


def evaluated(live: LiveModel, data: Recording) -> list[JointBlock]:
    blocks = [live.evaluate(*window) for window in windows(live, data)]
    assert all(block is not None for block in blocks)
    return [block[0] for block in blocks if block is not None]


def test_live_is_the_fits_own_residual_block_by_block(live: LiveModel, fitted: tuple[Session, Model]) -> None:
    """Zero-phase over the whole recording against the past only: what comes out differs in when, not in what."""
    made, model = fitted
    data = recording(60, 7, "operation")
    segments = prepare(made.machine, [data], made.bank, noise=made.position_noise)
    design = build_design(made.machine, made.base, made.bank, made.position_noise, segments)
    r = segments[0].r[:, 0]
    whole = made.bank.reduce(r * full_residual(design, model.fit.theta, 0, 0))
    blocks = evaluated(live, data)
    streamed = np.concatenate([block.residual for block in blocks])
    np.testing.assert_allclose(streamed, whole[: len(streamed)], atol=1e-6 * np.abs(segments[0].effort).max())
    np.testing.assert_array_equal(
        np.concatenate([block.moving for block in blocks]), design.blocks[0][0].keep[: len(streamed)]
    )


def test_the_stated_delay_is_half_of_what_the_filters_span(live: LiveModel) -> None:
    """A step of the torque appears in the residual, at half of its height, ``delay_s`` before the window's end."""
    data = recording(20, 8, "operation")
    step_at = 10.0
    raised = {**data.values, "joint1.torque": data.values["joint1.torque"] + 50.0 * (data.time >= step_at)}
    window = replace(data, values=raised)
    (block,) = live.evaluate(window.time, dict(window.values)) or ()
    rate = live.bank.reduced_rate_hz
    times = window.time[0] + live.delay_s + np.arange(len(block.residual)) / rate
    crossing = times[np.argmax(block.residual > 25.0)]
    assert abs(crossing - step_at) <= 1 / rate
    assert live.delay_s == pytest.approx((live.bank.margin + live.bank.half) / RATE)


def test_residuals_of_an_unchanged_machine_are_noise(live: LiveModel) -> None:
    blocks = evaluated(live, recording(60, 9, "operation"))
    share = np.linalg.norm(live.bank.identification)
    assert np.median([effective(block) for block in blocks]) == pytest.approx(TORQUE_STD * share, rel=0.25)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "statistic", "size"),
    [({"coulomb": COULOMB + 4.0}, "direction", 4.0), ({"bias": 4.0}, "offset", 4.0)],
    ids=["friction", "bias"],
)
def test_each_statistic_sees_its_change_in_the_efforts_unit(
    live: LiveModel, change: dict[str, float], statistic: str, size: float
) -> None:
    before = [scores(block) for block in evaluated(live, recording(120, 5, "operation"))]
    after = [scores(block) for block in evaluated(live, recording(120, 5, "operation", **change))]
    shift = np.median([b[statistic] - a[statistic] for a, b in zip(before, after, strict=True) if a and b])
    rows = live.block_samples(2.0) / live.bank.decimation
    assert shift / np.sqrt(rows) == pytest.approx(size, rel=0.2)


def test_friction_is_not_seen_by_the_mean_over_strokes(live: LiveModel) -> None:
    """Why there is a statistic of the direction at all."""
    blocks = evaluated(live, recording(120, 5, "operation", coulomb=COULOMB + 4.0))
    assert abs(np.mean(np.concatenate([block.residual for block in blocks]))) < 0.4


def test_a_window_with_a_gap_is_not_evaluated(live: LiveModel) -> None:
    data = recording(20, 6, "operation")
    time, values = windows(live, data)[0]
    holed = {**values, "joint1.torque": values["joint1.torque"].copy()}
    holed["joint1.torque"][40] = np.nan
    assert live.evaluate(time, holed) is None
    jumped = time.copy()
    jumped[60:] += 0.5
    assert live.evaluate(jumped, values) is None


def test_a_joint_at_rest_says_nothing(live: LiveModel) -> None:
    time, values = windows(live, recording(20, 6, "operation"))[0]
    random = np.random.default_rng(1)
    still = {**values, "joint1.angle": 0.3 + 2e-5 * random.standard_normal(len(time))}
    (block,) = live.evaluate(time, still) or ()
    assert scores(block) is None
    assert np.isnan(effective(block))


def test_effects_are_evaluated_live(fitted: tuple[Session, Model]) -> None:
    made, _ = fitted
    term = Term(effect("quadratic_loss"), 0)
    model = fit_model(made.plain.design, made.plain.noise, made.plain.fitted, (term,), made.prior)
    live = LiveModel(handed_over(made, (term,)))
    t, values = signals(20, 4)
    (block,) = live.evaluate(t, values) or ()
    segments = prepare(made.machine, [recording(20, 4, "operation")], made.bank, noise=made.position_noise)
    design = build_design(made.machine, made.base, made.bank, made.position_noise, segments)
    v = segments[0].v[:, 0]
    own = full_residual(design, model.fit.theta[:-1], 0, 0) - model.fit.theta[-1] * v * np.abs(v)
    np.testing.assert_allclose(block.residual, made.bank.reduce(own), atol=1e-6 * np.abs(values["joint1.torque"]).max())


def test_effects_that_only_a_recording_tells_are_refused_and_not_guessed(fitted: tuple[Session, Model]) -> None:
    made, _ = fitted
    for id in ("thermal_viscosity_drift", "pressure_drift"):
        content = effect(id)
        shapes = content.shapes(made.base_model.views[0][0])
        term = Term(content, 0, dict(shapes[0]) if shapes else {})
        with pytest.raises(NotLiveError):
            LiveModel(handed_over(made, (term,))).evaluate(*signals(20, 4))


def test_a_law_that_remembers_more_than_a_block_holds_is_refused(fitted: tuple[Session, Model]) -> None:
    made, _ = fitted
    term = Term(Law("time_since_reversal", None, True, False, tuple(spline_knots(np.linspace(0.0, 3.0, 50), 4))), 0)
    with pytest.raises(NotLiveError, match="since the last reversal"):
        LiveModel(handed_over(made, (term,)))


def test_windows_step_by_blocks_and_begin_anew_after_a_loss() -> None:
    cutter = Windows(overlap=4, block=3)
    rows = np.arange(100).astype([("n", int)])
    found = [window["n"].tolist() for part in np.split(rows[:20], [1, 8, 9]) for window in cutter.push(part)]
    assert found == [list(range(start, start + 7)) for start in (0, 3, 6, 9, 12)]
    found = [window["n"].tolist() for window in cutter.push(rows[50:58], missed=30)]
    assert found == [list(range(50, 57))]
