"""Frames: scaling, range, quality and holding. Clocks: absolute deadlines, skipped and slipped ticks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bench_machines import can, modbus, plain
from fake_clock import FakeClock
from hypothesis import given, settings
from hypothesis import strategies as st

from daq import Machine, MachineFileError, Quality, parse_machine
from daq.acquisition.assembly import HOLD_CYCLES, Assembler
from daq.acquisition.frozen import FrozenDetector
from daq.drivers.base import Samples, nothing
from daq.frames.channels import channel_table, channels_by_bus
from daq.frames.clock import NS, Clock, LockstepClock, RealClock, Tick, clock_for
from daq.frames.frame import Frame, frame_from_row, row_dtype, row_from_frame

MODBUS = parse_machine(modbus(502))


def samples(*raw: float, quality: int = Quality.FRESH, ago: int = 0, after: float = 0.0) -> Samples:
    count = len(raw)
    return Samples(
        np.array(raw, dtype=float),
        np.full(count, quality, dtype=np.uint8),
        np.full(count, ago, dtype=np.int64),
        np.full(count, after),
    )


def tick(cycle: int) -> Tick:
    return Tick(cycle, cycle / 50, 0, 0, 0)


def assembler(machine: Machine = MODBUS, *, lockstep: bool = False) -> Assembler:
    table = channel_table(machine)
    return Assembler(table, [table.names], machine.rate_hz, lockstep=lockstep)


def test_the_channel_table_scales_to_si() -> None:
    table = channel_table(MODBUS)
    assert table.names == ("j1.angle", "j1.head", "j1.rod")
    np.testing.assert_allclose(table.gain, [1.0, 1e5, 0.1e5])  # the rod's source says 0.1 bar per count, less 1 bar
    np.testing.assert_allclose(table.bias, [0.0, 0.0, -1e5])
    assert table.index("j1.rod") == 2
    oil = channel_table(parse_machine(plain()))
    np.testing.assert_allclose(oil.bias[-1], 273.15)
    assert (oil.low[2], oil.high[2]) == (-1e5, 250e5)
    assert oil.high[3] == np.inf


def test_channels_are_grouped_by_bus() -> None:
    machine = parse_machine(can("x"))
    assert [c.name for c in channels_by_bus(machine)["can0"]] == ["j1.angle", "j1.head", "j1.rod"]
    with pytest.raises(MachineFileError, match=r"arm\.yaml: buses: there are none"):
        channels_by_bus(parse_machine(plain()), "arm.yaml")
    sourceless = parse_machine(can("x").replace("buses:", "- {name: oil, quantity: oil_temperature, unit: K}\nbuses:"))
    with pytest.raises(MachineFileError, match="oil has no source"):
        channels_by_bus(sourceless)


def test_fresh_values_become_si() -> None:
    frame = assembler().frame(tick(3), 11, 12, [samples(0.5, 2.0, 30.0)])
    assert (frame.cycle, frame.monotonic_ns, frame.utc_ns, frame.time) == (3, 11, 12, 0.06)
    np.testing.assert_allclose(frame.values, [0.5, 2e5, 2e5])
    assert frame.quality.tolist() == [Quality.FRESH] * 3
    assert frame.ages.tolist() == [0, 0, 0]


def test_ages_are_negative_for_what_is_sampled_after_sync() -> None:
    polled = samples(0.5, 2.0, 30.0, after=0.003)
    assert assembler().frame(tick(0), 0, 0, [polled]).ages.tolist() == [-0.003] * 3
    # In lockstep no machine time passes between SYNCs.
    assert assembler(lockstep=True).frame(tick(0), 0, 0, [polled]).ages.tolist() == [0.0] * 3


def test_late_values_are_marked_and_have_an_age() -> None:
    frame = assembler().frame(tick(8), 0, 0, [samples(0.5, 2.0, 30.0, ago=1)])
    assert frame.quality.tolist() == [Quality.LATE] * 3
    np.testing.assert_allclose(frame.ages, 0.02)


def test_sentinels_and_ranges() -> None:
    frame = assembler().frame(tick(0), 0, 0, [samples(0.5, -999.0, 30.0)])
    assert frame.quality[1] == Quality.INVALID
    assert np.isnan(frame.values[1])
    # Whatever the driver says of it.
    frame = assembler().frame(tick(0), 0, 0, [samples(0.5, np.nan, np.inf)])
    assert frame.quality.tolist() == [Quality.FRESH, Quality.INVALID, Quality.INVALID]
    machine = parse_machine(modbus(502).replace("quantity: rod_pressure,", "quantity: rod_pressure, range: [0, 5],"))
    for raw, quality in ((59.0, Quality.FRESH), (60.0, Quality.OUT_OF_RANGE), (9.0, Quality.OUT_OF_RANGE)):
        frame = assembler(machine).frame(tick(0), 0, 0, [samples(0.5, 1.0, raw)])
        assert frame.quality[2] == quality  # 0.1 bar per count, less 1 bar: 59 counts are 4.9 bar
        assert np.isfinite(frame.values[2])


def test_what_does_not_come_is_held_for_a_while_then_missing() -> None:
    work = assembler()
    work.frame(tick(0), 0, 0, [samples(0.5, 2.0, 30.0)])
    for cycle in range(1, HOLD_CYCLES + 1):
        frame = work.frame(tick(cycle), 0, 0, [nothing(3)])
        assert frame.quality.tolist() == [Quality.STALE] * 3
        np.testing.assert_allclose(frame.values, [0.5, 2e5, 2e5])
        np.testing.assert_allclose(frame.ages, cycle * 0.02)
    frame = work.frame(tick(HOLD_CYCLES + 1), 0, 0, [nothing(3)])
    assert frame.quality.tolist() == [Quality.MISSING] * 3
    assert np.isnan(frame.values).all() and np.isnan(frame.ages).all()


def test_a_device_with_a_rate_of_its_own_owes_nothing_in_between() -> None:
    """An oil temperature once a second at 50 Hz: held for one and a half seconds, stale for two, then missing."""
    work = assembler()
    slow = np.array([50.0, 1.0, 50.0])
    every_cycle = samples(0.5, 2.0, 30.0)
    work.frame(tick(0), 0, 0, [replace(every_cycle, interval=slow)])
    for cycle, expected in ((1, Quality.HELD), (75, Quality.HELD), (76, Quality.STALE), (100, Quality.STALE)):
        frame = work.frame(tick(cycle), 0, 0, [replace(nothing(3), interval=slow)])
        assert frame.quality[2] == expected
        assert frame.values[2] == pytest.approx(2e5) and frame.ages[2] == pytest.approx(cycle * 0.02)
    frame = work.frame(tick(101), 0, 0, [replace(nothing(3), interval=slow)])
    assert frame.quality.tolist() == [Quality.MISSING] * 3


def test_nothing_is_held_before_the_first_value() -> None:
    frame = assembler().frame(tick(0), 0, 0, [nothing(3)])
    assert frame.quality.tolist() == [Quality.MISSING] * 3


def test_bus_errors_and_emergencies_stay_what_they_are() -> None:
    work = assembler()
    work.frame(tick(0), 0, 0, [samples(0.5, 2.0, 30.0)])
    frame = work.frame(tick(1), 0, 0, [nothing(3, Quality.BUS_ERROR)])
    assert frame.quality.tolist() == [Quality.BUS_ERROR] * 3
    frame = work.frame(tick(2), 0, 0, [samples(0.5, 2.0, 30.0, quality=Quality.EMERGENCY)])
    assert frame.quality.tolist() == [Quality.EMERGENCY] * 3
    np.testing.assert_allclose(frame.values, [0.5, 2e5, 2e5])
    assert work.counts[Quality.BUS_ERROR].tolist() == [1, 1, 1]
    assert work.counts.sum() == 9


def test_samples_of_several_drivers_find_their_channels() -> None:
    table = channel_table(MODBUS)
    work = Assembler(table, [("j1.rod",), ("j1.head", "j1.angle")], 50)
    frame = work.frame(tick(0), 0, 0, [samples(30.0), samples(2.0, 0.5)])
    np.testing.assert_allclose(frame.values, [0.5, 2e5, 2e5])


@given(
    cycle=st.integers(0, 2**62),
    values=st.lists(st.floats(allow_nan=True), min_size=1, max_size=5),
    quality=st.sampled_from(Quality),
)
def test_a_frame_survives_its_row(cycle: int, values: list[float], quality: int) -> None:
    count = len(values)
    frame = Frame(cycle, 1, 2, 0.5, np.array(values), np.array(values[::-1]), np.full(count, quality, dtype=np.uint8))
    row = row_from_frame(frame)
    assert row.dtype == row_dtype(count)
    back = frame_from_row(row[0])
    assert (back.cycle, back.monotonic_ns, back.utc_ns, back.time) == (cycle, 1, 2, 0.5)
    np.testing.assert_array_equal(back.values, frame.values)
    np.testing.assert_array_equal(back.ages, frame.ages)
    np.testing.assert_array_equal(back.quality, frame.quality)


class Wall:
    """Replaces the time module of the clocks: sleeping moves the clock, nobody waits."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 5 * NS
        self.sleeps = 0
        monkeypatch.setattr("daq.frames.clock.time", self)

    def monotonic_ns(self) -> int:
        return self.now

    def time_ns(self) -> int:
        return self.now + 1000 * NS

    def sleep(self, seconds: float) -> None:
        self.now += max(1, round(seconds * NS))
        self.sleeps += 1


@pytest.fixture
def wall(monkeypatch: pytest.MonkeyPatch) -> Wall:
    return Wall(monkeypatch)


def ticks(clock: Clock, count: int) -> list[Tick]:
    return [clock.wait() for _ in range(count)]


def test_real_deadlines_are_absolute(wall: Wall) -> None:
    clock = RealClock(50)
    clock.start()
    start = wall.now
    for cycle in range(100):
        found = clock.wait()
        assert (found.cycle, found.skipped) == (cycle, 0)
        assert found.time == cycle / 50
        assert wall.now == start + (cycle + 1) * NS // 50 + found.late_ns
        assert wall.now < found.collect_until_ns < start + (cycle + 2) * NS // 50
        wall.now += NS // 100  # work of half a period does not add up


def test_a_stall_skips_ticks_and_their_numbers(wall: Wall) -> None:
    clock = RealClock(50)
    clock.start()
    ticks(clock, 3)  # cycles 0, 1, 2; 3 is due 20 ms after 2
    wall.now += NS // 10  # 100 ms: the times of 3 to 6 are over, that of 7 has just come
    late = clock.wait()
    assert (late.cycle, late.skipped) == (7, 4)
    assert late.time == 7 / 50
    assert [t.cycle for t in ticks(clock, 3)] == [8, 9, 10]


@given(stalls=st.lists(st.floats(0, 0.3), max_size=30))
def test_no_tick_comes_twice_or_early(stalls: list[float]) -> None:
    with pytest.MonkeyPatch.context() as monkeypatch:
        wall = Wall(monkeypatch)
        clock = RealClock(50)
        clock.start()
        origin = wall.now + NS // 50
        last = -1
        for stall in stalls:
            found = clock.wait()
            assert found.cycle == last + 1 + found.skipped
            assert wall.now >= origin + found.cycle * (NS // 50)
            assert found.late_ns < NS // 50
            last = found.cycle
            wall.now += round(stall * NS)


def test_lockstep_slips_and_skips_nothing(wall: Wall) -> None:
    clock = LockstepClock(50, speed=4)
    clock.start()
    start = wall.now
    first = ticks(clock, 10)
    assert [t.cycle for t in first] == list(range(10))
    assert [t.time for t in first] == [k / 50 for k in range(10)]
    assert wall.now == start + 10 * NS // 200
    wall.now += NS  # the simulation is slow
    slipped = clock.wait()
    assert (slipped.cycle, slipped.skipped) == (10, 0)
    assert slipped.late_ns == NS - NS // 200
    before = wall.now
    following = clock.wait()
    assert following.cycle == 11
    assert wall.now == before + NS // 200  # no burst to catch up
    assert following.collect_until_ns - wall.now >= NS // 2


def test_the_machine_file_chooses_the_clock() -> None:
    assert isinstance(clock_for(MODBUS), RealClock)
    simulated = modbus(502) + "simulation: {speed: 4, lockstep: true}\n"
    assert isinstance(clock_for(parse_machine(simulated)), LockstepClock)
    free = clock_for(parse_machine(simulated.replace("true", "false")))
    assert isinstance(free, RealClock)


def test_the_fake_clock_jumps() -> None:
    clock = FakeClock(50)
    clock.start()
    assert clock.wait().cycle == 0
    clock.skip(2)
    found = clock.wait()
    assert (found.cycle, found.skipped) == (3, 2)
    before = clock.monotonic_ns()
    clock.advance(1.5)
    assert clock.monotonic_ns() - before == 1.5 * NS == clock.utc_ns() - before


@pytest.mark.slow
@given(st.data())
@settings(max_examples=15, deadline=None)
def test_frames_of_plain_samples_are_those_of_samples_that_are_looked_at_one_by_one(data: st.DataObject) -> None:
    """What a driver calls plain takes a shorter way; frames, holding and counts must not tell."""
    text = modbus(502).replace("joint: j1, unit: bar", "joint: j1, unit: bar, range: [0, 100]", 1)
    machine = parse_machine(text)
    table = channel_table(machine)
    short, long = (Assembler(table, [table.names], machine.rate_hz, frozen=FrozenDetector(machine)) for _ in range(2))
    value = st.sampled_from([0.1, 0.2, 0.3, 50.0, 99.0, 150.0])
    for cycle in range(data.draw(st.integers(1, 80))):
        if data.draw(st.integers(0, 5)):
            given_ = samples(*data.draw(st.tuples(value, value, value)))
            frames = [short.frame(tick(cycle), 1, 2, [replace(given_, plain=True)])]
        else:
            given_ = nothing(3)
            frames = [short.frame(tick(cycle), 1, 2, [given_])]
        frames.append(long.frame(tick(cycle), 1, 2, [given_]))
        one, other = (row_from_frame(frame) for frame in frames)
        assert one.tobytes() == other.tobytes()
    np.testing.assert_array_equal(short.counts, long.counts)


# When a value was sampled


@pytest.mark.parametrize("late_ms", [0.0, 0.4, 1.9, 2.1, 5.0, 16.4])
def test_the_lateness_of_a_tick_goes_into_age_and_quality(late_ms: float) -> None:
    """A row's time is the tick's; what a SYNC that was sent later sampled is so much younger."""
    made = assembler()
    at = 7 * NS
    late = round(late_ms * 1e6)
    for whole in (True, False):
        part = replace(samples(1.0, 2.0, 3.0), plain=whole)
        frame = made.frame(Tick(7, 0.14, late, 0, at, at), at + late, 0, [part], at + late)
        assert frame.ages == pytest.approx([-late_ms / 1e3] * 3, abs=1e-9)
        assert frame.quality.tolist() == [Quality.FRESH if late_ms < 2.0 else Quality.LATE] * 3


def test_a_sync_of_which_nobody_knows_when_it_was_sent_samples_nothing_fresh() -> None:
    frame = assembler().frame(Tick(7, 0.14, 0, 0, 0, 0), 0, 0, [samples(1.0, 2.0, 3.0)], 1_500_000)
    assert frame.quality.tolist() == [Quality.LATE] * 3


def test_in_lockstep_no_tick_is_late() -> None:
    frame = assembler(lockstep=True).frame(Tick(7, 0.14, NS, 0, 0, 0), NS, 0, [samples(1.0, 2.0, 3.0)], 2 * NS)
    assert frame.quality.tolist() == [Quality.FRESH] * 3 and frame.ages.tolist() == [0.0] * 3


def test_what_another_masters_sync_sampled_has_the_age_of_that_sync() -> None:
    """Its tick is the SYNC itself: however late we look, nothing of it is older."""
    part = replace(samples(1.0, 2.0, 3.0, after=-0.001), from_tick=True)
    frame = assembler().frame(Tick(7, 0.14, 9_000_000, 0, 0, 0), 9_000_000, 0, [part], 9_000_000)
    assert frame.quality.tolist() == [Quality.FRESH] * 3 and frame.ages == pytest.approx([0.001] * 3)


def test_the_cycle_goes_over_to_another_masters_sync_and_counts_on(wall: Wall) -> None:
    """A PLC that comes to a bus that we lead: its SYNC leads from then on, 7 ms behind ours."""
    period = NS // 50
    syncs: list[int] = []

    def next_sync(deadline: int) -> int | None:
        wall.now = max(wall.now, syncs.pop(0) if syncs else deadline)
        return wall.now

    there: list[bool] = []
    clock = RealClock(50, following=lambda: next_sync if there else None)
    clock.start()
    before = ticks(clock, 5)
    syncs += [wall.now + 7_000_000 + k * period for k in range(20)]
    came = syncs[:]
    there.append(True)
    after = ticks(clock, 10)
    assert [tick.cycle for tick in before + after] == list(range(15))
    assert [tick.at_ns for tick in after] == came[1:11]  # the first one says where its periods begin
