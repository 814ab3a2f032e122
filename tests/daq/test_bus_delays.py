"""Delays between buses against shifts that were made: exact functions of time, sampled later."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from bench_machines import can

from daq import Machine, parse_machine
from daq.acquisition.cycles import AcquisitionStatistics
from daq.commissioning.delays import BusDelay, bus_delays
from daq.frames.frame import row_dtype
from daq.quality import Quality
from server.bus_checks.bus_check_resource import check_running

RATE = 50.0
Array = np.ndarray
Motion = Callable[[Array], Array]


def two_buses(late_position: bool) -> Machine:
    """The bench machine: angle on bus can0; pressures, or a piston position as well, on bus mb."""
    text = can("x")
    for subindex, register in ((1, 2), (2, 4)):
        source = f"{{bus: can0, node: 6, object: 0x6130, subindex: {subindex}, data_type: float32}}"
        assert source in text
        text = text.replace(source, f"{{bus: mb, unit: 1, register: {register}, data_type: float32}}")
    if late_position:
        piston = "- {name: j1.piston, quantity: piston_position, joint: j1, unit: m,\n"
        piston += "    source: {bus: mb, unit: 1, register: 8, data_type: float32}}\n"
        text = text.replace("buses:\n", piston + "buses:\n", 1)
    return parse_machine(text + "- {name: mb, type: modbus_tcp, host: 127.0.0.1}\n")


def angle(t: Array) -> Array:
    return 0.4 * np.sin(1.1 * t) + 0.3 * np.sin(2.3 * t + 1.0) + 0.1 * np.sin(4.1 * t)


def speed(t: Array) -> Array:
    return (angle(t + 1e-5) - angle(t - 1e-5)) / 2e-5


def force(t: Array) -> Array:
    """Gravity, friction and inertia of some arm, N."""
    acceleration = (speed(t + 1e-4) - speed(t - 1e-4)) / 2e-4
    return 6000 * np.cos(angle(t)) + 800 * np.tanh(speed(t) / 0.02) + 900 * speed(t) + 300 * acceleration


def signals(machine: Machine, delay: float, seed: int = 0) -> dict[str, Array]:
    """Values of every channel, the second bus's sampled ``delay`` late."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 60.0, 1 / RATE)
    cylinder = machine.joints[0].cylinder
    assert cylinder is not None
    rod = 2e6 + 0.0 * t
    head = (force(t - delay) + cylinder.rod_area * rod) / cylinder.head_area
    found = {"j1.angle": angle(t) + rng.normal(0, 1e-5, len(t)), "j1.head": head + rng.normal(0, 2e3, len(t))}
    found["j1.rod"] = rod + rng.normal(0, 2e3, len(t))
    if machine.channel("piston_position", "j1") is not None:
        found["j1.piston"] = cylinder.linkage.piston_position(angle(t - delay)) + rng.normal(0, 1e-5, len(t))
    return found


def one(machine: Machine, values: dict[str, Array]) -> BusDelay:
    (found,) = bus_delays(machine, values, RATE)
    return found


@pytest.mark.slow
@pytest.mark.parametrize("delay", [0.0, 0.013, -0.02, 0.15])
def test_positions_of_one_joint_tell_the_delay_to_a_tenth_of_a_millisecond(delay: float) -> None:
    machine = two_buses(late_position=True)
    found = one(machine, signals(machine, delay))
    assert (found.bus, found.reference) == ("mb", "can0")
    assert [pair.kind for pair in found.pairs] == ["position"], "efforts are left out where positions tell it"
    assert found.seconds == pytest.approx(delay, abs=1e-4)
    assert found.std < 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("delay", [0.0, 0.03])
def test_efforts_tell_the_delay_within_its_deviation(delay: float) -> None:
    machine = two_buses(late_position=False)
    errors = [one(machine, signals(machine, delay, seed)) for seed in range(3)]
    for found in errors:
        assert found.pairs[0].kind == "effort" and found.pairs[0].late == ("j1.head", "j1.rod")
        assert abs(found.seconds - delay) < 4 * found.std + 1e-3
        assert found.std < 5e-3


def test_at_rest_nothing_is_told() -> None:
    machine = two_buses(late_position=True)
    rng = np.random.default_rng(0)
    values = {name: rng.normal(0, 1e-5, 3000) for name in signals(machine, 0.0)}
    assert bus_delays(machine, values, RATE) == []


def test_a_signal_that_does_not_follow_tells_nothing() -> None:
    machine = two_buses(late_position=True)
    values = signals(machine, 0.0)
    values["j1.piston"] = values["j1.head"] = np.random.default_rng(1).normal(0, 1.0, len(values["j1.angle"]))
    assert bus_delays(machine, values, RATE) == []


def test_gaps_are_left_out_and_short_rests_of_motion_are_too_little() -> None:
    machine = two_buses(late_position=True)
    values = signals(machine, 0.02)
    values["j1.angle"][500:600] = np.nan
    assert one(machine, values).seconds == pytest.approx(0.02, abs=2e-4)
    for name in values:
        values[name] = values[name][:500]
    assert bus_delays(machine, values, RATE) == []


def frames(machine: Machine, values: dict[str, Array]) -> np.ndarray:
    """Rows of the ring buffer with these values, all fresh."""
    count = len(next(iter(values.values())))
    rows = np.zeros(count, row_dtype(len(machine.channels)))
    rows["cycle"] = 1000 + np.arange(count)
    rows["time"] = rows["cycle"] / RATE
    for index, channel in enumerate(machine.channels):
        rows["values"][:, index] = values[channel.name]
    return rows


def test_the_check_of_a_running_machine_tells_delays_by_a_motion_before_it_stood_still() -> None:
    machine = two_buses(late_position=True)
    values = signals(machine, 0.013)
    still = round(20 * RATE)
    rng = np.random.default_rng(4)
    for value in values.values():
        value[-still:] = value[-still] + rng.normal(0, 1e-5, still)
    found = check_running(machine, frames(machine, values), AcquisitionStatistics(), seconds=20.0)
    (delay,) = found.delays
    assert (delay.bus, delay.reference) == ("mb", "can0")
    assert delay.seconds == pytest.approx(0.013, abs=3e-4)
    assert found.seconds == 20.0
    assert not any(channel.rest.moved for channel in found.channels), "the motion was before these seconds"


def test_cycles_that_were_skipped_and_values_that_did_not_come_are_gaps() -> None:
    machine = two_buses(late_position=True)
    rows = frames(machine, signals(machine, 0.02))
    rows["quality"][400:420] = Quality.MISSING
    rows["values"][400:420] = 99.0
    kept = np.delete(rows, slice(700, 760))  # as if they came one after another they would be a jump in time
    (delay,) = check_running(machine, kept, AcquisitionStatistics(), seconds=20.0).delays
    assert delay.seconds == pytest.approx(0.02, abs=3e-4)
