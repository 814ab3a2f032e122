"""When frames came, by simulated clocks: stamps of a clock that is set, slewed and off, a thread that is starved."""

from __future__ import annotations

import random
from collections.abc import Iterator

import can
import pytest

from daq.drivers.base import DriverContext
from daq.drivers.can.health import BusHealth
from daq.drivers.can.port import UNCERTAIN_S, ArrivalTimes, CanPort
from daq.frames.clock import NS
from daq.machine.machine_file import CanBus, CanopenBus

PERIOD = 0.02
MOST = 1e-3  # s that an age may be wrong by
SET_AT = 20.0


def frames(random_: random.Random, seconds: float) -> Iterator[float]:
    """A burst of five behind each SYNC, as nodes answer."""
    for cycle in range(round(seconds / PERIOD)):
        yield from sorted(cycle * PERIOD + 0.0003 * n + random_.uniform(0, 0.0002) for n in range(5))


def errors(
    seed: int,
    *,
    step: float = 0.0,
    slew_ppm: float = 0.0,
    off_ppm: float = 0.0,
    proofs: bool = True,
    seconds: float = 40.0,
    least: float = 0.0,
) -> list[tuple[float, float]]:
    """(when a frame was on the bus, by how much the estimate is off), both in s.

    The thread looks whether a frame waits as :mod:`daq.drivers.can.port` does, is woken after an exponential time, and
    every 200th frame kept from running for up to 0.12 s; in every second second, by chance, by ``least`` more.
    """
    random_ = random.Random(seed)
    more = [random_.choice((0.0, least)) if least else 0.0 for _ in range(round(seconds) + 1)]
    times, now, looked, found = ArrivalTimes(), 0.0, -1.0, []
    times.watched = proofs
    for at in frames(random_, seconds):
        if at > now:
            if proofs and now - looked > 0.002:
                times.nothing_at(round(now * NS))
                looked = now
            now = (
                at
                + more[int(at)]
                + random_.expovariate(1 / 80e-6)
                + (random_.uniform(0, 0.12) if random_.random() < 0.005 else 0.0)
            )
        else:
            now += 40e-6
        stamp = 1.7e9 + at * (1 + off_ppm * 1e-6)
        if at > SET_AT:
            stamp += step + (at - SET_AT) * slew_ppm * 1e-6
        found.append((at, times.of(stamp, round(now * NS)) / NS - at))
    return found


@pytest.mark.slow
@pytest.mark.parametrize(
    "clock",
    [
        *({"step": sign * size} for size in (0.05, 0.3, 1.0, 60.0) for sign in (1, -1)),
        {"slew_ppm": 500.0}, {"slew_ppm": -500.0}, {"off_ppm": 1000.0}, {"off_ppm": -1000.0}, {},
    ],
    ids=str,
)  # fmt: skip
def test_ages_are_right_whatever_is_done_to_the_clock_of_the_stamps(clock: dict[str, float]) -> None:
    for seed in range(4):
        wrong = [(at, error) for at, error in errors(seed, **clock) if abs(error) > MOST]
        assert len({round(at / PERIOD) for at, _ in wrong}) <= 1, wrong[:5]  # cycles that are marked


@pytest.mark.slow
def test_a_second_in_which_every_frame_waited_is_no_rate() -> None:
    """What two windows seem to say of it must not put ages wrong by more than they waited."""
    for seed in range(8):
        early = [(at, error) for at, error in errors(seed, least=2e-3, seconds=15.0) if error < -MOST]
        assert not early, early[:5]


@pytest.mark.slow
@pytest.mark.parametrize("step", [0.3, -0.3, -60.0])
def test_an_interface_that_does_not_say_whether_frames_wait_takes_a_quarter_of_a_second(step: float) -> None:
    """Whatever reads by itself (a trace, another package): frames that all waited for so long did not."""
    late = [at for at, error in errors(1, step=step, proofs=False) if abs(error) > MOST]
    assert all(SET_AT <= at <= SET_AT + 0.25 for at in late)


class Thread:
    """The receive thread, as :mod:`daq.drivers.can.port` runs it; ``kept_s``: from running when a frame comes, once."""

    def __init__(self, random_: random.Random) -> None:
        self.times = ArrivalTimes()
        self.times.watched = True
        self.kept_s = 0.0
        self._random, self._now = random_, 0.0

    def burst(self, at: list[float], stamps: list[float]) -> list[int]:
        """Frames that come at these moments; when they seem to have come."""
        found = []
        for moment, stamp in zip(at, stamps, strict=True):
            if moment > self._now:
                before = self._now
                while self.times.uncertain and before + UNCERTAIN_S < moment:
                    self.times.nothing_at(round(before * NS))
                    before += UNCERTAIN_S + self._random.expovariate(1 / 50e-6)
                self.times.nothing_at(round(min(before, moment) * NS))
                kept, self.kept_s = self.kept_s, 0.0
                self._now = max(before, moment) + self._random.expovariate(1 / 50e-6) + kept
            else:
                self._now += 40e-6
            found.append(self.times.of(stamp, round(self._now * NS)))
        return found


@pytest.mark.parametrize("step", [0.0, 0.3, -0.3, 60.0, -60.0])
def test_times_that_may_be_wrong_are_known_to_be(step: float) -> None:
    """What waits when a bus is opened, or when its clock is set, is told from nothing: no time is right by chance."""
    uncertain = wrong_but_uncertain = 0
    for seed in range(40):
        random_ = random.Random(seed)
        thread = Thread(random_)
        for cycle in range(1, 40):
            if cycle in (1, 20):
                thread.kept_s = random_.uniform(0, 5e-3)
            at = sorted(cycle * PERIOD + random_.uniform(0, 0.0015) for _ in range(6))
            came = thread.burst(at, [1.7e9 + moment + step * (cycle >= 20) for moment in at])
            # As a cycle that takes them then sees them.
            off = [abs(one / NS - moment) for one, moment in zip(came, at, strict=True)]
            sure = [one >= thread.times.sure_ns for one in came]
            assert all(error <= MOST for error, known in zip(off, sure, strict=True) if known)
            assert all(sure) or cycle in (1, 20)  # one cycle, no more
            uncertain += not all(sure)
            wrong_but_uncertain += max(off) > MOST
    assert 0 < wrong_but_uncertain <= uncertain


@pytest.mark.parametrize("step", [0.01, -0.01])
def test_a_small_step_is_wrong_for_a_quarter_of_a_second(step: float) -> None:
    """One that a gateway's lateness could be as well (:data:`daq.drivers.can.port.TRANSIT_NS`)."""
    thread, random_ = Thread(random.Random(1)), random.Random(2)
    for cycle in range(1, 150):
        at = sorted(cycle * PERIOD + random_.uniform(0, 0.0015) for _ in range(6))
        came = thread.burst(at, [1.7e9 + moment + step * (cycle >= 75) for moment in at])
        off = max(abs(one / NS - moment) for one, moment in zip(came, at, strict=True))
        assert off <= MOST or 75 <= cycle <= 75 + 0.25 / PERIOD


def test_a_bus_on_which_little_comes_is_sure_of_its_times() -> None:
    """A frame a second, by a clock that is off by 100 ppm: one that comes as it did before is no frame that waited."""
    thread = Thread(random.Random(1))
    for second in range(1, 60):
        (came,) = thread.burst([float(second)], [1.7e9 + second * (1 + 1e-4)])
        assert abs(came / NS - second) <= MOST
        assert came >= thread.times.sure_ns or second == 1
        assert not thread.times.uncertain or second == 1


def test_a_gateway_that_hands_on_some_frames_late_does_not_move_the_others() -> None:
    thread, random_ = Thread(random.Random(1)), random.Random(2)
    for cycle in range(1, 500):
        on_bus = sorted(cycle * PERIOD + random_.uniform(0, 0.0015) for _ in range(6))
        late = random_.uniform(0, 0.01) if random_.random() < 0.1 else 0.0
        came = thread.burst([moment + late for moment in on_bus], [1.7e9 + moment for moment in on_bus])
        off = max(abs(one / NS - moment) for one, moment in zip(came, on_bus, strict=True))
        assert off <= MOST


def test_whoever_says_nothing_of_waiting_hands_frames_over_as_they_come() -> None:
    times = ArrivalTimes()
    assert [times.of(1e9 + k, (50 + k) * NS) for k in range(3)] == [50 * NS, 51 * NS, 52 * NS]
    assert times.sure_ns <= 50 * NS


def test_an_interface_without_stamps_is_taken_at_its_word() -> None:
    times = ArrivalTimes()
    times.watched = True
    assert times.of(0.0, 7 * NS) == 7 * NS >= times.sure_ns


@pytest.mark.slow
def test_a_thread_that_is_starved_for_seconds_is_not_sure_of_its_clock() -> None:
    """All frames of a second wait, and the next second's: that is no clock that was set by so little."""
    for seed in range(6):
        random_ = random.Random(seed)
        thread = Thread(random_)
        for cycle in range(1, 400):
            if 150 < cycle < 300:
                thread.kept_s = random_.uniform(2.5e-3, 6e-3)
            at = sorted(cycle * PERIOD + random_.uniform(0, 0.0015) for _ in range(6))
            came = thread.burst(at, [1.7e9 + moment for moment in at])
            for one, moment in zip(came, at, strict=True):
                assert one < thread.times.sure_ns or abs(one / NS - moment) <= MOST, cycle
        assert came[-1] >= thread.times.sure_ns


def test_a_thread_that_was_kept_from_running_is_no_clock_that_was_set() -> None:
    times = ArrivalTimes()
    times.watched = True
    for k in range(150):
        times.nothing_at(round((k * PERIOD + 0.001) * NS))
        times.of(1e9 + (k + 1) * PERIOD, round((k + 1) * PERIOD * NS))
    times.nothing_at(round(3.001 * NS))
    taken = round(3.5 * NS)  # 24 frames wait by then
    came = [times.of(1e9 + 3.0 + k * PERIOD, taken + 40_000 * k) for k in range(1, 25)]
    assert [at / NS for at in came] == pytest.approx([3.0 + k * PERIOD for k in range(1, 25)], abs=MOST)
    assert times.restarts == 0


def test_frames_never_overtake_each_other_nor_come_after_they_were_taken() -> None:
    random_ = random.Random(3)
    times, now, before = ArrivalTimes(), 10 * NS, 0
    for _ in range(5000):
        now += random_.randrange(1, 30_000_000)
        came = times.of(random_.choice((1e9, 1.1e9, 9e8)) + now / NS + random_.gauss(0, 0.5), now)
        assert before <= came <= now
        before = came


class Bursts:
    """A bus on which five frames come every 20 ms; its clock is turned by waiting, and by a millionth by each look."""

    def __init__(self, count: int) -> None:
        self.now = 0.0
        self._at = [k * PERIOD for k in range(1, count + 1) for _ in range(5)]  # as a gateway hands them on

    def monotonic_ns(self) -> int:
        self.now += 1e-6
        return round(self.now * NS)

    def recv(self, timeout: float) -> can.Message | None:
        if not self._at:
            raise can.CanOperationError("the end")
        if self._at[0] > self.now + timeout:
            self.now += timeout
            return None
        self.now = max(self.now, self._at[0])
        return can.Message(timestamp=1.7e9 + self._at.pop(0), arbitration_id=0x181, is_extended_id=False)

    def attach(self, port: CanPort, config: CanBus) -> Bursts:
        return self

    def begin(self, port: CanPort) -> None:
        port._receive()

    def noted(self, name: str) -> None:
        return None


class Ear(CanPort):
    """Notes when nothing was there."""

    def __init__(self, bus: Bursts) -> None:
        context = DriverContext(PERIOD, 0.0, bus.monotonic_ns, can=bus)  # type: ignore[arg-type]
        super().__init__(CanopenBus(name="b", type="canopen", interface="virtual", channel="x"), context, BusHealth())
        self.empty: list[float] = []
        nothing_at = self._times.nothing_at
        self._times.nothing_at = lambda now_ns: (self.empty.append(now_ns / NS), nothing_at(now_ns))[1]  # type: ignore[method-assign]
        self.open()

    def dispatch(self, message: can.Message, at_ns: int) -> None:
        pass


def test_behind_each_burst_it_is_known_that_nothing_waits() -> None:
    """Else a clock that is set back by two cycles is taken for frames that waited."""
    ear = Ear(Bursts(30))
    for cycle in range(1, 30):
        assert any(0.0 <= at - cycle * PERIOD < 0.005 for at in ear.empty), cycle
    assert len(ear.empty) <= 2 * 30  # and no more often than that: each look costs a system call
