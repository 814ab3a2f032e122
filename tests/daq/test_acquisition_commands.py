"""The acquisition commands, as a user types them: what they print, and their exit codes."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import typer
from bench_machines import modbus, plain
from modbus_test_server import FakeModbus, float_registers
from sound_recordings import motion
from typer.testing import CliRunner

from daq import parse_machine, write_recording
from daq.acquisition.journal import journal_path
from daq.commands import cli
from daq.console import progress_bar, reported, working
from daq.errors import AcquisitionError, RecordingError
from daq.recordings.recording_files import read_table

RUNNER = CliRunner()
APP = typer.Typer()
cli.register(APP)


def run(*arguments: object) -> tuple[int, str, str]:
    result = RUNNER.invoke(APP, [str(argument) for argument in arguments])
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result.exit_code, result.stdout, result.stderr


@pytest.fixture
def machine_file(tmp_path: Path) -> Path:
    path = tmp_path / "arm.yaml"
    path.write_text(plain())
    return path


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    machine = parse_machine(plain())
    values = {channel.name: np.arange(5.0) for channel in machine.channels}
    return write_recording(tmp_path / "r.parquet", machine, "train", np.arange(5) / 50, values, cycle=np.arange(5))


def test_machine_check(machine_file: Path) -> None:
    code, out, err = run("machine", "check", machine_file)
    assert (code, err) == (0, "")
    assert "a valid machine file" in out
    code, out, _ = run("machine", "check", machine_file, "--json")
    assert code == 0
    content = json.loads(out)
    assert content["findings"] == []
    assert [joint["joint"] for joint in content["travel"]] == ["j1"]
    assert {key: content[key] for key in ("name", "rate_hz", "joints", "cylinders", "channels", "buses")} == {
        "name": "bench",
        "rate_hz": 50.0,
        "joints": 1,
        "cylinders": 1,
        "channels": 5,
        "buses": [],
    }
    assert content["can_be_acquired"] is False


def test_machine_check_says_all_that_is_wrong_in_one_line_each(machine_file: Path) -> None:
    machine_file.write_text(plain().replace("bore", "boer"))
    code, out, err = run("machine", "check", machine_file)
    assert (code, out) == (2, "")
    first, second = err.splitlines()
    assert first.startswith(f"hilfit: {machine_file}:10: joints[0].cylinder.boer: unknown key; did you mean 'bore'?")
    assert "joints[0].cylinder.bore: this key is missing" in second


def test_machine_schema() -> None:
    code, out, _ = run("machine", "schema")
    assert code == 0
    assert json.loads(out)["properties"]["schema"]["const"] == "hilfit/machine/1"


def test_the_export_command_writes_the_same_columns_as_csv(recording: Path, tmp_path: Path) -> None:
    out_file = tmp_path / "r.csv"
    code, out, _ = run("export", recording, "-o", out_file, "--json")
    assert code == 0
    assert json.loads(out)["rows"] == 5
    before, after = read_table(recording), read_table(out_file)
    assert list(before.columns) == list(after.columns)
    for name, values in before.columns.items():
        np.testing.assert_array_equal(after.columns[name], values)
    assert run("export", recording, "-o", out_file)[0] == 2  # is there already
    assert run("export", recording, "-o", out_file, "--force")[0] == 0
    back = tmp_path / "back.parquet"
    assert run("export", recording, "-o", back)[0] == 0
    assert read_table(back).metadata == before.metadata


@pytest.mark.parametrize("output", ["r.xlsx", "r"])
def test_export_refuses_unknown_kinds(recording: Path, tmp_path: Path, output: str) -> None:
    code, _, err = run("export", recording, "-o", tmp_path / output)
    assert code == 2
    assert "use .parquet or .csv or .mf4 or .mcap or .mat" in err
    assert not (tmp_path / output).exists()


def test_recover_says_what_it_did(tmp_path: Path) -> None:
    assert run("recover", tmp_path) == (0, f"{tmp_path}: nothing to recover\n", "")
    stranger = tmp_path / "x.parquet.journal"
    stranger.write_bytes(b"somebody else's")
    code, out, _ = run("recover", tmp_path, "--json")
    assert code == 0
    (found,) = json.loads(out)
    assert (found["journal"], found["file"], found["left"]) == (str(stranger), None, "is no journal of hilfit")
    assert run("recover", tmp_path)[1] == f"{stranger}: left as it is: is no journal of hilfit\n"
    assert stranger.read_bytes() == b"somebody else's"
    code, _, err = run("recover", tmp_path / "nowhere")
    assert code == 2 and "no such directory" in err


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[tuple[Path, FakeModbus]]:
    server = FakeModbus({1: float_registers({2: 50.0, 4: 0.0, 6: 0.3}), 2: {4: 215}})
    path = tmp_path / "bench.yaml"
    path.write_text(modbus(server.port))
    yield path, server
    server.close()


@pytest.mark.slow
def test_the_record_command_writes_as_many_rows_as_asked_for(bench: tuple[Path, FakeModbus], tmp_path: Path) -> None:
    output = tmp_path / "r.csv"
    order = ("record", bench[0], "--role", "operation", "--wait", 0.6, "--seconds", 0.4, "-o", output)
    code, out, err = run(*order, "--json")
    assert code == 0, err
    result = json.loads(out)
    assert result["recording"]["rows"] == 20
    assert result["acquisition"]["state"] == "running"
    table = read_table(output)
    assert table.rows == 20
    assert table.columns["cycle"][0] >= 30  # 0.6 s at 50 Hz went by
    again = run(*order)
    assert again[0] == 2 and "--force" in again[2]


@pytest.mark.slow
def test_record_fails_in_one_line_when_a_device_is_gone(bench: tuple[Path, FakeModbus], tmp_path: Path) -> None:
    machine_file, server = bench
    server.silent.update({1, 2})
    machine_file.write_text(modbus(server.port, timeout_s=2.0))
    output = tmp_path / "r.parquet"
    code, _, err = run("record", machine_file, "--role", "train", "--seconds", 1, "-o", output)
    assert code == 1
    assert "unit 1" in err and "(and 1 more)" in err and err.count("\n") == 1
    assert not output.exists()


@pytest.mark.slow
def test_record_begins_with_what_is_there(bench: tuple[Path, FakeModbus], tmp_path: Path) -> None:
    machine_file, server = bench
    machine_file.write_text(modbus(server.port, timeout_s=1.0))  # sooner than the rest is waited for
    server.silent.add(2)  # j1.rod
    order = ("record", machine_file, "--role", "operation", "--seconds", 0.4)
    code, _, err = run(*order, "-o", tmp_path / "a.parquet", "--require", "j1.rod")
    assert code == 1 and "unit 2 (j1.rod)" in err and err.count("\n") == 1
    code, _, err = run(*order, "-o", tmp_path / "a.parquet", "--require", "j1.red")
    assert code == 2 and "no channel 'j1.red'; did you mean 'j1.rod'?" in err
    for number, options in enumerate((("--require", "j1.head"), ("--allow-missing",))):
        output = tmp_path / f"{number}.parquet"
        code, out, err = run(*order, "-o", output, *options, "--json")
        assert code == 0, err
        table = read_table(output)
        assert np.isfinite(table.columns["j1.head"]).any() and np.isnan(table.columns["j1.rod"]).all()
        ledger, summary = json.loads(table.metadata["hilfit.ledger"]), json.loads(out)["recording"]
        assert ledger == summary["ledger"]
        cycles, skipped = summary["rows"], summary["missed_cycles"]  # a busy computer may skip one, which was due too
        for channel in ledger.values():  # a unit that answers late owes nothing in some of them
            assert channel["produced"] == channel["stored"] + sum(channel["dropped"].values()) <= cycles <= 20
        dropped = {"bus: nothing came": cycles - skipped} | ({"acquisition: cycle skipped": skipped} if skipped else {})
        assert ledger["j1.rod"] == {"produced": cycles, "stored": 0, "dropped": dropped}
        (event,) = json.loads(table.metadata["hilfit.events"])
        assert (event["device"], event["what"], event["seconds"]) == ("mb/unit 2", "silent", None)


@pytest.mark.slow
def test_an_interrupted_recording_is_sealed(bench: tuple[Path, FakeModbus], tmp_path: Path) -> None:
    output = tmp_path / "r.parquet"
    # Started in the background of a shell, the tests would hand on that interrupts are ignored.
    heed = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); "
    program = heed + "import typer; from daq.commands import cli; app = typer.Typer(); cli.register(app); app()"
    order = ["record", str(bench[0]), "--role", "operation", "--seconds", "600", "-o", str(output)]
    with subprocess.Popen([sys.executable, "-c", program, *order], stdout=subprocess.PIPE, text=True) as process:
        server = bench[1]
        with server.asked:  # commissioning asks each unit once; from the second dozen on, frames come
            assert server.asked.wait_for(lambda: len(server.requests) > 24, timeout=60)
        deadline = time.monotonic() + 60
        while not journal_path(output).exists() and time.monotonic() < deadline:
            time.sleep(0.01)
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "interrupted before 600 s" in out
    assert not journal_path(output).exists()


def test_record_refuses_a_machine_without_buses(machine_file: Path, tmp_path: Path) -> None:
    code, _, err = run("record", machine_file, "--role", "train", "--seconds", 1, "-o", tmp_path / "r.parquet")
    assert code == 2 and "buses" in err
    code, _, _ = run("record", machine_file, "--role", "holiday", "--seconds", 1, "-o", tmp_path / "r.parquet")
    assert code == 2


def test_errors_have_the_exit_codes_of_their_kind() -> None:
    for error, code in ((RecordingError("a"), 2), (AcquisitionError("b"), 1)):

        @reported
        def fail(error: Exception = error) -> None:
            raise error

        with pytest.raises(typer.Exit) as caught:
            fail()
        assert caught.value.exit_code == code


def test_the_progress_bar_takes_unknown_totals(capsys: pytest.CaptureFixture[str]) -> None:
    with progress_bar("doing") as bar:
        bar(1, None)
        bar(2, 3)
    with progress_bar("quiet", show=False) as bar:
        bar(1, 2)
    assert "quiet" not in capsys.readouterr().err


def test_a_pipe_gets_no_bar_and_no_control_characters(capsys: pytest.CaptureFixture[str]) -> None:
    with working("thinking"), progress_bar("doing") as bar:
        bar(0.5, 1.0, "half")
    said = capsys.readouterr()
    assert said.out == "" and said.err == "[ 50 %] half\n"


@pytest.mark.slow
def test_reading_files_loads_no_library_of_buses_and_none_that_units_and_tables_do_without(
    machine_file: Path, tmp_path: Path
) -> None:
    recording = tmp_path / "sound.parquet"
    pq.write_table(pa.table(motion()), recording)
    program = (
        "import sys; from daq import load_machine, read_recording; import daq.commands.cli; "
        "read_recording(sys.argv[2], load_machine(sys.argv[1]), 'train'); "
        "print(sorted({'can', 'canopen', 'pymodbus', 'serial', 'pint', 'pandas'} & set(sys.modules)))"
    )
    command = [sys.executable, "-c", program, str(machine_file), str(recording)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout == "[]\n"
