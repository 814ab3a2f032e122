"""Plain CAN and J1939 by DBC files: values, told apart by identifier and sender, and never called what they are not.

``cantools`` encodes; frames are handed to the driver at moments of a clock that the test turns.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cantools.database
import numpy as np
import pytest
from cantools import j1939
from hand_fed_can import PERIOD, HandFed
from hypothesis import given, settings
from hypothesis import strategies as st
from signals_test_bench import (
    ANGLE,
    DBC,
    HEAD_PRESSURE,
    OIL,
    ROD_PRESSURE,
    SUPPLY,
    TANK,
    TEMPERATURES,
    signals,
    written,
)

from daq import MachineFileError, Quality, load_machine, parse_machine
from daq.acquisition.assembly import Assembler
from daq.drivers import make_driver
from daq.frames.channels import channel_table
from daq.frames.clock import Tick
from daq.machine.can_database import not_available, pgn_of
from daq.machine.machine_check import check_machine

DATABASE = cantools.database.load_string(DBC, "dbc")


def bench_of(path: Path) -> HandFed:
    machine = load_machine(path)
    return HandFed(lambda context: make_driver(machine.buses[0], machine.channels, context))


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[HandFed]:
    made = bench_of(written(tmp_path))
    yield made
    made.driver.stop()
    assert made.bus.sent == []  # whatever came, nothing was ever answered


def boom(bench: HandFed, **values: float) -> None:
    whole = {"Angle": 0.0, "HeadPressure": 0.0, "RodPressure": 0.0, "Roll": 0.0} | values
    bench.frame(291, DATABASE.encode_message("Boom", whole))


def temperature(bench: HandFed, value: float, sender: int = 0, priority: int = 6) -> None:
    identifier = j1939.frame_id_pack(priority, 0, 0, 0xFE, 0xEE, sender)
    bench.frame(identifier, DATABASE.encode_message("Temperatures", {"OilTemperature": value}), extended=True)


def test_a_frame_written_out_by_hand(bench: HandFed) -> None:
    # -12.34 deg = -1234 = 0xFB2E, Motorola: high byte first; 50.0 bar = 500 = 0x01F4; 2000 kPa = 200 = 0x00C8, Intel
    bench.frame(0x123, bytes.fromhex("FB2E F401 C800 0000"))
    samples = bench.cycle()
    assert samples.raw[[ANGLE, HEAD_PRESSURE, ROD_PRESSURE]] == pytest.approx([-12.34, 50.0, 2000.0])
    # SAE J1939-71, ET1: byte 3 and 4 engine oil temperature, 1/32 degC, from -273: 0x2780 = 10112 is 43 degC
    bench.frame(0x18FEEE00, bytes.fromhex("FFFF 8027 FFFF FFFF"), extended=True)
    assert bench.cycle().raw[OIL] == 43.0


@settings(max_examples=60, deadline=None)
@given(
    angle=st.integers(-18000, 18000), head=st.integers(0, 4000), rod=st.integers(0, 4000), oil=st.integers(0, 0xFAFF)
)
def test_what_cantools_encodes_comes_out(
    tmp_path_factory: pytest.TempPathFactory, angle: int, head: int, rod: int, oil: int
) -> None:
    bench = shared(tmp_path_factory)
    boom(bench, Angle=angle * 0.01, HeadPressure=head * 0.1, RodPressure=rod * 10)
    temperature(bench, oil * 0.03125 - 273)
    samples = bench.cycle()
    expected = [angle * 0.01, head * 0.1, rod * 10.0, oil * 0.03125 - 273]
    assert samples.raw[[ANGLE, HEAD_PRESSURE, ROD_PRESSURE, OIL]] == pytest.approx(expected)
    assert set(samples.quality[[ANGLE, HEAD_PRESSURE, ROD_PRESSURE, OIL]]) == {Quality.FRESH}


_SHARED: list[HandFed] = []


def shared(factory: pytest.TempPathFactory) -> HandFed:
    """One bench for all examples: reading a DBC file takes longer than an example."""
    if not _SHARED:
        _SHARED.append(bench_of(written(factory.mktemp("signals"))))
    return _SHARED[0]


@given(identifier=st.integers(0, 0x1FFF_FFFF))
def test_the_pgn_is_that_of_cantools(identifier: int) -> None:
    assert pgn_of(identifier) == j1939.pgn_from_frame_id(identifier)


def test_eleven_and_twenty_nine_bits_are_told_apart(bench: HandFed) -> None:
    bench.frame(291, bytes(8), extended=True)
    bench.frame(TEMPERATURES & 0x7FF, bytes(8))
    assert set(bench.cycle().quality) == {Quality.MISSING}


def test_a_value_is_delivered_once_with_its_age(bench: HandFed) -> None:
    boom(bench, Angle=1.0)
    bench.advance(0.004)
    samples = bench.cycle(0.016)
    assert samples.quality[ANGLE] == Quality.FRESH
    assert samples.after_sync_s[ANGLE] == pytest.approx(-0.020)
    assert bench.cycle().quality[ANGLE] == Quality.MISSING


def test_of_several_frames_in_a_cycle_the_newest_counts(bench: HandFed) -> None:
    for angle in (1.0, 2.0, 3.0):
        boom(bench, Angle=angle)
        bench.advance(0.005)
    assert bench.cycle(0.0).raw[ANGLE] == pytest.approx(3.0)


def test_a_frame_that_waited_in_the_interface_is_late(bench: HandFed) -> None:
    boom(bench)  # from now on the offset of the interface's clock is known
    bench.cycle()
    boom(bench)
    samples = bench.cycle(2.0 * PERIOD)
    assert samples.quality[ANGLE] == Quality.LATE
    assert samples.after_sync_s[ANGLE] == pytest.approx(-2 * PERIOD)
    assert bench.driver.statistics().counts["late"] == 1


def test_a_frame_of_which_nobody_knows_how_long_it_waited_is_late(bench: HandFed) -> None:
    assert bench.port is not None
    bench.port._times.watched = True
    bench.port._times._known = 0
    boom(bench)
    assert bench.cycle().quality[0] == Quality.LATE
    bench.port._times.nothing_at(bench.now_ns)
    bench.advance(0.0003)
    boom(bench)
    assert bench.cycle().quality[0] == Quality.FRESH


def test_a_short_frame_is_invalid_where_it_ends(bench: HandFed) -> None:
    bench.frame(291, bytes.fromhex("FB2E F401"))
    samples = bench.cycle()
    assert samples.quality[[ANGLE, HEAD_PRESSURE, ROD_PRESSURE]].tolist() == [
        Quality.FRESH,
        Quality.FRESH,
        Quality.INVALID,
    ]
    assert np.isnan(samples.raw[ROD_PRESSURE])
    assert "has 4 bytes instead of 8" in bench.driver.statistics().devices[0].detail


def test_parts_of_a_multiplexed_message_have_ages_of_their_own(bench: HandFed) -> None:
    bench.frame(292, DATABASE.encode_message("Slow", {"Page": 0, "Supply": 210.0}))
    bench.frame(292, DATABASE.encode_message("Slow", {"Page": 1, "Tank": 1.25}))
    samples = bench.cycle()
    assert samples.raw[[SUPPLY, TANK]] == pytest.approx([210.0, 1.25])
    bench.frame(292, DATABASE.encode_message("Slow", {"Page": 1, "Tank": 1.5}))
    samples = bench.cycle()
    assert samples.quality[[SUPPLY, TANK]].tolist() == [Quality.MISSING, Quality.FRESH]
    bench.frame(292, b"\x07" + bytes(7))  # a page that the file does not know
    assert set(bench.cycle().quality) == {Quality.MISSING}
    assert bench.driver.statistics().counts["unknown_part"] == 1


def test_what_j1939_says_is_no_measurement_is_none(bench: HandFed) -> None:
    for raw in (0xFFFF, 0xFEFF, 0xFB00):
        bench.frame(0x18FEEE00, b"\xff\xff" + raw.to_bytes(2, "little") + bytes(4), extended=True)
        assert bench.cycle().quality[OIL] == Quality.INVALID
    bench.frame(0x18FEEE00, b"\xff\xff" + (0xFAFF).to_bytes(2, "little") + bytes(4), extended=True)
    assert bench.cycle().quality[OIL] == Quality.FRESH
    assert bench.driver.statistics().counts["not_available"] == 3


@pytest.mark.parametrize(("bits", "last"), [(2, 1), (4, 13), (8, 0xFA), (16, 0xFAFF), (32, 0xFAFF_FFFF)])
def test_j1939_values_above_the_last_valid_one_are_not_available(bits: int, last: int) -> None:
    """SAE J1939-71, tables 1 and 2."""
    signal = cantools.database.can.Signal("x", 0, bits)
    assert not not_available(signal, last)
    assert not_available(signal, last + 1)


def test_two_devices_that_send_one_message_are_not_mixed(bench: HandFed) -> None:
    temperature(bench, 40.0, sender=0x00)
    assert bench.cycle().quality[OIL] == Quality.FRESH
    temperature(bench, 90.0, sender=0x21, priority=3)
    assert bench.cycle().quality[OIL] == Quality.INVALID
    line = next(d.detail for d in bench.driver.statistics().devices if d.name == "message Temperatures")
    assert "comes from 0x00 and 0x21; add source_address" in line
    for _ in range(120):  # the second one was taken away
        temperature(bench, 40.0, sender=0x00)
        samples = bench.cycle()
    assert samples.quality[OIL] == Quality.FRESH


def test_a_source_address_picks_the_device(tmp_path: Path) -> None:
    path = written(tmp_path, signals().replace("pgn: 0xFEEE,", "pgn: 0xFEEE, source_address: 0x21,"))
    bench = bench_of(path)
    temperature(bench, 90.0, sender=0x21)
    temperature(bench, 40.0, sender=0x00)
    samples = bench.cycle()
    assert (samples.raw[OIL], samples.quality[OIL]) == (90.0, Quality.FRESH)
    bench.driver.stop()


def test_a_slow_message_is_held_between_its_frames_and_then_stale(tmp_path: Path) -> None:
    """100 ms by the file at 20 ms per cycle; five cycles after the last frame nothing more is due, then it is late."""
    path = written(tmp_path)
    bench = bench_of(path)
    machine = load_machine(path)
    assembler = Assembler(channel_table(machine), [bench.driver.channels], machine.rate_hz)
    seen = []
    for number in range(24):
        if number % 5 == 0 and number < 10:
            temperature(bench, 43.0)
        samples = bench.cycle()
        frame = assembler.frame(Tick(number, number * PERIOD, 0, 0, 0), bench.now_ns, bench.now_ns, [samples])
        seen.append(Quality(frame.quality[OIL]).name)
    assert seen == ["FRESH", *["HELD"] * 4, "FRESH", *["HELD"] * 7, *["STALE"] * 3, *["MISSING"] * 8]
    bench.driver.stop()


def test_the_rate_of_a_message_without_cycle_time_is_learnt(bench: HandFed) -> None:
    for number in range(20):
        if number % 4 == 0:
            boom(bench)
        samples = bench.cycle()
    assert samples.interval is not None
    assert samples.interval[ANGLE] == pytest.approx(4.0)
    assert samples.interval[SUPPLY] == 1.0  # never came: missing, not held


def test_a_silent_device_and_its_return_are_reported(bench: HandFed) -> None:
    boom(bench)
    bench.cycle()
    states = {d.name: d.state for d in bench.driver.statistics().devices}
    assert states == {"message Boom": "running", "message Slow": "silent", "message Temperatures": "silent"}
    bench.cycle(1.5)
    assert "message 'Boom' (0x123) does not come" in bench.driver.statistics().devices[0].detail
    boom(bench)
    bench.cycle()
    assert bench.driver.statistics().devices[0].state == "running"


def test_what_does_not_come_at_the_start_names_its_channels(bench: HandFed) -> None:
    lines = [str(problem) for problem in bench.problems]
    assert len(lines) == 4
    assert "message 'Temperatures' (PGN 0xFEEE) does not come" in lines[3]
    assert [getattr(problem, "channels", ()) for problem in bench.problems][3] == ("oil",)


WRONG = [
    ("signal: Angle}", "signal: Angel}", "no signal 'Angel'; did you mean 'Angle'?"),
    ("message: Boom,", "message: Bom,", "no message 'Bom' in the bus's files; did you mean 'Boom'?"),
    ("message: Boom, signal: RodPressure", "message: Slow, signal: RodPressure", "no signal 'RodPressure' in message"),
    ("pgn: 0xFEEE", "pgn: 0xFEEF", "no message of PGN 0xFEEF"),
    ("message: Boom,", "message: Boom, source_address: 3,", "has 11 bits, so it is no J1939"),
    ("pgn: 0xFEEE, signal: OilTemperature", "message: Long, signal: FarAway", "several frames"),
]


@pytest.mark.parametrize(("before", "after", "words"), WRONG)
def test_sources_that_the_file_does_not_have(tmp_path: Path, before: str, after: str, words: str) -> None:
    text = signals().replace(before, after)
    assert text != signals()
    path = written(tmp_path, text)
    with pytest.raises(MachineFileError) as caught:
        bench_of(path)
    assert words in str(caught.value) and "\n" not in str(caught.value)
    (finding,) = check_machine(path).errors
    assert finding.line == 1 + next(n for n, line in enumerate(text.splitlines()) if after in line)
    assert words in finding.text


def test_a_signal_of_two_messages_needs_its_message(tmp_path: Path) -> None:
    path = written(tmp_path)
    (tmp_path / "mobile.dbc").write_text(DBC.replace("SG_ Tank m1", "SG_ Angle m1").replace("BU_", "BU_"))
    texts = [finding.text for finding in check_machine(path).errors]
    assert any("'Angle' is in 2 messages (Boom, Slow); add message" in text for text in texts)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "no such file"),
        (b"\xff\xfe\x00 secret:x:0", "is no DBC file"),
        (b"BO_ 1", "is no DBC file"),
    ],
)
def test_an_absent_or_unreadable_dbc_file_is_one_finding(tmp_path: Path, content: bytes | None, words: str) -> None:
    path = written(tmp_path)
    (tmp_path / "mobile.dbc").unlink()
    if content is not None:
        (tmp_path / "mobile.dbc").write_bytes(content)
    (finding,) = check_machine(path).errors
    assert words in finding.text and finding.key == "buses[0]"
    assert "secret" not in finding.text  # what stands in a file that somebody else named is not shown
    assert load_machine(path).name == "bench"  # fitting needs no such file


def test_a_unit_that_differs_is_doubted(tmp_path: Path) -> None:
    path = written(tmp_path, signals().replace("signal: RodPressure, scale: 0.01", "signal: RodPressure"))
    (finding,) = [f for f in check_machine(path).findings if "RodPressure" in f.text]
    assert finding.level == "warning" and "in kPa, the channel says bar" in finding.text
    assert not [f for f in check_machine(written(tmp_path)).findings if "the channel says" in f.text]


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ("pgn: 0xFEEE", "pgn: 0xFEEE, message: Temperatures", "keep one"),
        ("dbc: [mobile.dbc]", "dbc: []", "dbc"),
        ("signal: Angle}", "object: 0x6004, node: 3, data_type: int8}", "does not fit bus 'plain' of type can_signals"),
        ("type: can_signals", "type: can_signal", "did you mean 'can_signals'"),
    ],
)
def test_machine_files_that_are_wrong(before: str, after: str, words: str) -> None:
    with pytest.raises(MachineFileError) as caught:
        parse_machine(signals().replace(before, after))
    assert words in str(caught.value)
