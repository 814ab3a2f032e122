"""Raw traces: what was on the bus is in the file, and the drivers make of the file what they made of the bus."""

from __future__ import annotations

import json
import random
import time
from pathlib import Path

import can as python_can
import cantools.database
import numpy as np
import pytest
import typer
from bench_machines import modbus
from canopen_test_bench import ANGLE, HEAD, ROD, Bench
from signals_test_bench import DBC, HEAD_PRESSURE, OIL, TEMPERATURES, written
from typer.testing import CliRunner

from daq import Quality, load_machine, parse_machine
from daq.acquisition.replay import replay
from daq.acquisition.trace import TraceAccess, bus_file, read_trace, trace_files
from daq.commands import cli
from daq.errors import InputError
from daq.frames.events import EventLog
from daq.quality import MEASURED
from daq.recordings.recording_files import read_table
from server.commands.command_line import main

DATABASE = cantools.database.load_string(DBC, "dbc")
BEGAN = 1_700_000_000.0


def traced(bench: Bench, trace: Path, cycles: int, file_bytes: int = 64_000_000) -> list[list[float]]:
    """Raw values of so many cycles of the bench, while its bus is traced; the encoder counts SYNCs."""
    access = TraceAccess(trace, EventLog(), file_bytes)
    bench.driver = bench.make(can=access)
    bench.angle.numbered = (0x6004, 0)
    assert bench.driver.start() == ()
    seen = [bench.once().raw.tolist() for _ in range(cycles)]
    bench.driver.stop()
    access.close()
    return seen


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".blf", ".asc", ".log"])
def test_a_bus_that_was_led_gives_the_same_values_again(bench: Bench, tmp_path: Path, suffix: str) -> None:
    trace = tmp_path / f"trace{suffix}"
    seen = traced(bench, trace, 25)
    sent = [m for m in read_trace(bus_file(trace, "can0")) if not m.is_rx]
    assert {0x080, 0x605, 0x000} <= {m.arbitration_id for m in sent}  # SYNC, SDO and NMT are in it as well
    frames = replay(bench.machine, trace).frames
    again = {round(frame.values[ANGLE] * 1e6): frame for frame in frames if frame.quality[ANGLE] in MEASURED}
    counted = [round(raw[ANGLE]) for raw in seen if np.isfinite(raw[ANGLE])]
    found = [again[count] for count in counted if count in again]
    assert len(found) >= 0.6 * len(counted) > 10  # a busy computer makes answers late: those are late here too
    for frame in found:
        if frame.quality[HEAD] in MEASURED:
            assert frame.values[[HEAD, ROD]] == pytest.approx([50.0e5, 20.5e5])


@pytest.mark.slow
def test_full_files_are_read_in_order(bench: Bench, tmp_path: Path) -> None:
    traced(bench, tmp_path / "trace.log", 40, file_bytes=3000)
    path = bus_file(tmp_path / "trace.log", "can0")
    assert len(trace_files(path)) > 2
    syncs = [m.timestamp for m in read_trace(path) if m.arbitration_id == 0x080]
    assert len(syncs) >= 40 and syncs == sorted(syncs)
    assert abs(syncs[-1] - time.time()) < 600  # UTC, whatever the interface's clock is


def write(path: Path, *frames: tuple[float, int, bytes]) -> None:
    """A trace as another tool would write it: moment in s, identifier, data."""
    with python_can.TRCWriter(path) if path.suffix == ".trc" else python_can.Logger(path) as logger:
        for at, identifier, data in frames:
            extended = identifier > 0x7FF
            logger(
                python_can.Message(
                    timestamp=BEGAN + at, arbitration_id=identifier, data=data, is_extended_id=extended, channel=0
                )
            )


def boom(pressure: float) -> bytes:
    return DATABASE.encode_message("Boom", {"Angle": 0, "HeadPressure": pressure, "RodPressure": 0, "Roll": 0})


@pytest.mark.parametrize("suffix", [".blf", ".asc", ".log", ".trc"])
def test_a_trace_of_another_tool_goes_through_the_driver(tmp_path: Path, suffix: str) -> None:
    machine = load_machine(written(tmp_path))
    oil = DATABASE.encode_message("Temperatures", {"OilTemperature": 43.0})
    frames = [(0.02 * k + 0.005, 291, boom(10.0 + k)) for k in range(50) if not 20 <= k < 40]
    write(tmp_path / f"case{suffix}", (0.0, TEMPERATURES, oil), *frames)
    result = replay(machine, tmp_path / f"case{suffix}")
    pressures = [frame.values[HEAD_PRESSURE] / 1e5 for frame in result.frames]
    quality = [frame.quality[HEAD_PRESSURE] for frame in result.frames]
    assert len(pressures) in (49, 50)
    assert pressures[:20] == pytest.approx(np.arange(10.0, 30.0))
    assert quality[:20] == [Quality.FRESH] * 20 and quality[26:40] == [Quality.MISSING] * 14
    assert pressures[41:49] == pytest.approx(np.arange(51.0, 59.0))
    assert result.frames[3].ages[HEAD_PRESSURE] == pytest.approx(
        0.010, abs=1e-3
    )  # cycles end in the middle of the pause
    assert result.frames[0].values[OIL] == pytest.approx(43.0 + 273.15)
    assert result.frames[1].time - result.frames[0].time == pytest.approx(0.02)


@pytest.mark.parametrize("phase_ms", [0.0, 3.0, 10.0, 19.999])
def test_the_grid_of_a_replay_is_in_phase_with_the_trace(tmp_path: Path, phase_ms: float) -> None:
    """300 frames with a millisecond of jitter, wherever in a period they come: each cycle has its own."""
    random_ = random.Random(round(phase_ms))
    machine = load_machine(written(tmp_path))
    oil = DATABASE.encode_message("Temperatures", {"OilTemperature": 43.0})
    moments = [1.0 + 0.02 * k + phase_ms / 1e3 + random_.uniform(-0.0005, 0.0005) for k in range(300)]
    frames = [(at, 291, boom(10.0 + k % 200)) for k, at in enumerate(moments)]
    write(tmp_path / "case.blf", (moments[0] - 0.3, TEMPERATURES, oil), *frames)
    quality = [frame.quality[HEAD_PRESSURE] for frame in replay(machine, tmp_path / "case.blf").frames]
    first = quality.index(Quality.FRESH)
    assert quality[first : first + 299] == [Quality.FRESH] * 299 and first <= 16


def test_the_command_writes_a_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    machine = written(tmp_path)
    frames = ((0.02 * k + 0.005, 291, boom(10.0 + k)) for k in range(30))
    write(tmp_path / "case.log", (0.0, 291, boom(1.0)), *frames)
    output = tmp_path / "again.parquet"
    with pytest.raises(SystemExit) as ended:
        main(["replay", str(tmp_path / "case.log"), "--machine", str(machine), "-o", str(output), "--json"])
    assert ended.value.code in (0, None)
    said = json.loads(capsys.readouterr().out)
    table = read_table(output)
    assert said["rows"] == table.rows and said["buses"][0]["counts"]["frames"] == 31
    assert table.columns["j1.head"][:5] == pytest.approx([10, 11, 12, 13, 14])
    assert np.isnan(table.columns["tank"]).all()
    assert set(table.columns["tank.quality"]) == {Quality.MISSING}


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("none.blf", None, "no such trace; it is none-plain.blf in"),
        ("x.blf", b"no trace", "is no trace that can be read (no BLF file)"),
        ("x.log", b"(a) b c#\n", "is no trace that can be read"),
        ("x.txt", b"hello\n", "is no trace that can be read"),
    ],
)
def test_a_file_that_is_no_trace_is_refused_in_one_line(
    tmp_path: Path, name: str, content: bytes | None, words: str
) -> None:
    machine = load_machine(written(tmp_path))
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError) as caught:
        replay(machine, tmp_path / name)
    assert words in str(caught.value) and "\n" not in str(caught.value)


def test_a_machine_without_can_has_no_trace(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="has no CAN bus with channels"):
        replay(parse_machine(modbus(502)), tmp_path / "x.blf")


def test_another_kind_of_trace_is_refused_before_anything_is_opened(tmp_path: Path) -> None:
    app = typer.Typer()
    cli.register(app)
    machine = written(tmp_path)
    arguments = ["record", str(machine), "--role", "train", "--seconds", "1", "-o", str(tmp_path / "r.parquet")]
    result = CliRunner().invoke(app, [*arguments, "--trace", str(tmp_path / "t.pcap")])
    assert result.exit_code == 2
    assert "unknown kind of trace '.pcap'; use .blf, .asc, .log" in result.stderr


def test_a_trace_that_cannot_be_written_costs_the_trace_only(bench: Bench, tmp_path: Path) -> None:
    (tmp_path / "folder").write_text("a file where a folder has to be")
    events = EventLog()
    access = TraceAccess(tmp_path / "folder" / "trace.log", events)
    bench.driver = bench.make(can=access)
    assert bench.driver.start() == ()
    bench.until(lambda samples: bool(np.all(samples.quality == Quality.FRESH)))
    access.close()
    (event,) = [event for event in events.published() if event["what"] == "trace_failed"]
    assert "cannot be written" in event["text"]
