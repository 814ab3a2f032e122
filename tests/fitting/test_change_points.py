"""Changes in time: gains are those of a joint refit, chances are those of simulated nulls, moments are found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal
from synthetic_arm import USUAL, clean_session, make_motion, make_session, planar_machine, truth

from fitting.loop.refits import SessionSignals
from fitting.loop.session import Options, Session
from fitting.residual.change_points import (
    ChangePoint,
    JointRows,
    change_points,
    changes,
    joint_rows,
    step_at,
    supremum_chance,
)
from fitting.signals.corrections import Corrections

RATE, SECONDS, RECORDINGS = 8.0, 60.0, 4


def smooth(rng: np.random.Generator, n: int) -> np.ndarray:
    """A motion: five sines below 0.3 Hz."""
    t = np.arange(n) / RATE
    frequencies = 0.05 * (1 + np.arange(5)) * rng.uniform(0.85, 1.15, 5)
    return np.asarray(sum(rng.normal() * np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) for f in frequencies))


def rows(
    seed: int, size: float = 0.0, column: str = "f_c", recording: int = 2, time: float = 30.0, colour: float = 0.0,
    kind: str = "once", unloaded: int | None = None, base: int = 10,
) -> JointRows:  # fmt: skip
    """Whitened rows of one joint with a step of ``size`` in one coefficient."""
    rng = np.random.default_rng(seed)
    n = round(RATE * SECONDS)
    t, numbers = np.tile(np.arange(n) / RATE, RECORDINGS), np.repeat(np.arange(RECORDINGS), n)

    def motion() -> np.ndarray:
        return np.concatenate([smooth(rng, n) for _ in range(RECORDINGS)])

    v, x = motion(), motion()
    columns = {"1": np.ones_like(v), "f_c": np.sign(v), "f_v": v, "K": x, "load": motion()}
    A = np.column_stack([v, np.sign(v), x, *(motion() for _ in range(base))])
    e = signal.lfilter([np.sqrt(1 - colour**2)], [1, -colour], rng.standard_normal(len(t)))
    Q = np.linalg.qr(A)[0]
    plain = JointRows(0, e, Q, t, numbers, numbers == unloaded, columns)
    b = A @ rng.normal(size=A.shape[1]) + size * columns[column] * changed(plain, kind, recording, time) + e
    return replace(plain, residual=b - Q @ (Q.T @ b))


def changed(data: JointRows, kind: str, recording: int | None = 2, time: float = 30.0) -> np.ndarray:
    """Where a change of this kind is at work."""
    after = data.time >= time
    if kind == "every":
        return after
    own = after & (data.recording == recording)
    return own if kind == "once" else own | (data.recording > (recording or 0))


def explicit_gain(data: JointRows, point: ChangePoint) -> tuple[float, float]:
    """Chi-square that the step takes off by numpy's lstsq, and its coefficient."""
    after = changed(data, point.kind, point.recording, point.time)
    column = data.columns[point.column]
    constant = [column * data.unloaded, column * ~data.unloaded]
    chi = []
    for more in (constant, [*constant, column * after]):
        A = np.column_stack([data.orthonormal, *more])
        theta = np.linalg.lstsq(A, data.residual, rcond=None)[0]
        rest = data.residual - A @ theta
        chi.append(rest @ rest)
    return float(chi[0] - chi[1]), float(theta[-1])


@pytest.mark.parametrize("unloaded", [None, 0])
@pytest.mark.parametrize("kind", ["once", "lasting", "every"])
def test_gain_and_change_are_those_of_a_joint_refit(kind: str, unloaded: int | None) -> None:
    data = rows(1, 1.0, kind=kind, unloaded=unloaded)
    found = change_points(data)
    assert kind in {p.kind for p in found}
    assert len(found) > 1
    for point in found:
        gain, change = explicit_gain(data, point)
        assert point.gain == pytest.approx(gain, rel=1e-9)
        assert point.change == pytest.approx(change, rel=1e-9)


def test_no_other_moment_gains_more() -> None:
    data = rows(2, 0.5)
    best = change_points(data)[0]
    near = [replace(best, time=best.time + k / RATE) for k in range(-20, 21) if k]
    assert max(explicit_gain(data, point)[0] for point in near) <= best.gain * (1 + 1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("column", ["1", "f_c", "f_v", "load"])
@pytest.mark.parametrize("kind", ["once", "lasting", "every"])
def test_a_change_is_found_with_column_kind_and_moment(column: str, kind: str) -> None:
    right = 0
    for seed in range(5):
        plain = rows(seed, column=column, kind=kind)
        # A step of 14 standard deviations, were the base known.
        change = 14.0 / float(np.linalg.norm(plain.columns[column] * changed(plain, kind)))
        point = change_points(rows(seed, change, column, kind=kind))[0]
        assert point.p < 1e-4
        if (point.column, point.kind) == (column, kind):
            assert point.recording == (None if kind == "every" else 2)
            assert abs(point.change - change) < 4 * point.std
            right += point.interval[0] - 1 / RATE <= 30.0 <= point.interval[1] + 1 / RATE
    assert right >= 4


def test_a_recording_that_differs_from_its_beginning_is_a_change_at_its_first_moment() -> None:
    point = change_points(rows(3, 0.6, "1", recording=1, time=0.0))[0]
    assert (point.column, point.kind, point.recording, point.time) == ("1", "once", 1, 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("colour", [0.0, 0.2])
def test_chances_without_a_change_are_not_smaller_than_promised(colour: float) -> None:
    chances = [min((p.p for p in change_points(rows(s, colour=colour), alarm=0.2)), default=1.0) for s in range(200)]
    # 200 runs: 10 expected at 0.05; 20 has a chance of 2e-3.
    assert np.count_nonzero(np.array(chances) < 0.05) < 20
    assert np.count_nonzero(np.array(chances) < 1e-3) <= 2


def test_presence_and_a_difference_between_unloaded_and_loaded_are_no_change_in_time() -> None:
    plain = rows(12, unloaded=0)
    for part in (np.ones_like(plain.time), plain.unloaded, ~plain.unloaded):
        for name in ("1", "f_c", "load"):
            more = 3.0 * plain.columns[name] * part
            moved = plain.residual + more - plain.orthonormal @ (plain.orthonormal.T @ more)
            only = {name: plain.columns[name]}  # another column may well mistake it for a change
            assert change_points(replace(plain, residual=moved, columns=only)) == ()


def test_a_knock_is_no_change() -> None:
    plain = rows(13)
    knock = np.zeros_like(plain.residual)
    knock[900:903] = 14.0
    for sign in (-1.0, 1.0):
        assert change_points(replace(plain, residual=plain.residual + sign * knock)) == ()


def test_a_step_at_a_given_moment_is_that_of_a_joint_refit() -> None:
    data = rows(6, 0.9)
    best = next(c for c in change_points(data) if c.kind == "once")
    change, std = step_at(data, best.column, best.recording, best.time)  # type: ignore[arg-type]
    assert change == pytest.approx(best.change, rel=1e-9)
    assert std == pytest.approx(best.std, rel=1e-9)
    elsewhere, doubt = step_at(data, best.column, 1, best.time)
    assert abs(elsewhere) < 4.0 * doubt
    assert step_at(data, best.column, 1, 1e9) == (0.0, np.inf)


def test_more_looks_raise_the_bar() -> None:
    data = rows(4, 0.5)
    one, six = change_points(data)[0], change_points(data, looks=6)[0]
    assert six.p == pytest.approx(6 * one.p)
    assert change_points(data, alarm=one.p * 0.99) == ()


def test_supremum_of_a_stationary_process_against_simulation() -> None:
    # The normalised sums of white noise between 10 % and 90 %: length log(0.9^2 / 0.1^2).
    rng = np.random.default_rng(5)
    n, share = 4000, np.arange(1, 4001) / 4000
    inside = (share > 0.1) & (share < 0.9)
    largest = []
    for _ in range(800):
        sums = np.cumsum(rng.standard_normal(n)) / np.sqrt(n)
        bridge = (sums - share * sums[-1])[inside]
        largest.append(np.abs(bridge / np.sqrt(share * (1 - share))[inside]).max())
    length = 2 * np.log(0.9 / 0.1)
    for z in (2.8, 3.2):
        assert np.mean(np.array(largest) > z) == pytest.approx(supremum_chance(z, length), rel=0.35)


def test_too_few_rows_or_a_dead_column_say_nothing() -> None:
    data = rows(6)
    few = replace(
        data,
        residual=data.residual[:10],
        orthonormal=data.orthonormal[:10],
        time=data.time[:10],
        recording=data.recording[:10],
        unloaded=data.unloaded[:10],
        columns={name: column[:10] for name, column in data.columns.items()},
    )
    assert change_points(few) == ()
    assert change_points(replace(data, columns={"none": np.zeros(len(data.time))})) == ()


def test_rows_of_a_fit_are_in_order_and_show_a_step_in_the_effort() -> None:
    session = clean_session(2)
    prepared = session.plain
    data = joint_rows(session.base_model, 1)
    assert set(data.columns) == {"1", "f_c", "f_v", "K", "load"}
    assert all(len(c) == len(data.residual) == len(data.time) for c in data.columns.values())
    unloaded = np.isin(data.recording, [s.recording for s in prepared.design.segments if not s.loaded])
    assert np.all(data.columns["load"][unloaded] == 0)
    assert np.all(np.diff(data.time)[np.diff(data.recording) == 0] > 0)
    # A constant force from 14 s on in the training recording, seen through the base model's own projection.
    train = int(prepared.design.segments[prepared.design.indices("train")[0]].recording)
    step = data.columns["1"] * ((data.recording == train) & (data.time >= 14.0))
    force = 40.0 / np.linalg.norm(step)
    moved = data.residual + force * (step - data.orthonormal @ (data.orthonormal.T @ step))
    # The load hardly changes its sign here, so its column may well stand first.
    point = next(p for p in change_points(replace(data, residual=moved)) if p.column == "1")
    assert (point.kind, point.recording) == ("once", train)
    assert point.time == pytest.approx(14.0, abs=1.0)


def stepped(recordings: tuple[int, ...], size: float) -> Session:
    """An arm whose joint 1 gets another force zero at 20 s of some recordings (numbers in the order of ``USUAL``)."""
    machine, added = planar_machine(2), []
    for number, (role, seed) in enumerate(USUAL):
        motion = make_motion(machine, role, seed, 40.0, None)
        force = np.zeros((len(motion.t), 2))
        if number in recordings:
            force[motion.t >= 20.0, 0] = size
        added.append(force)
    return make_session(machine, truth(2), added=added, options=Options(bootstrap=0))


@pytest.mark.slow
@pytest.mark.parametrize(("recordings", "said"), [((1,), True), ((1, 2), False)])
def test_what_every_run_of_a_motion_has_at_one_phase_is_no_change_in_time(
    recordings: tuple[int, ...], said: bool
) -> None:
    session = stepped(recordings, 60.0)
    signals = SessionSignals(session, Corrections(session.machine))
    explained = session.weighted_base.weights == "whitened"
    found = [c for c in changes(session.base_model, signals.prepared(()).pairs, explained) if c.joint == 0]
    assert bool(found) is said
    if said:
        assert abs(found[0].time - 20.0) < 1.0
        assert found[0].recording == 1
