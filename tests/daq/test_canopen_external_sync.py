"""Another master's bus by EDS and SYNC: mapping as it is, and each PDO credited to the SYNC that it was sampled at."""

from __future__ import annotations

import struct
import threading
import time
import uuid
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path

import can as python_can
import canopen
import numpy as np
import pytest
from bench_machines import HEAD, can
from canopen.objectdictionary import ODArray, ODRecord, ODVariable, datatypes
from hand_fed_can import PERIOD, HandFed
from hypothesis import given
from hypothesis import strategies as st
from socketcand_test_hub import TestHub

from daq import MachineFileError, Quality, load_machine, parse_machine
from daq.acquisition.acquisition import AcquisitionProcess
from daq.acquisition.ring import RingReader
from daq.drivers import DriverContext, make_driver
from daq.drivers.canopen.eds import pdo_places
from daq.drivers.canopen.listening import ListeningDriver
from daq.frames.clock import NS, RealClock
from daq.machine.machine_check import check_machine

CHANNELS = """
channels:
- {name: j1.angle, quantity: joint_position, joint: j1, unit: rad,
    source: {bus: can0, node: 5, object: 0x6004, data_type: uint32, scale: 1.0e-6}}
- {name: j1.head, quantity: head_pressure, joint: j1, unit: bar,
    source: {bus: can0, node: 6, object: 0x7130, subindex: 1, data_type: int24, scale: 0.001}}
- {name: j1.rod, quantity: rod_pressure, joint: j1, unit: bar,
    source: {bus: can0, node: 6, object: 0x7130, subindex: 2, data_type: int16}}
buses:
- {name: can0, type: canopen, interface: virtual, channel: none, listen_only: true, sync: external,
   nodes: [{node: 5, eds: encoder.eds}, {node: 6, eds: pressure.dcf}]}
"""
ANGLE, HEAD_PRESSURE, ROD_PRESSURE = range(3)


def variable(name: str, index: int, subindex: int, data_type: int, default: int) -> ODVariable:
    made = ODVariable(name, index, subindex)
    made.data_type, made.access_type, made.default = data_type, "rw", default
    made.default_raw = f"0x{default:X}"
    return made


def dictionary(pdos: dict[int, tuple[int, int, int, list[int]]]) -> canopen.ObjectDictionary:
    """Per PDO its COB-ID, transmission type, event timer and entries."""
    made = canopen.ObjectDictionary()
    for number, (cob_id, transmission, event_ms, entries) in pdos.items():
        parameters = ODRecord(f"TPDO{number} parameters", 0x1800 + number)
        for subindex, kind, value in (
            (0, datatypes.UNSIGNED8, 5),
            (1, datatypes.UNSIGNED32, cob_id),
            (2, datatypes.UNSIGNED8, transmission),
            (5, datatypes.UNSIGNED16, event_ms),
        ):
            parameters.add_member(variable(f"p{subindex}", 0x1800 + number, subindex, kind, value))
        mapping = ODArray(f"TPDO{number} mapping", 0x1A00 + number)
        mapping.add_member(variable("n", 0x1A00 + number, 0, datatypes.UNSIGNED8, len(entries)))
        for subindex, entry in enumerate(entries, start=1):
            mapping.add_member(variable(f"e{subindex}", 0x1A00 + number, subindex, datatypes.UNSIGNED32, entry))
        made.add_object(parameters)
        made.add_object(mapping)
    return made


def written(folder: Path, text: str = CHANNELS) -> Path:
    """``canopen`` writes the EDS files; a status byte, a 24-bit and a packed 12-bit value stand in one PDO."""
    canopen.export_od(dictionary({0: (0x185, 1, 0, [0x60040020])}), str(folder / "encoder.eds"))
    entries = [0x60000008, 0x71300118, 0x7130020C]
    canopen.export_od(
        dictionary({0: (0x8000_0186, 255, 0, entries[:1]), 1: (0x286, 255, 100, entries)}), str(folder / "pressure.dcf")
    )
    path = folder / "machine.yaml"
    path.write_text(HEAD.format(rate=50) + text)
    return path


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[HandFed]:
    machine = load_machine(written(tmp_path))
    made = HandFed(lambda context: make_driver(machine.buses[0], machine.channels, context))
    yield made
    made.driver.stop()
    assert made.bus.sent == []


def sync(bench: HandFed) -> None:
    """The other master's SYNC comes, and leads a cycle."""
    bench.frame(0x080, b"")
    assert isinstance(bench.driver, ListeningDriver)
    assert bench.driver.next_sync(bench.now_ns) == bench.now_ns
    bench.driver.trigger(bench.number)
    bench.number += 1


def angle(bench: HandFed, value: int) -> None:
    bench.frame(0x185, struct.pack("<I", value))


def test_places_of_objects_in_pdos_are_those_of_eds_and_dcf(tmp_path: Path) -> None:
    written(tmp_path)
    places = pdo_places(str(tmp_path / "pressure.dcf"), 6, "can0")
    found = {key: (p.cob_id, p.bit, p.bits, p.synchronous, p.event_ms) for key, p in places.items()}
    assert found == {  # nothing of the PDO whose COB-ID has bit 31
        (0x6000, 0): (0x286, 0, 8, False, 100),
        (0x7130, 1): (0x286, 8, 24, False, 100),
        (0x7130, 2): (0x286, 32, 12, False, 100),
    }
    assert pdo_places(str(tmp_path / "encoder.eds"), 5, "can0")[0x6004, 0].synchronous


def test_node_id_and_another_alphabet(tmp_path: Path) -> None:
    written(tmp_path)
    path = tmp_path / "encoder.eds"
    text = path.read_text().replace("0x185", "$NODEID+0x180").replace("TPDO0", "Drehgeber für Höhe")
    assert "$NODEID" in text
    path.write_bytes(text.encode("cp1252"))
    assert pdo_places(str(path), 17, "can0")[0x6004, 0].cob_id == 0x191


def test_packed_values_are_taken_apart(bench: HandFed) -> None:
    # status 0xA5; 24 bits: -2 = 0xFFFFFE; 12 bits: -1 = 0xFFF, and 4 bits of something else above
    bench.frame(0x286, bytes.fromhex("A5 FEFFFF FF3F"))
    samples = bench.cycle()
    assert samples.raw[[HEAD_PRESSURE, ROD_PRESSURE]].tolist() == [-2.0, -1.0]
    assert samples.interval is not None and samples.interval[HEAD_PRESSURE] == pytest.approx(5.0)  # its event timer


def test_a_pdo_belongs_to_the_sync_before_it(bench: HandFed) -> None:
    sync(bench)
    bench.advance(0.003)
    angle(bench, 1)
    samples = bench.driver.collect(bench.now_ns)
    assert (samples.raw[ANGLE], samples.quality[ANGLE]) == (1.0, Quality.FRESH)
    assert (samples.cycles_ago[ANGLE], samples.after_sync_s[ANGLE]) == (0, 0.0)


def test_what_is_sampled_at_a_sync_of_which_nobody_knows_when_it_came_is_late(bench: HandFed) -> None:
    assert bench.port is not None
    bench.port._times.watched = True
    bench.port._times._known = 0
    sync(bench)
    bench.port._times.nothing_at(bench.now_ns)
    bench.advance(0.0003)
    angle(bench, 1)  # when this came is known
    assert bench.driver.collect(bench.now_ns).quality[ANGLE] == Quality.LATE


def test_a_pdo_behind_the_next_sync_is_of_that_one(bench: HandFed) -> None:
    """A master that is not always in time, and a cycle that is collected late."""
    sync(bench)
    bench.advance(0.009)
    bench.frame(0x080, b"")
    bench.advance(0.0005)
    angle(bench, 2)
    samples = bench.driver.collect(bench.now_ns)
    assert (samples.quality[ANGLE], samples.cycles_ago[ANGLE]) == (Quality.FRESH, 0)
    assert samples.after_sync_s[ANGLE] == pytest.approx(0.009)


def test_a_pdo_later_than_half_a_period_is_late(bench: HandFed) -> None:
    sync(bench)
    bench.advance(0.012)
    angle(bench, 1)
    assert bench.driver.collect(bench.now_ns).quality[ANGLE] == Quality.LATE
    bench.advance(0.007)
    angle(bench, 2)  # after the cycle was collected: of that SYNC all the same
    bench.advance(0.001)
    sync(bench)
    samples = bench.driver.collect(bench.now_ns)
    assert (samples.quality[ANGLE], samples.cycles_ago[ANGLE]) == (Quality.LATE, 1)


def test_an_event_driven_pdo_behind_the_sync_is_younger_than_it(bench: HandFed) -> None:
    sync(bench)
    bench.advance(0.003)
    bench.frame(0x286, bytes(6))
    samples = bench.driver.collect(bench.now_ns)
    assert samples.quality[HEAD_PRESSURE] == Quality.FRESH
    assert samples.after_sync_s[HEAD_PRESSURE] == pytest.approx(0.003)


def test_an_event_driven_pdo_keeps_its_own_time(bench: HandFed) -> None:
    bench.frame(0x286, bytes(6))
    bench.advance(0.015)
    sync(bench)
    samples = bench.driver.collect(bench.now_ns)
    assert samples.quality[HEAD_PRESSURE] == Quality.FRESH
    assert samples.after_sync_s[HEAD_PRESSURE] == pytest.approx(-0.015)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ("eds: encoder.eds", "eds: encoder.dcf", "no such file"),
        ("eds: encoder.eds", "eds: machine.yaml", "unknown kind of file"),
        (", eds: encoder.eds", "", "add cob_id and byte to its source, or eds to node 5"),
        ("object: 0x6004", "object: 0x6005", "0x6005:0 is in no PDO of"),
        ("data_type: int24", "data_type: int16", "has 24 bits in"),
    ],
)
def test_files_and_sources_that_do_not_fit(tmp_path: Path, before: str, after: str, words: str) -> None:
    path = written(tmp_path, CHANNELS.replace(before, after))
    machine = load_machine(path)
    with pytest.raises(MachineFileError) as caught:
        HandFed(lambda context: make_driver(machine.buses[0], machine.channels, context))
    assert words in str(caught.value) and "\n" not in str(caught.value)
    (finding,) = check_machine(path).errors
    assert words in finding.text and finding.key == "buses[0]"


@pytest.mark.timeout(20)
def test_a_file_that_never_ends_is_not_read(tmp_path: Path) -> None:
    path = written(tmp_path)
    (tmp_path / "encoder.eds").unlink()
    (tmp_path / "encoder.eds").symlink_to("/dev/zero")
    (finding,) = check_machine(path).errors
    assert "encoder.eds: no such file" in finding.text


@pytest.mark.parametrize("content", [b"", b"[DeviceInfo]\n[1800]\n", b"[DeviceInfo]\n[MandatoryObjects]\nx"])
def test_an_eds_file_with_other_content_is_one_finding(tmp_path: Path, content: bytes) -> None:
    path = written(tmp_path)
    (tmp_path / "encoder.eds").write_bytes(content)
    (finding,) = check_machine(path).errors
    assert "encoder.eds: is no EDS" in finding.text or "is in no PDO" in finding.text


def test_a_led_bus_follows_no_other_sync() -> None:
    text = can("x").replace("listen_s: 0", "sync: external")
    with pytest.raises(MachineFileError, match="sync: external means that another master leads; add listen_only"):
        parse_machine(text)
    text = can("x").replace("listen_s: 0", "listen_only: true\n  sync: external")
    second = text[text.index("- name: can0") :].replace("can0", "can1")
    with pytest.raises(MachineFileError, match="can0 and can1 both say sync: external"):
        parse_machine(text + second)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["stamps", "intervals"])
def test_no_start_is_refused_for_jitter(tmp_path: Path, kind: str) -> None:
    """10,000 starts at the master's 50 Hz with jitter up to 20 % of a period, of each SYNC or of each interval."""
    machine = load_machine(written(tmp_path))
    driver = ListeningDriver(machine.buses[0], machine.channels, DriverContext(PERIOD, 0.0, lambda: 0))  # type: ignore[arg-type]
    random_ = np.random.default_rng(5)
    refused = 0
    for start in range(10_000):
        jitter = random_.uniform(-1, 1, 16) * 0.2 * (start % 5 + 1) / 5
        periods = np.arange(16) + jitter if kind == "stamps" else np.cumsum(1 + jitter)
        driver._syncs.clear()
        driver._syncs.extend(np.round(10 * NS + periods * PERIOD * NS).astype(int).tolist())
        driver._judge_rate()
        refused += not driver.external_sync
        driver._wrong_rate, driver._fits = "", False
    assert refused == 0


@pytest.mark.parametrize("hz", [47.0, 40.0, 75.0, 30.0])
def test_a_rate_that_does_not_fit_is_refused(tmp_path: Path, hz: float) -> None:
    machine = load_machine(written(tmp_path))
    driver = ListeningDriver(machine.buses[0], machine.channels, DriverContext(PERIOD, 0.0, lambda: 0))  # type: ignore[arg-type]
    random_ = np.random.default_rng(6)
    driver._syncs.extend(round(10 * NS + (k + random_.uniform(-0.02, 0.02)) * NS / hz) for k in range(16))
    assert not driver.external_sync
    assert "no multiple" in driver._wrong_rate


# The clock


class Syncs:
    """SYNCs at given moments (in periods); time passes only by waiting for them."""

    def __init__(self, at: list[float]) -> None:
        self.now = 0
        self._at = [round(moment * PERIOD * NS) for moment in at]
        self.clock = RealClock(1 / PERIOD, following=lambda: self.next_sync)
        self.clock.monotonic_ns = lambda: self.now  # type: ignore[method-assign]
        self.clock.start()

    def next_sync(self, deadline: int) -> int | None:
        if self._at and self._at[0] <= deadline:
            self.now = max(self.now, self._at.pop(0))
            return self.now
        self.now = max(self.now, deadline)
        return None

    def ticks(self, count: int) -> list[tuple[int, float]]:
        """Number and moment (in periods) of so many cycles."""
        found = []
        for _ in range(count):
            tick = self.clock.wait()
            found.append((tick.cycle, (self.now - tick.late_ns) / (PERIOD * NS)))
        return found


def test_ticks_are_the_syncs() -> None:
    jittered = [1.0, 2.1, 2.95, 4.0]
    assert Syncs(jittered).ticks(4) == [(n, pytest.approx(at)) for n, at in enumerate(jittered)]


@given(periods=st.lists(st.floats(0.81, 1.19), min_size=1, max_size=50))
def test_every_sync_in_time_is_one_cycle(periods: list[float]) -> None:
    moments, at = [1.0], 1.0
    for period in periods:
        at += period
        moments.append(at)
    assert [number for number, _ in Syncs(moments).ticks(len(moments))] == list(range(len(moments)))


def test_syncs_at_twice_the_rate_lead_every_second_time() -> None:
    assert [at for _, at in Syncs([0.5 * n for n in range(1, 20)]).ticks(6)] == pytest.approx(
        [1.5, 2.5, 3.5, 4.5, 5.5, 6.5]
    )


def test_a_lost_sync_is_a_cycle_by_our_own_clock() -> None:
    ticks = Syncs([1.0, 2.0, 4.0, 5.0]).ticks(5)
    assert ticks == [(0, 1.0), (1, 2.0), (2, 3.0), (3, 4.0), (4, 5.0)]


def test_a_master_that_stops_and_comes_back_at_another_moment() -> None:
    ticks = Syncs([1.0, 2.0, 6.4, 7.4, 8.4]).ticks(8)
    assert [at for _, at in ticks] == pytest.approx([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.4, 8.4])
    assert [number for number, _ in ticks] == list(range(8))


def test_a_stall_skips_numbers() -> None:
    syncs = Syncs([1.0, 2.0, 7.0])  # of several that came meanwhile the driver tells the newest
    syncs.ticks(2)
    syncs.now += round(5.0 * PERIOD * NS)  # nobody ran us
    tick = syncs.clock.wait()
    assert (tick.cycle, tick.skipped) == (6, 4)


@pytest.mark.slow
def test_acquisition_is_led_by_the_other_master(tmp_path: Path) -> None:
    """Over a process of its own and the wall's clock: cycles at the master's rate, values of this SYNC."""
    channel = uuid.uuid4().hex
    hub = TestHub(channel)
    text = CHANNELS.replace(
        "interface: virtual, channel: none",
        f"interface: socketcand, channel: can0, options: {{host: 127.0.0.1, port: {hub.port}}}",
    )
    path = written(tmp_path, text)
    wire = python_can.Bus(interface="virtual", channel=channel)
    ended = threading.Event()

    def lead() -> None:
        number, at = 0, time.monotonic()
        while not ended.wait(max(0.0, at - time.monotonic())):
            at += 0.02
            for identifier, data in ((0x080, b""), (0x185, struct.pack("<I", number)), (0x286, bytes(6))):
                wire.send(python_can.Message(arbitration_id=identifier, data=data, is_extended_id=False))
            number += 1

    thread = threading.Thread(target=lead)
    thread.start()
    try:
        with AcquisitionProcess(path) as acquisition, RingReader(acquisition.ring_name) as reader:
            rows: list[np.void] = []
            deadline = time.monotonic() + 120
            while len(led_pairs(rows)) < 30 and time.monotonic() < deadline:
                rows += list(reader.read().rows)
                time.sleep(0.05)
    finally:
        ended.set()
        thread.join()
        hub.close()
        wire.shutdown()
    steps = led_pairs(rows)
    assert len(steps) >= 30
    assert steps.count(1) >= 0.5 * len(steps)  # a busy computer runs the master late, then several SYNCs come at once


def led_pairs(rows: Sequence[np.void]) -> list[int]:
    """By how much the master counted on between two cycles in a row that it led.

    There the value is fresh and of the SYNC's own moment; where a SYNC is late, our own clock leads, and the value has
    an age of its own.
    """
    led = [row for row in rows if row["quality"][0] == Quality.FRESH and row["ages"][0] == 0.0]
    return [
        round((b["values"][0] - a["values"][0]) / 1e-6) for a, b in pairwise(led) if int(b["cycle"] - a["cycle"]) == 1
    ]
