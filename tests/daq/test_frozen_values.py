"""Frozen values, live: found soon where a sensor hangs, and never where a machine rests."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pytest
from bench_machines import can, plain
from hypothesis import given, settings
from hypothesis import strategies as st

from daq import Machine, Quality, parse_machine
from daq.acquisition.assembly import Assembler
from daq.acquisition.frozen import FrozenDetector
from daq.acquisition.recorder import backdated
from daq.drivers.base import Samples
from daq.frames.channels import channel_table
from daq.frames.clock import Tick

PLAIN = parse_machine(plain())  # angle, piston, head, rod, oil; all of one device as far as the file says
CAN = parse_machine(can("x"))  # angle of node 5; head and rod of node 6
Array = npt.NDArray[np.float64]


def found(machine: Machine, values: Array) -> npt.NDArray[np.bool_]:
    """(N, n) frames that were called frozen, of (N, n) values that are all fresh."""
    detector = FrozenDetector(machine)
    fresh = np.zeros(values.shape[1], dtype=np.uint8)
    return np.array([detector.frozen(row, fresh) for row in values])


def pressures(count: int, seed: int, motion: float = 1.0) -> Array:
    """An angle without noise, and two pressures with it (counts of 1 kPa), (count, 3)."""
    rng = np.random.default_rng(seed)
    t = np.arange(count) / 50
    q = motion * 0.5 * np.sin(0.7 * t)
    p = np.column_stack([6e6 + 1e6 * q, 3e6 - 1e6 * q]) + rng.normal(0, 3e3, (count, 2))
    return np.column_stack([np.round(q / 1e-4) * 1e-4, np.round(p / 1e3) * 1e3])


def test_a_sensor_that_hangs_is_found_by_its_own_noise() -> None:
    values = pressures(1000, 1)
    values[600:800, 1] = values[600, 1]
    marks = found(CAN, values)
    assert not marks[:, [0, 2]].any()
    assert not marks[:610, 1].any() and not marks[800:, 1].any()  # and it is over with the first change
    assert marks[630:800, 1].all()  # within 0.6 s


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=10, deadline=None)
def test_sound_sensors_are_never_called_frozen(seed: int) -> None:
    assert not found(CAN, pressures(2000, seed)).any()


@pytest.mark.slow
@given(seed=st.integers(0, 2**32 - 1), coarse=st.sampled_from([3e3, 6e3, 12e3]))
@settings(max_examples=10, deadline=None)
def test_coarse_sensors_are_never_called_frozen(seed: int, coarse: float) -> None:
    """Steps as large as the noise and four times as large: many values repeat themselves."""
    values = pressures(2000, seed)
    values[:, 1:] = np.round(values[:, 1:] / coarse) * coarse
    assert not found(CAN, values).any()


def test_an_encoder_at_rest_is_not_frozen() -> None:
    values = pressures(3000, 2)
    values[1000:2500, 0] = values[1000, 0]  # it has no noise, and the arm rests for half a minute
    assert not found(CAN, values).any()


def test_a_machine_that_is_switched_off_is_not_frozen() -> None:
    text = can("x").replace("node: 6, object: 0x6130, subindex: 2", "node: 7, object: 0x6130, subindex: 2")
    machine = parse_machine(text)
    values = pressures(2000, 3)
    values[1000:1500, 1:] = 0.0  # no pump, no ripple, and less noise than a count, in both transducers
    assert not found(machine, values).any()
    values = pressures(2000, 3)
    values[1000:1500, 1] = 0.0  # only in one of them
    assert found(machine, values)[1040:1500, 1].all()


def positions(count: int, seed: int, noise: float = 0.0) -> Array:
    """Joint angle and piston of a rack of 0.1 m, pressures and oil, (count, 5)."""
    rng = np.random.default_rng(seed)
    t = np.maximum(0.0, np.arange(count) / 50 - 5.0)  # it begins at rest
    q = 0.5 * np.sin(0.7 * t) + 0.2 * np.sin(1.9 * t)
    angle = np.round((q + rng.normal(0, noise, count)) / 1e-4) * 1e-4
    piston = np.round(0.1 * (q + 1.2) / 1e-5) * 1e-5
    other = np.column_stack([np.full(count, 6e6), np.full(count, 3e6), np.full(count, 320.0)])
    other[:, :2] += rng.normal(0, 3e3, (count, 2))
    return np.column_stack([angle, piston, other])


GEARED = parse_machine(
    """
schema: hilfit/machine/1
name: geared
rate_hz: 50
gravity: [0.0, 0.0, -9.81]
joints:
  - name: j1
    type: revolute
    dh: {a: 0.5, alpha: 0.0, d: 0.0, theta: 0.0}
    limits: {position: [-1.0, 1.0], velocity: 1.0, acceleration: 5.0}
    drive: {ratio: 0.1}
channels:
  - {name: j1.angle, quantity: joint_position, joint: j1, unit: rad, resolution: 1.0e-4}
  - {name: j1.motor, quantity: motor_position, joint: j1, unit: rad, resolution: 1.0e-5}
  - {name: j1.effort, quantity: joint_effort, joint: j1, unit: N m}
"""
)


def test_a_joint_that_stands_while_its_piston_moves_may_have_its_rod_off_the_pin() -> None:
    values = positions(2000, 4)
    values[1500:1700, 0] = values[1500, 0]
    assert not found(PLAIN, values).any()


@pytest.mark.slow
@pytest.mark.parametrize("channel", [0, 1])
def test_a_position_that_hangs_is_found_by_the_other_one(channel: int) -> None:
    values = positions(2000, 4)[:, :3]
    assert not found(GEARED, values).any()
    values[1500:1700, channel] = values[1500, channel]
    marks = found(GEARED, values)
    assert not marks[:1500].any() and not marks[1701:].any()
    assert not np.delete(marks, channel, axis=1).any()
    first = int(np.flatnonzero(marks[:, channel])[0])
    way = np.ptp(values[1500 : first + 1, 1 - channel])
    play = 0.03 * (2.0 if channel else 0.2)  # of what the other one can do: 2 rad, or 0.2 rad of the motor
    assert play < way < 2 * play
    assert marks[first:1700, channel].all()


def test_play_between_two_positions_is_not_frozen() -> None:
    values = positions(3000, 5)[:, :3]
    q = values[:, 0].copy()
    held = q[0]
    for k in range(len(q)):  # the joint follows only beyond a play of 0.02 rad, 2 mm at the piston
        held = min(max(held, q[k] - 0.01), q[k] + 0.01)
        values[k, 0] = held
    assert not found(GEARED, values).any()


def test_a_frozen_value_is_shown_and_is_no_measurement() -> None:
    table = channel_table(CAN)
    work = Assembler(table, [table.names], 50, frozen=FrozenDetector(CAN))
    values = pressures(800, 6)
    values[600:700, 1] = values[600, 1]
    raw = (values - table.bias) / table.gain
    flags = []
    for cycle, row in enumerate(raw):
        samples = Samples(row.copy(), np.zeros(3, dtype=np.uint8), np.zeros(3, dtype=np.int64), np.zeros(3))
        frame = work.frame(Tick(cycle, cycle / 50, 0, 0, 0), 0, 0, [samples])
        flags.append(int(frame.quality[1]))
        assert np.isfinite(frame.values).all()
    assert flags[690] == Quality.FROZEN and flags[700] == Quality.FRESH
    assert work.counts[Quality.FROZEN].tolist()[0::2] == [0, 0]


def test_a_sensor_that_hangs_again_is_found_as_soon_as_the_first_time() -> None:
    values = pressures(2000, 1)
    starts = (600, 1000, 1400)
    for start in starts:
        values[start : start + 200, 1] = values[start, 1]
    marks = found(CAN, values)[:, 1]
    assert all(marks[start : start + 200].any() for start in starts)
    soon = [int(np.argmax(marks[start : start + 200])) for start in starts]
    # What is normal may have grown by a repetition or two meanwhile, of which the limit is three times as many.
    assert max(soon) <= soon[0] + 6


@pytest.mark.parametrize(
    ("values", "marks", "expected"),
    [
        # changes, hangs at 5 from the third value on, found at the sixth
        ([1, 2, 5, 5, 5, 5, 5, 3], "00000880", "00088880"),
        # a value that repeats itself once before it changes is none
        ([5, 5, 2, 5, 5, 5, 3, 3], "00000800", "00008800"),
        # what was late in between ends it: nobody knows what happened before
        ([1, 5, 5, 5, 5, 5, 5, 5], "00003080", "00003880"),
        ([5, 5, 5, 5, 5, 5, 5, 5], "00000888", "08888888"),
        ([1, 2, 3, 4, 5, 6, 7, 8], "00000000", "00000000"),
    ],
)
def test_a_finished_recording_is_marked_from_where_the_value_stood_still(
    values: list[float], marks: str, expected: str
) -> None:
    table = pa.table({"a": pa.array(values, pa.float64()), "a.quality": pa.array([int(m) for m in marks], pa.uint8())})
    made, added = backdated(table, ["a"])
    assert "".join(str(mark) for mark in made.column("a.quality").to_pylist()) == expected
    assert added.get("a", 0) == sum(a != b for a, b in zip(marks, expected, strict=True))
    assert made.schema == table.schema and made.column("a").equals(table.column("a"))
