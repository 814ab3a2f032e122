"""The noise floor from a repeated motion, against noise that was put on by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal
from synthetic_arm import (
    Noise,
    clean_session,
    disturbance,
    make_recordings,
    make_session,
    planar_machine,
    shifted,
    truth,
)

from fitting.loop.session import Options, Session
from fitting.regression.noise import difference_noise, effort_floor, noise_model, pair_repeats
from fitting.signals.filters import filter_bank

FORCE_ONLY = Noise(joint=1e-7, piston=1e-7, white=10.0, slow=6.0, pole=0.95)


def filtered_std(noise: Noise, bandwidth: float) -> float:
    """Standard deviation of the force noise behind the identification filter, from half an hour of it."""
    bank = filter_bank(50.0, bandwidth)
    return float(np.std(bank.reduce(disturbance(np.random.default_rng(99), 90_000, noise))))


def test_the_floor_is_the_noise_that_was_put_on() -> None:
    machine, arm = planar_machine(2), truth(2)
    session = make_session(machine, arm, noise=FORCE_ONLY)
    prepared, model = session.plain, session.base_model
    assert len(prepared.pairs) == 1
    pair = prepared.pairs[0]
    sigma = filtered_std(FORCE_ONLY, session.bank.bandwidth_hz)
    for joint in range(2):
        noise = session.bank.reduce(difference_noise(prepared.design, model.fit.theta, prepared.pairs, joint)[0])
        # 40 s of noise of 0.4 s memory: a hundred independent values, ten per cent at 1.4 sigma; three of them.
        assert np.std(noise) == pytest.approx(sigma, rel=0.25)
    floor = effort_floor(prepared.design, model.fit.theta, prepared.pairs)
    levers = np.sqrt(np.mean(prepared.design.segments[pair.train].r ** 2, axis=0))
    assert floor == pytest.approx(sigma * levers, rel=0.3)


@pytest.mark.slow
def test_many_floors_are_right_on_the_average() -> None:
    machine, arm = planar_machine(1), truth(1)
    ratios = []
    for seed in range(6):
        session = make_session(machine, arm, noise=FORCE_ONLY, seed=seed)
        theta = session.base_model.fit.theta
        noise = session.bank.reduce(difference_noise(session.plain.design, theta, session.plain.pairs, 0)[0])
        ratios.append(np.var(noise) / filtered_std(FORCE_ONLY, session.bank.bandwidth_hz) ** 2)
    assert np.mean(ratios) == pytest.approx(1.0, abs=4 * np.std(ratios) / np.sqrt(6))


@pytest.mark.slow
@pytest.mark.parametrize("late", [1, 150])
def test_a_repeat_that_started_later_is_aligned_first(late: int) -> None:
    machine, arm = planar_machine(2), truth(2)
    recordings = make_recordings(machine, arm, noise=FORCE_ONLY)
    recordings[2] = shifted(recordings[2], late)
    session = Session(machine, recordings)
    pair = session.plain.pairs[0]
    assert pair.train_start - pair.repeat_start == late
    in_time = make_session(machine, arm, noise=FORCE_ONLY)
    floor = effort_floor(session.plain.design, session.base_model.fit.theta, session.plain.pairs)
    other = effort_floor(in_time.plain.design, in_time.base_model.fit.theta, in_time.plain.pairs)
    assert floor == pytest.approx(other, rel=0.1)


def test_an_error_of_the_model_is_not_noise() -> None:
    """A wrong parameter makes the same error twice; the difference of the residuals does not see it."""
    session = clean_session(2)
    design, theta = session.plain.design, session.base_model.fit.theta
    wrong = theta.copy()
    wrong[design.parameters.names.index("joint1.K")] += 500.0
    right = effort_floor(design, theta, session.plain.pairs)
    assert effort_floor(design, wrong, session.plain.pairs) == pytest.approx(right, rel=0.02)


def test_another_motion_is_no_repeat() -> None:
    machine, arm = planar_machine(2), truth(2)
    session = make_session(machine, arm, (("unloaded", 1), ("train", 2), ("repeat", 4), ("validate", 3)))
    assert session.plain.pairs == ()
    assert not session.plain.noise.measured


@pytest.mark.parametrize(("late", "share", "paired"), [(0, 0.1, True), (35, 0.1, True), (0, 0.6, False)])
def test_a_repeat_may_come_to_its_motion_another_way(late: int, share: float, paired: bool) -> None:
    """Its first part is another motion, as after a controller has come from elsewhere; most has to be the same."""
    session = clean_session(2)
    design, (pair,) = session.plain.design, session.plain.pairs
    segments = list(design.segments)
    own = segments[pair.repeat]
    q = own.q[late:].copy()
    way = int(share * len(q))
    q[:way] += 0.8 * np.cos(np.pi / 2 * np.arange(way) / way)[:, None]
    segments[pair.repeat] = replace(own, q=q)
    found = pair_repeats(replace(design, segments=tuple(segments)))
    assert len(found) == paired
    for each in found:
        assert each.train_start - each.repeat_start == late
        # The way there is left out up to a sixth of the motion's spread, and little more than that.
        assert 0.5 * way < each.repeat_start < 1.1 * way
        assert len(q) - 8 <= each.repeat_start + each.length <= len(q)


def test_each_repeat_finds_its_own_training_motion() -> None:
    machine, arm = planar_machine(2), truth(2)
    roles = (("unloaded", 1), ("train", 2), ("train", 4), ("repeat", 4), ("repeat", 2), ("validate", 3))
    pairs = make_session(machine, arm, roles, seconds=30.0).plain.pairs
    assert [(p.train, p.repeat) for p in pairs] == [(2, 3), (1, 4)]


def test_without_a_repeat_the_noise_is_estimated_and_said_to_be() -> None:
    machine, arm = planar_machine(2), truth(2)
    session = make_session(machine, arm, (("unloaded", 1), ("train", 2), ("validate", 3)), noise=FORCE_ONLY)
    noise = session.plain.noise
    assert not noise.measured and session.plain.pairs == ()
    sigma = filtered_std(FORCE_ONLY, session.bank.bandwidth_hz)
    assert noise.std == pytest.approx([sigma, sigma], rel=0.3)


def test_the_measured_model_whitens_the_measured_noise() -> None:
    session = clean_session(2)
    design, pairs = session.plain.design, session.plain.pairs
    model = noise_model(design, session.plain.fitted, pairs)
    assert model.measured
    for joint in range(2):
        noise = session.bank.reduce(difference_noise(design, session.base_model.fit.theta, pairs, joint)[0])
        white = model.whitenings[joint](noise)
        # White inside the band; the roll-off of the filter is not blown up again.
        frequency, power = signal.periodogram(white, session.bank.reduced_rate_hz, scaling="density")
        power = power * session.bank.reduced_rate_hz / 2
        inside = (frequency > 0.1) & (frequency < 0.8 * session.bank.bandwidth_hz)
        assert np.mean(power[inside]) == pytest.approx(1.0, abs=4 / np.sqrt(inside.sum()))
        assert np.mean(power[frequency > 1.3 * session.bank.bandwidth_hz]) < 1.0


def test_pairs_are_found_from_the_design_alone() -> None:
    session = clean_session(2)
    assert pair_repeats(session.plain.design) == session.plain.pairs


def test_noise_while_rods_are_unpinned_is_its_own() -> None:
    """What restless links do is in the loaded recordings alone, so the free cylinders' noise is far below theirs."""
    machine, arm = planar_machine(2), truth(2)
    loud, quiet = (
        make_recordings(machine, arm, noise=replace(FORCE_ONLY, white=factor * 10.0, slow=factor * 6.0))
        for factor in (10.0, 1.0)
    )
    mixed = [a if a.role != "unloaded" else b for a, b in zip(loud, quiet, strict=True)]
    session = Session(machine, mixed, Options())
    noise, sigma = session.plain.noise, filtered_std(FORCE_ONLY, session.bank.bandwidth_hz)
    assert noise.measured and noise.std == pytest.approx([10 * sigma] * 2, rel=0.3)
    assert [own.std for own in noise.unloaded] == pytest.approx([sigma] * 2, rel=0.3)
    alike = Session(machine, loud, Options())
    friction = [s.base_model.design.parameters.names.index("joint2.f_v") for s in (session, alike)]
    stds = [s.base_model.fit.std[n] for s, n in zip((session, alike), friction, strict=True)]
    assert stds[0] < 0.25 * stds[1], "the rows without links tell friction, as far as they are quiet"
