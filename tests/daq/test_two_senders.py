"""Two devices that send one identifier, told apart by period and content; and what only looks like it."""

from __future__ import annotations

import math
import random
import struct
from collections.abc import Iterator

import numpy as np
import pytest
from bench_machines import listening
from hand_fed_can import PERIOD, HandFed
from hypothesis import given
from hypothesis import strategies as st

from daq import Quality, parse_machine
from daq.drivers import make_driver
from daq.drivers.listening import HALF, Pace

NS = 1_000_000_000


def driver() -> HandFed:
    machine = parse_machine(listening("cob_id: 0x186, byte: 4"))
    return HandFed(lambda context: make_driver(machine.buses[0], machine.channels, context))


@pytest.fixture
def bench() -> Iterator[HandFed]:
    made = driver()
    yield made
    made.driver.stop()
    assert made.bus.sent == []


def told(bench: HandFed) -> list[tuple[str, str, bool]]:
    return [(e["device"], e["what"], e["seconds"] is None) for e in bench.driver.context.events.published()]  # type: ignore[attr-defined]


def played(bench: HandFed, frames: list[tuple[float, int]], cycles: int) -> list[tuple[float, int, float]]:
    """Frames of 0x185 (s since the start, value); what each cycle made of them: end of the cycle, quality, value."""
    waiting, begin, found = sorted(frames), bench.now_ns, []
    for cycle in range(1, cycles + 1):
        end = round(cycle * PERIOD * NS)
        while waiting and waiting[0][0] * NS <= end:
            at, value = waiting.pop(0)
            bench.now_ns = begin + round(at * NS)
            bench.frame(0x185, struct.pack("<I", value))
        bench.now_ns = begin + end
        samples = bench.cycle(0.0)
        found.append((cycle * PERIOD, int(samples.quality[0]), float(samples.raw[0])))
    return found


@pytest.mark.parametrize("phase", [0.1, 0.3, 0.5, 0.7, 0.8])
def test_a_second_sender_that_joins_is_found_with_its_first_frame(bench: HandFed, phase: float) -> None:
    joins = 2.0
    ours = [(k * PERIOD + 0.003, 1000 + k) for k in range(200)]
    theirs = [(joins + (k + phase) * PERIOD + 0.003, 5_000_000) for k in range(50)]
    cycles = played(bench, ours + theirs, 200)
    assert [q for at, q, _ in cycles if at <= joins] == [Quality.FRESH] * round(joins / PERIOD)
    assert all(value != 5_000_000 for _, quality, value in cycles if quality == Quality.FRESH)
    during = [quality for at, quality, _ in cycles if joins + 4 * PERIOD < at <= 2.95]
    assert set(during) == {Quality.INVALID}
    assert cycles[-1][1] == Quality.FRESH  # it went away
    (line,) = [d.detail for d in bench.driver.statistics().devices if d.name == "node 5"]
    assert bench.driver.statistics().counts["two_senders"] > 0 and line == ""


def test_two_senders_from_the_start_are_told_by_what_they_send(bench: HandFed) -> None:
    random_ = random.Random(1)
    ours = [(k * PERIOD + 0.003, random_.randrange(1000, 1100)) for k in range(200)]
    theirs = [(k * PERIOD + 0.013, random_.randrange(1200, 1300)) for k in range(200)]
    cycles = played(bench, ours + theirs, 200)
    assert {quality for _, quality, _ in cycles[HALF:]} == {Quality.INVALID}
    (line,) = [d.detail for d in bench.driver.statistics().devices if d.name == "node 5"]
    assert "two devices" in line and "\n" not in line


@pytest.mark.parametrize("kind", ["jitter", "stall", "lost", "changes", "slow"])
def test_one_sender_is_one_whatever_its_manners(bench: HandFed, kind: str) -> None:
    random_ = random.Random(2)
    moments = [k * PERIOD + 0.003 for k in range(300)]
    if kind == "jitter":
        moments = [at + random_.uniform(0, 0.002) for at in moments]
    elif kind == "stall":  # the gateway was busy: what waited comes at once
        moments = [max(at, 3.2) + 1e-5 * k if 3.0 < at < 3.2 else at for k, at in enumerate(moments)]
    elif kind == "lost":
        moments = [at for at in moments if random_.random() > 0.1]
    elif kind == "slow":
        moments = [3 * at for at in moments[:100]]
    frames = [(at, 1000 + k) for k, at in enumerate(moments)]
    assert Quality.INVALID not in {q for _, q, _ in played(bench, frames, 300)} or kind == "changes"


@pytest.mark.parametrize("seed", range(10))
def test_a_sender_that_also_sends_changes_loses_few_frames(seed: int) -> None:
    """Its event timer begins anew with each frame (CiA 301, 7.5.2.37), which is learnt from the first ones."""
    pace, random_ = Pace(), random.Random(seed)
    at, refused = 0.0, 0
    for _ in range(3000):
        at += 0.1 if random_.random() < 0.7 else random_.uniform(0.005, 0.09)
        refused += pace.arrived(round(at * NS))
    assert refused <= 20  # of 3000


@given(noise=st.floats(0.01, 10.0), seed=st.integers(0, 10_000))
def test_noise_is_not_taken_for_two_senders(noise: float, seed: int) -> None:
    pace, values = Pace(), np.random.default_rng(seed).normal(0, noise, 200)
    assert not any(pace.mixed([float(value)]) for value in values)


@given(period=st.floats(2.5, 500.0), phase=st.floats(0, math.tau))
def test_a_motion_is_not_taken_for_two_senders(period: float, phase: float) -> None:
    pace = Pace()
    assert not any(pace.mixed([math.sin(math.tau * k / period + phase)]) for k in range(200))


def test_a_pdo_whose_length_changes_is_refused_with_a_reason(bench: HandFed) -> None:
    bench.frame(0x185, struct.pack("<I", 7))
    assert bench.cycle().quality[0] == Quality.FRESH
    bench.frame(0x185, bytes(8))
    assert bench.cycle().quality[0] == Quality.INVALID
    (line,) = [d.detail for d in bench.driver.statistics().devices if d.name == "node 5"]
    assert "PDO 0x185 has 8 bytes instead of 4" in line and "check" in line
    bench.frame(0x185, struct.pack("<I", 8))
    assert bench.cycle().quality[0] == Quality.FRESH


@pytest.mark.parametrize("cleared_by", [(0x085, bytes(8)), (0x705, b"\0")], ids=["error reset", "boot-up"])
def test_an_emergency_ends_with_error_reset_or_boot_up(bench: HandFed, cleared_by: tuple[int, bytes]) -> None:
    bench.frame(0x085, b"\x00\x50\x81\0\0\0\0\0")
    bench.frame(0x185, struct.pack("<I", 7))
    assert bench.cycle().quality[0] == Quality.EMERGENCY
    assert ("can0/node 5", "emergency", True) in told(bench)
    bench.advance(0.5)
    bench.frame(*cleared_by)
    bench.frame(0x185, struct.pack("<I", 8))
    assert bench.cycle().quality[0] == Quality.FRESH
    booted = [("can0/node 5", "boot_up", False)] if cleared_by[0] == 0x705 else []
    assert [event for event in told(bench) if event[1] != "silent"] == [("can0/node 5", "emergency", False), *booted]
