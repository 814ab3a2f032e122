"""Files of other tools: read where there is no doubt, refused with the way out where there is."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from bench_machines import plain
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import savemat
from sound_recordings import Columns, motion

from daq import Machine, Recording, RecordingError, parse_machine, read_recording
from daq.errors import InputError
from daq.quality import Quality
from daq.recordings.column_map import in_channels, load_map, parse_map
from daq.recordings.csv_files import read_csv
from daq.recordings.map_draft import draft
from daq.recordings.recording_files import Table
from daq.recordings.time_columns import seconds
from server.commands.command_line import main

MACHINE: Machine = parse_machine(plain())
SOUND = motion()


def text_of(columns: dict[str, Any], separator: str = ",", decimal: str = ".", end: str = "") -> str:
    def cell(value: Any) -> str:
        return value if isinstance(value, str) else repr(float(value)).replace(".", decimal)

    rows = (separator.join(map(cell, row)) + end for row in zip(*columns.values(), strict=True))
    return "\n".join([separator.join(columns) + end, *rows]) + "\n"


def put(path: Path, text: str, encoding: str = "utf-8") -> Path:
    path.write_bytes(text.encode(encoding))
    return path


def same(path: Path, **options: Any) -> Recording:
    """The recording, which has to be that of :data:`SOUND`."""
    read = read_recording(path, MACHINE, "train", **options)
    assert np.allclose(read.time, SOUND["time"], atol=1e-6)
    for channel in MACHINE.channels:
        expected = MACHINE.conversion(channel).to_si(SOUND[channel.name])
        assert np.allclose(read.values[channel.name], expected, rtol=1e-9), channel.name
    return read


def refused(path: Path, *words: str, **options: Any) -> str:
    with pytest.raises(RecordingError) as caught:
        read_recording(path, MACHINE, "train", **options)
    text = str(caught.value)
    assert "\n" not in text and text.startswith(str(path)), text
    for word in words:
        assert word in text, text
    return text


def renamed(**names: str) -> Columns:
    """The sound recording under other headers; ``__`` stands for the point in a channel's name."""
    changed = {old.replace("__", "."): new for old, new in names.items()}
    return {changed.get(name, name): values for name, values in SOUND.items()}


@pytest.mark.slow
@pytest.mark.parametrize("separator", [";", "\t", ","])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "cp1252"])
@pytest.mark.parametrize("decimal", [".", ","])
def test_separators_encodings_and_decimal_signs(tmp_path: Path, separator: str, encoding: str, decimal: str) -> None:
    if separator == decimal:
        return  # twice as many columns: see below
    same(put(tmp_path / "r.csv", text_of(SOUND, separator, decimal), encoding))


def test_csv_files_with_what_spreadsheets_add_are_read_alike(tmp_path: Path) -> None:
    same(put(tmp_path / "sep.csv", "sep=;\n" + text_of(SOUND, ";", ",")))
    same(put(tmp_path / "end.csv", text_of(SOUND, ";", ",", end=";")))
    same(put(tmp_path / "crlf.csv", text_of(SOUND, ";", ",").replace("\n", "\r\n")))
    same(put(tmp_path / "comment.csv", "# logger 7\n% run 3\n\n" + text_of(SOUND)))
    header, _, rows = text_of(SOUND).partition("\n")
    same(put(tmp_path / "savetxt.csv", f"# {header}\n{rows}"))
    units = "s;deg;mm;bar;bar;degC"
    header, _, rows = text_of(SOUND, ";").partition("\n")
    same(put(tmp_path / "units.csv", f"{header}\n{units}\n{rows}"))
    quoted = "\n".join(",".join(f'"{cell}"' for cell in line.split(";")) for line in text_of(SOUND, ";", ",").split())
    same(put(tmp_path / "quoted.csv", quoted))


def test_headers_with_units_are_converted(tmp_path: Path) -> None:
    columns = {
        "Time (ms)": 1e3 * SOUND["time"],
        "J1_Angle [rad]": np.deg2rad(SOUND["j1.angle"]),
        "j1 piston (m)": 1e-3 * SOUND["j1.piston"],
        "j1.head [kPa]": 100.0 * SOUND["j1.head"],
        "j1.rod_psi": SOUND["j1.rod"] / 0.0689475729317831,
        "oil [K]": SOUND["oil"] + 273.15,
    }
    same(put(tmp_path / "r.csv", text_of(columns)))
    same(put(tmp_path / "signs.csv", text_of(renamed(oil="oil [°C]", j1__angle="j1.angle [°]")), "cp1252"))


@pytest.mark.parametrize("factor", [1.0, 1e3, 1e6, 1e9])
def test_time_since_1970_is_made_relative(tmp_path: Path, factor: float) -> None:
    stamps = np.rint((1_767_312_000 + SOUND["time"]) * factor) if factor > 1 else 1_767_312_000 + SOUND["time"]
    columns = {"timestamp": [str(int(s)) if factor > 1 else f"{s:.3f}" for s in stamps]}
    columns |= {name: values for name, values in SOUND.items() if name != "time"}
    same(put(tmp_path / "r.csv", text_of(columns)))


@pytest.mark.parametrize("zone", ["", "Z", "+02:00"])
@pytest.mark.parametrize("mark", [".", ","])
def test_moments_are_made_relative(tmp_path: Path, zone: str, mark: str) -> None:
    begin = np.datetime64("2026-03-02T23:59:55.000")
    moments = [str(begin + np.timedelta64(20 * k, "ms")).replace(".", mark) + zone for k in range(len(SOUND["time"]))]
    columns = {"Timestamp": moments} | {name: values for name, values in SOUND.items() if name != "time"}
    same(put(tmp_path / "r.csv", text_of(columns, ";", mark)))


def test_moments_of_data_frames_are_made_relative(tmp_path: Path) -> None:
    frame = pd.DataFrame({**SOUND, "time": pd.date_range("2026-03-02", periods=500, freq="20ms", tz="UTC")})
    frame.to_parquet(tmp_path / "r.parquet", index=False)
    same(tmp_path / "r.parquet")


DOUBTFUL: dict[str, tuple[Callable[[], str], tuple[str, ...]]] = {
    "comma or thousands": (
        lambda: "time;j1.angle;j1.piston;j1.head;j1.rod;oil\n" + "0;1,234;2,345;3,456;4,567;5,678\n" * 3,
        ("'1,234'", "decimal comma or thousands", "decimal points"),
    ),
    "thousands": (
        lambda: text_of(SOUND, ";", ",").replace("45,0", "1.045,0", 1),
        ("'1.045,0'", "thousands", "without"),
    ),
    "both signs": (
        lambda: text_of(SOUND, ";", ",").replace("45,0", "45.0", 1),
        ("decimal point", "decimal comma"),
    ),
    "commas for both": (
        lambda: text_of(SOUND, ",", ","),
        ("6 columns in the header, 12", "line 2", "semicolons"),
    ),
    "two columns of one name": (lambda: text_of(SOUND).replace("j1.rod", "j1.head", 1), ("'j1.head'", "2 times")),
    "two candidates": (
        lambda: text_of({**SOUND, "J1 Angle [deg]": SOUND["j1.angle"]}),
        ("j1.angle", "'J1 Angle [deg]'", "--map"),
    ),
    "two clocks": (lambda: text_of({**SOUND, "timestamp": SOUND["time"]}), ("time", "'timestamp'", "--map")),
    "a unit of something else": (
        lambda: text_of(renamed(j1__head="j1.head [mm]")),
        ("j1.head [mm]", "'mm'", "head pressure", "Pa"),
    ),
    "an unknown unit": (lambda: text_of(renamed(j1__head="j1.head [counts]")), ("j1.head [counts]", "'counts'")),
    "a unit of two meanings": (lambda: text_of(renamed(j1__angle="j1.angle [grad]")), ("grad", "deg or gon")),
    "a unit that computes": (lambda: text_of(renamed(j1__angle="j1.angle [9**9**9]")), ("no unit",)),
    "milliseconds without a unit": (
        lambda: text_of({**SOUND, "time": 1e3 * SOUND["time"]}),
        ("0.05 Hz", "time [ms]"),
    ),
    "a word in a number": (
        lambda: text_of(SOUND, ";").replace("45.0", "hot", 1),
        ("oil", "'hot'", "line 2"),
    ),
    "a moment that is none": (
        lambda: text_of({**SOUND, "time": ["2026-02-28T10:00:00"] * 499 + ["2026-02-30T10:00:00"]}),
        ("time", "row 500", "2026-02-30"),
    ),
    "a date of one country": (
        lambda: text_of({**SOUND, "time": ["03/02/2026 10:00"] * 500}),
        ("time", "03/02/2026"),
    ),
    "a column without a name": (lambda: text_of(renamed(oil="")).replace(",\n", ",,\n", 1), ("column 6", "no name")),
}


@pytest.mark.parametrize("kind", list(DOUBTFUL))
def test_an_ambiguous_csv_file_is_refused_and_the_line_says_what_to_do(tmp_path: Path, kind: str) -> None:
    make, words = DOUBTFUL[kind]
    refused(put(tmp_path / "r.csv", make()), *words)


@given(
    numbers=st.lists(st.floats(-1e6, 1e6).map(lambda v: round(v, 3)), min_size=1, max_size=8),
    separator=st.sampled_from([";", "\t"]),
)
@settings(max_examples=60, deadline=None)
def test_a_decimal_comma_is_never_taken_for_thousands(
    tmp_path_factory: pytest.TempPathFactory, numbers: list[float], separator: str
) -> None:
    """Whatever the numbers: either they come out as they went in, or the file is refused."""
    path = tmp_path_factory.mktemp("csv") / "r.csv"
    rows = "\n".join(separator.join([f"{k}", repr(v).replace(".", ",")]) for k, v in enumerate(numbers))
    put(path, f"time{separator}a\n{rows}\n")
    try:
        table, _ = read_csv(path, path.read_bytes()[:4096])
    except RecordingError as error:
        assert "thousands" in str(error)
        assert all(len(repr(abs(v)).partition(".")[2]) == 3 for v in numbers if repr(v).count("."))
        return
    assert table.column("a").to_pylist() == numbers


def test_a_column_map_names_scales_and_converts_columns(tmp_path: Path) -> None:
    columns = {
        "t_ms": 1e3 * SOUND["time"],
        "q1 (rad)": np.deg2rad(SOUND["j1.angle"]),
        "ai1": SOUND["j1.piston"],
        "ai2": (SOUND["j1.head"] + 2.5) / 25.0,
        "ai3": SOUND["j1.rod"] / 10.0,
        "oil": SOUND["oil"],
        "button": np.zeros(500),
    }
    path = put(tmp_path / "r.csv", text_of(columns, ";", ","))
    written = put(
        tmp_path / "map.yaml",
        "j1.angle: q1\nj1.piston: ai1\nj1.head: {column: ai2, unit: bar, scale: 25.0, offset: -2.5}\n"
        "j1.rod: {column: ai3, unit: MPa}\n",
    )
    same(path, columns=load_map(written, MACHINE))
    refused(path, "q1", "ai3", "button", "--map")
    wrong = put(tmp_path / "wrong.yaml", "j1.angle: q7\n")
    refused(path, "'q7'", "j1.angle", "wrong.yaml", columns=load_map(wrong, MACHINE))
    unit = put(tmp_path / "unit.yaml", "j1.angle: {column: q1 (rad), unit: bar}\n")
    refused(path, "'bar'", "joint position", columns=load_map(unit, MACHINE))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("j1.angel: a\n", ("j1.angel", "no such channel")),
        ("j1.angle: a\nj1.head: a\n", ("'a'", "j1.angle", "j1.head")),
        ("j1.angle: {column: a, units: deg}\n", ("j1.angle", "units")),
        ("j1.angle: {column: a, scale: 0}\n", ("scale is 0",)),
        ("j1.angle: {column: a, scale: .nan}\n", ("scale",)),
        ("j1.angle: [a]\n", ("j1.angle", "column")),
        ("- a\n", ("not a map",)),
        ("j1.angle: {column: [\n", (":2", "YAML")),
        ("!!python/object/apply:os.system [ls]\n", ("YAML",)),
    ],
)
def test_maps_are_checked(text: str, words: tuple[str, ...]) -> None:
    with pytest.raises(InputError) as caught:
        parse_map(text, MACHINE, "map.yaml")
    assert str(caught.value).startswith("map.yaml") and "\n" not in str(caught.value)
    for word in words:
        assert word in str(caught.value), caught.value


def test_a_table_of_the_machines_channels_passes_untouched() -> None:
    table = Table(SOUND, {"hilfit.units": "{}"}, "")
    assert in_channels(Path("r"), table, MACHINE) is table


def test_whole_nanoseconds_are_exact() -> None:
    begin = 1_767_312_000_123_456_789
    stamps = begin + 20_000_000 * np.arange(1000, dtype=np.int64)
    assert np.array_equal(seconds(stamps, None), np.arange(1000) * 20_000_000 * 1e-9)


def matlab(path: Path, content: dict[str, Any]) -> Path:
    savemat(path, content)
    return path


@pytest.mark.slow
def test_mat_files_are_read(tmp_path: Path) -> None:
    names = {name.replace(".", "_"): values[:, None] for name, values in SOUND.items()}
    same(matlab(tmp_path / "flat.mat", names | {"fs": 50.0, "note": "bench"}))
    inside = {"data": {"t": SOUND["time"], "p": np.stack([SOUND["j1.head"], SOUND["j1.rod"]], axis=1)}}
    rest = {name.replace(".", "_"): SOUND[name] for name in ("j1.angle", "j1.piston", "oil")}
    chosen = parse_map("time: data.t\nj1.head: 'data.p(:,1)'\nj1.rod: 'data.p(:,2)'\n", MACHINE)
    same(matlab(tmp_path / "deep.mat", inside | rest), columns=chosen)
    refused(matlab(tmp_path / "short.mat", names | {"oil": SOUND["oil"][:9]}), "differ in length")
    refused(matlab(tmp_path / "other.mat", {"a": SOUND["time"]}), "no channel", "--map")
    new = tmp_path / "new.mat"
    new.write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512, b" "))
    refused(new, "7.3", "-v7")
    torn = tmp_path / "torn.mat"
    torn.write_bytes((tmp_path / "flat.mat").read_bytes()[:900])
    refused(torn, "damaged")


@pytest.mark.filterwarnings("ignore")  # asammdf's and its libraries' own
def test_mdf_files_are_read(tmp_path: Path) -> None:
    asammdf = pytest.importorskip("asammdf")

    def write(name: str, late: float) -> Path:
        with asammdf.MDF(version="4.10") as file:
            for number, (channel, unit) in enumerate(
                [("j1.angle", "deg"), ("j1.piston", "mm"), ("j1.head", "kPa"), ("j1.rod", "bar"), ("oil", "degC")]
            ):
                factor = 100.0 if unit == "kPa" else 1.0
                time = SOUND["time"] + late * number
                file.append(asammdf.Signal(factor * SOUND[channel], time, name=channel, unit=unit))
            file.append(asammdf.Signal(SOUND["oil"], SOUND["time"] + 0.003, name="cabin"))
            file.save(tmp_path / name, overwrite=True)
        return tmp_path / name

    same(write("r.mf4", 0.0))
    refused(write("late.mf4", 0.001), "other times", "--resample")
    read = read_recording(tmp_path / "late.mf4", MACHINE, "train", resample=True)
    assert "resampled" in read.notes[0]
    # Each channel was moved by whole milliseconds; on the common clock it is what it was then.
    expected = np.interp(read.time, SOUND["time"], np.deg2rad(SOUND["j1.angle"]))
    assert np.nanmax(np.abs(read.values["j1.angle"] - expected)) < 2e-4


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_ros_bags_are_read_by_a_map(tmp_path: Path) -> None:
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    typesys = pytest.importorskip("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    types = store.types
    state, number = types["sensor_msgs/msg/JointState"], types["std_msgs/msg/Float64"]
    header, stamp = types["std_msgs/msg/Header"], types["builtin_interfaces/msg/Time"]
    begin = 1_767_312_000_000_000_000
    bag = tmp_path / "bag"
    with rosbag2.Writer(bag, version=9) as writer:
        joints = writer.add_connection("/joint_states", state.__msgtype__, typestore=store)
        numbers = {
            name: writer.add_connection(f"/{name}", number.__msgtype__, typestore=store)
            for name in ("piston", "head", "rod", "oil")
        }
        for row, t in enumerate(SOUND["time"]):
            at = begin + round(1e9 * t)
            message = state(
                header=header(stamp=stamp(sec=at // 10**9, nanosec=at % 10**9), frame_id=""),
                name=["slew", "boom"],
                position=np.array([0.0, np.deg2rad(SOUND["j1.angle"][row])]),
                velocity=np.array([]),
                effort=np.array([]),
            )
            writer.write(joints, at + 700_000, store.serialize_cdr(message, state.__msgtype__))
            for name, connection in numbers.items():
                channel = name if name == "oil" else f"j1.{name}"
                value = number(data=float(SOUND[channel][row]))
                writer.write(connection, at, store.serialize_cdr(value, number.__msgtype__))
    chosen = parse_map(
        "j1.angle: {column: /joint_states/boom/position, unit: rad}\nj1.piston: /piston\nj1.head: /head\n"
        "j1.rod: /rod\noil: /oil\n",
        MACHINE,
    )
    same(bag, columns=chosen)
    refused(bag, "missing", "j1.angle")


def test_what_is_too_large_is_refused_before_it_is_unpacked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = matlab(tmp_path / "large.mat", {name.replace(".", "_"): values for name, values in SOUND.items()})
    text = put(tmp_path / "large.csv", text_of(SOUND, ";"))
    monkeypatch.setattr("daq.recordings.foreign_files.MAXIMUM_VALUES", 100)
    monkeypatch.setattr("daq.recordings.csv_files.MAXIMUM_TEXT", 100)
    refused(path, "100 values", "Parquet")
    refused(text, "GB", "Parquet")


@pytest.mark.slow
def test_damaged_containers_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(temporary))
    for name, content, word in (
        ("r.mf4", b"MDF     4.10    ".ljust(4096, b"\7"), "MDF"),
        ("r.db3", b"SQLite format 3\0".ljust(4096, b"\7"), "bag"),
        ("r.mcap", b"\x89MCAP0\r\n".ljust(4096, b"\7"), "bag"),
    ):
        path = tmp_path / name
        path.write_bytes(content)
        refused(path, word)
        assert not list(temporary.iterdir()), "a copy of a file that was not closed properly"


def command(*arguments: object) -> int:
    with pytest.raises(SystemExit) as caught:
        main([str(argument) for argument in arguments])
    return int(caught.value.code or 0)


def test_import_writes_a_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    machine = put(tmp_path / "machine.yaml", plain())
    path = put(tmp_path / "logger.csv", text_of(renamed(j1__head="p1"), ";", ","), "utf-16")
    written = put(tmp_path / "map.yaml", "j1.head: p1\n")
    output = tmp_path / "r.parquet"
    assert command("import", path, "--machine", machine, "-o", output) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1 and not output.exists()
    arguments = ("import", path, "--machine", machine, "--map", written, "--role", "validate", "--json")
    assert command(*arguments, "-o", output) == 0
    assert json.loads(capsys.readouterr().out) == {"file": str(output), "rows": 500, "notes": []}
    same(output)
    with pytest.raises(RecordingError, match="was recorded as 'validate'"):
        read_recording(output, MACHINE, "unloaded")
    assert command(*arguments, "-o", output) == 2  # it is there already


def foreign(tmp_path: Path) -> Path:
    """A log whose columns tell the time and one channel; the others have names of their own."""
    names = {"time": "t_ms", "j1.angle": "J1 Angle", "j1.piston": "pos", "j1.head": "p A [bar]", "j1.rod": "ai: 3"}
    columns: dict[str, Any] = {names[name]: values for name, values in SOUND.items() if name in names}
    columns["t_ms"] = 1e3 * np.asarray(columns["t_ms"])
    return put(tmp_path / "log.csv", text_of(columns))


def test_a_foreign_file_gets_a_draft_of_its_map_and_none_is_overwritten(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    machine = put(tmp_path / "bench.yaml", plain())
    log, output = foreign(tmp_path), tmp_path / "out.parquet"
    arguments = ["import", str(log), "--machine", str(machine), "-o", str(output)]
    for name in ("log.map.yaml", "log.map-2.yaml"):
        with pytest.raises(SystemExit) as ended:
            main(arguments)
        assert ended.value.code == 2
        said = capsys.readouterr().err
        assert "p A [bar]" in said and "--map" in said and str(tmp_path / name) in said.replace("\n", "")
        assert not output.exists()
    text = (tmp_path / "log.map.yaml").read_text()
    written = parse_map(text, MACHINE)
    assert {channel: source.column for channel, source in written.sources.items()} == {
        "time": "t_ms",
        "j1.angle": "J1 Angle",
    }
    # What is asked is a line that is right once its column is the right one.
    asked = "".join(
        line.removeprefix("# ").replace(re.findall(r'column: ("[^"]*")', line)[0], json.dumps(column)) + "\n"
        for line in text.splitlines()
        for name, column in {"j1.piston": "pos", "j1.head": "p A [bar]", "j1.rod": "ai: 3"}.items()
        if line.startswith(f"# {name}:")
    )
    filled = parse_map(text + asked, MACHINE)
    assert filled.sources["j1.rod"].column == "ai: 3" and len(filled.sources) == 5


@given(st.lists(st.text(min_size=1, max_size=12), min_size=1, max_size=6, unique=True))
def test_a_draft_is_yaml_whatever_columns_are_called(names: list[str]) -> None:
    text = draft(Path("log.csv"), ["time", *names], MACHINE)
    assert set(parse_map(text + "j1.rod: x\n", MACHINE).sources) >= {"j1.rod"} and text.count("\n") == 3 + 6


def test_channels_that_no_joint_needs_may_be_missing(tmp_path: Path) -> None:
    path = put(tmp_path / "r.csv", text_of({name: values for name, values in SOUND.items() if name != "oil"}))
    read = read_recording(path, MACHINE, "train")
    assert np.isnan(read.values["oil"]).all() and set(read.quality["oil"]) == {Quality.MISSING}
    assert any("oil" in note and "missing" in note for note in read.notes)
    refused(put(tmp_path / "no.csv", text_of({k: v for k, v in SOUND.items() if k != "j1.rod"})), "j1.rod")
