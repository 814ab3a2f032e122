"""Recordings: what is written is read back; what cannot be used is refused in one line: where, and what to do."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from bench_machines import plain
from hypothesis import given, settings
from hypothesis import strategies as st
from sound_recordings import RATE, ROWS, Columns, motion

from daq import Machine, Quality, RecordingError, load_machine, parse_machine, read_recording, write_recording
from daq.recordings.recording_checks import not_saturated
from daq.recordings.recording_files import read_table

MACHINE = parse_machine(plain())
NAMES = [channel.name for channel in MACHINE.channels]
SAMPLES = Path(__file__).parents[2].parent / "shared" / "samples"


def save(path: Path, columns: Columns, metadata: dict[str, str] | None = None) -> Path:
    if path.suffix == ".csv":
        lines = [",".join(columns)]
        lines += [",".join(repr(float(v)) for v in row) for row in zip(*columns.values(), strict=True)]
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    else:
        pq.write_table(pa.table(columns).replace_schema_metadata(metadata), path)
    return path


def refuse(path: Path, *words: str, role: str = "train", machine: Machine = MACHINE) -> str:
    """The one line with which a recording is refused; it names the file and all ``words``."""
    with pytest.raises(RecordingError) as caught:
        read_recording(path, machine, role)
    text = str(caught.value)
    assert "\n" not in text
    assert text.startswith(str(path))
    for word in words:
        assert word in text, text
    assert any(sign in text for sign in (";", "use ", "needed")), f"says what to do: {text}"
    return text


@given(
    kind=st.sampled_from(["int8", "int64", "uint64", "float16", "float32", "float64", "null"]),
    nulls=st.booleans(),
    rows=st.lists(st.integers(0, 20), max_size=3),
)
@settings(max_examples=60)
def test_numbers_of_every_kind_are_read_as_arrow_has_them(
    tmp_path_factory: pytest.TempPathFactory, kind: str, nulls: bool, rows: list[int]
) -> None:
    """With gaps or without, in any number of groups of rows."""
    of_kind, path = (
        pa.null() if kind == "null" else pa.type_for_alias(kind),
        tmp_path_factory.mktemp("kinds") / "a.parquet",
    )
    groups = [[None if kind == "null" or (nulls and row % 3 == 1) else row for row in range(n)] for n in rows]
    with pq.ParquetWriter(path, pa.schema([("a", of_kind)])) as writer:
        for group in groups:
            writer.write_table(pa.table({"a": pa.array(group, type=of_kind)}))
    values = [value for group in groups for value in group]
    found = read_table(path).columns["a"]
    assert found.flags.writeable and len(found) == len(values)
    assert found.dtype == (np.int64 if "int" in kind and None not in values else np.float64)
    np.testing.assert_array_equal(found, np.array([np.nan if value is None else value for value in values]))


@pytest.mark.parametrize("suffix", [".parquet", ".csv"])
def test_a_foreign_recording_is_read_in_si(tmp_path: Path, suffix: str) -> None:
    columns = motion()
    recording = read_recording(save(tmp_path / f"r{suffix}", columns), MACHINE, "train")
    assert recording.machine == "bench"
    assert recording.role == "train"
    assert recording.rate_hz == RATE
    assert recording.duration == pytest.approx(10.0)
    assert len(recording.sha256) == 64
    np.testing.assert_allclose(recording.values["j1.angle"], np.deg2rad(columns["j1.angle"]), rtol=1e-12)
    np.testing.assert_allclose(recording.values["j1.piston"], 1e-3 * columns["j1.piston"], rtol=1e-12)
    np.testing.assert_allclose(recording.values["j1.head"], 1e5 * columns["j1.head"], rtol=1e-12)
    np.testing.assert_allclose(recording.values["oil"], 273.15 + 45.0, rtol=1e-12)
    assert recording.segments() == (slice(0, ROWS),)
    assert recording.cycle is None and recording.utc_ns is None
    with pytest.raises(ValueError, match="read-only"):
        recording.values["j1.head"][0] = 0.0


def test_a_recording_can_be_sent_to_another_process(tmp_path: Path) -> None:
    recording = read_recording(save(tmp_path / "r.parquet", motion()), MACHINE, "train")
    copy = pickle.loads(pickle.dumps(recording))
    np.testing.assert_array_equal(copy.values["j1.rod"], recording.values["j1.rod"])


@given(data=st.data(), suffix=st.sampled_from([".parquet", ".csv"]))
@settings(max_examples=12, deadline=None)
def test_what_is_written_is_read_back(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject, suffix: str
) -> None:
    path = tmp_path_factory.mktemp("round") / f"r{suffix}"
    columns = motion()
    conversions = {channel.name: MACHINE.conversion(channel) for channel in MACHINE.channels}
    values = {name: conversions[name].to_si(columns[name]) for name in NAMES}
    start = data.draw(st.integers(0, 2**40))
    quality = {name: np.zeros(ROWS, dtype=np.uint8) for name in NAMES}
    gaps = data.draw(st.lists(st.tuples(st.sampled_from(NAMES), st.integers(0, ROWS - 1)), max_size=20))
    for name, row in gaps:
        quality[name][row] = Quality.MISSING
        values[name][row] = np.nan
    age = {name: np.where(quality[name] == 0, 0.0, np.nan) for name in NAMES}
    cycle = start + np.arange(ROWS)
    utc = 1_700_000_000_000_000_000 + 20_000_000 * np.arange(ROWS)  # not representable as float64
    write_recording(path, MACHINE, "train", columns["time"], values, cycle=cycle, utc_ns=utc, age=age, quality=quality)
    recording = read_recording(path, MACHINE, "train", minimum_seconds=5)
    for name in NAMES:
        np.testing.assert_allclose(recording.values[name], values[name], rtol=1e-12, atol=1e-9)
        np.testing.assert_array_equal(recording.quality[name], quality[name])
        np.testing.assert_array_equal(recording.age[name], age[name])
    assert recording.cycle is not None and recording.utc_ns is not None
    np.testing.assert_array_equal(recording.cycle, cycle)
    np.testing.assert_array_equal(recording.utc_ns, utc)
    covered = np.zeros(ROWS, dtype=bool)
    for segment in recording.segments():
        covered[segment] = True
    missing = np.any([quality[name] != 0 for name in NAMES], axis=0)
    np.testing.assert_array_equal(covered, ~missing)


def test_metadata_says_what_the_recording_is(tmp_path: Path) -> None:
    columns = motion()
    values = {c.name: MACHINE.conversion(c).to_si(columns[c.name]) for c in MACHINE.channels}
    path = write_recording(tmp_path / "r.parquet", MACHINE, "repeat", columns["time"], values)
    metadata = pq.read_schema(path).metadata
    assert metadata[b"hilfit.schema"] == b"hilfit/recording/1"
    assert metadata[b"hilfit.machine"] == b"bench"
    assert metadata[b"hilfit.role"] == b"repeat"
    assert metadata[b"hilfit.rate_hz"] == b"50.0"
    assert b'"j1.head": "bar"' in metadata[b"hilfit.units"]


def test_the_files_own_units_count_when_the_machine_file_changed_since(tmp_path: Path) -> None:
    columns = motion()
    values = {c.name: MACHINE.conversion(c).to_si(columns[c.name]) for c in MACHINE.channels}
    path = write_recording(tmp_path / "r.parquet", MACHINE, "train", columns["time"], values)
    changed = parse_machine(plain().replace("unit: bar}", "unit: Pa}"))
    recording = read_recording(path, changed, "train")
    np.testing.assert_allclose(recording.values["j1.rod"], values["j1.rod"], rtol=1e-12)


def test_writing_is_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "r.parquet"
    path.write_bytes(b"old")

    def torn(table: object, where: Path, **_: object) -> None:
        Path(where).write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("pyarrow.parquet.write_table", torn)
    columns = motion()
    with pytest.raises(RecordingError, match="No space left"):
        write_recording(path, MACHINE, "train", columns["time"], {name: columns[name] for name in NAMES})
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_segments_end_at_gaps_of_time_and_of_the_counter(tmp_path: Path) -> None:
    columns = motion(600)
    keep = np.r_[0:200, 210:600]  # ten rows lost without a trace
    recording = read_recording(save(tmp_path / "r.csv", {k: v[keep] for k, v in columns.items()}), MACHINE, "train")
    assert recording.segments() == (slice(0, 200), slice(200, 590))
    assert recording.segments(["j1.head"]) == (slice(0, 200), slice(200, 590))
    cycle = np.arange(600)
    cycle[300:] += 5
    values = {c.name: MACHINE.conversion(c).to_si(columns[c.name]) for c in MACHINE.channels}
    path = write_recording(tmp_path / "c.parquet", MACHINE, "train", columns["time"], values, cycle=cycle)
    assert read_recording(path, MACHINE, "train").segments() == (slice(0, 300), slice(300, 600))


def test_values_that_were_not_measured_in_their_cycle_are_not_used(tmp_path: Path) -> None:
    columns = motion()
    flags = np.zeros(ROWS)
    for row, quality in ((10, Quality.STALE), (20, Quality.LATE), (30, Quality.EMERGENCY), (40, Quality.OUT_OF_RANGE)):
        flags[row] = quality
    columns["j1.rod.quality"] = flags
    recording = read_recording(save(tmp_path / "r.parquet", columns), MACHINE, "train")
    assert np.flatnonzero(np.isnan(recording.values["j1.rod"])).tolist() == [10, 20, 30]


Change = Callable[[Columns], object]


def put(column: str, rows: slice, value: float) -> Change:
    return lambda columns: columns[column].__setitem__(rows, value)


BAD: dict[str, tuple[Change, tuple[str, ...]]] = {
    "missing channel": (lambda c: c.pop("j1.rod"), ("j1.rod", "missing")),
    "extra channel": (lambda c: c.update(bonus=c["time"]), ("bonus", "no such channel")),
    "misspelt channel": (lambda c: c.update({"j1.rodd": c.pop("j1.rod")}), ("j1.rod", "there is 'j1.rodd'")),
    "no time": (lambda c: c.pop("time"), ("time",)),
    "time named otherwise": (lambda c: c.update(tim=c.pop("time")), ("there is 'tim'",)),
    "time going back": (put("time", slice(100, 101), 1.0), ("time", "row 101", "1 s after 1.98 s")),
    "time standing still": (put("time", slice(7, 8), 0.12), ("time", "row 8")),
    "time not a number": (put("time", slice(3, 4), np.nan), ("time", "row 4")),
    "another rate": (lambda c: c.update(time=c["time"] / 2), ("100 Hz", "rate_hz 50")),
    "many lost rows": (
        lambda c: c.update({k: np.delete(v, np.arange(5, ROWS, 4)) for k, v in c.items()}),
        ("124 of", "after row 5", "0.08 s to 0.1"),
    ),
    "NaN run": (put("j1.head", slice(50, 70), np.nan), ("j1.head", "20 rows", "rows 51 to 70", "1 to 1.38 s")),
    "NaN in a channel of the machine": (put("oil", slice(5, 6), np.nan), ("oil", "rows 6 to 6")),
    "infinite": (put("j1.rod", slice(50, 51), np.inf), ("j1.rod", "row 51")),
    "constant angle": (put("j1.angle", slice(None), 1.0), ("j1.angle", "constant (1 deg)")),
    "constant piston": (put("j1.piston", slice(None), 120.0), ("j1.piston", "constant")),
    "constant pressure": (put("j1.head", slice(None), 30.0), ("j1.head", "constant (30 bar)")),
    "saturated at its range": (put("j1.head", slice(60, 63), 250.0), ("j1.head", "saturated", "rows 61 to 63")),
    "saturated below its range": (put("j1.head", slice(60, 64), -2.0), ("j1.head", "saturated", "rows 61 to 64")),
    "saturated without a range": (
        lambda c: c.update({"j1.rod": np.minimum(c["j1.rod"], 38.0)}),
        ("j1.rod", "saturated"),
    ),
    "saturated for a moment": (put("j1.rod", slice(100, 108), 41.0), ("j1.rod", "saturated", "rows 101 to 108")),
    "another machine of the same channels": (
        lambda c: c.update({"j1.piston": 200 - c["j1.piston"] / 2}),
        ("j1.piston", "linkage"),
    ),
    "metres for millimetres": (lambda c: c.update({"j1.piston": 1e3 * c["j1.piston"]}), ("j1.piston", "unit")),
    "too short": (lambda c: c.update({k: v[:49] for k, v in c.items()}), ("49 rows", "at least 1 s")),
    "no rows": (lambda c: c.update({k: v[:0] for k, v in c.items()}), ("no rows",)),
}


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".parquet", ".csv"])
@pytest.mark.parametrize("kind", list(BAD))
def test_bad_content_is_refused(tmp_path: Path, kind: str, suffix: str) -> None:
    change, words = BAD[kind]
    columns = motion()
    change(columns)
    refuse(save(tmp_path / f"bad{suffix}", columns), *words)


def test_bad_files_are_refused(tmp_path: Path) -> None:
    refuse(tmp_path / "absent.parquet", "no such file")
    refuse(tmp_path, "directory")
    empty = tmp_path / "empty.csv"
    empty.touch()
    refuse(empty, "empty")
    text = tmp_path / "notes.txt"
    text.write_text("dear diary\ntoday we measured a lot\n")
    refuse(text, "not a table")
    program = tmp_path / "motion.csv"
    program.write_text("# hilfit/motion/1 machine=bench rods=pinned\ntime,j1\n0,0\n")
    refuse(program, "is a motion file, not a recording")
    picture = tmp_path / "picture.csv"
    picture.write_bytes(bytes(range(256)))
    refuse(picture, "not a table")
    misnamed = tmp_path / "misnamed.parquet"
    misnamed.write_text("time,j1.angle\n0,0\n")
    refuse(misnamed, "not a Parquet file")
    journal = tmp_path / "r.parquet.journal"
    with pa.ipc.new_stream(journal, pa.schema([("time", pa.float64())])):
        pass
    refuse(journal, "hilfit recover")
    sound = save(tmp_path / "sound.parquet", motion()).read_bytes()
    for cut in (5, len(sound) // 2, len(sound) - 3):
        torn = tmp_path / f"torn{cut}.parquet"
        torn.write_bytes(sound[:cut])
        refuse(torn, "cut short or damaged")


def test_broken_rows_of_csv_are_named(tmp_path: Path) -> None:
    path = save(tmp_path / "r.csv", motion())
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:50], "0.98,1,2", *lines[51:]]))
    refuse(path, "6 columns in the header, 3")
    path.write_text("\n".join([*lines[:50], "0.98,1,2,n/a?,4,5", *lines[51:]]))
    refuse(path, "j1.head", "'n/a?'")
    path.write_text("\n".join(lines[1:]))
    refuse(path, "header")
    path.write_text("\n".join([lines[0].replace("j1.rod", "j1.head"), *lines[1:]]))
    refuse(path, "j1.head", "2 times")


def test_columns_that_are_not_numbers_are_named(tmp_path: Path) -> None:
    columns = motion()
    path = tmp_path / "r.parquet"
    pq.write_table(pa.table({**columns, "j1.rod": [f"{v}" for v in columns["j1.rod"]]}), path)
    refuse(path, "j1.rod", "string")


def test_another_machines_recording_is_named(tmp_path: Path) -> None:
    columns = motion()
    other = {name.replace("j1", "boom"): values for name, values in columns.items()}
    refuse(save(tmp_path / "other.csv", other), "boom.angle", "j1.angle", "--map")
    ours = {"hilfit.schema": "hilfit/recording/1"}
    refuse(save(tmp_path / "other.parquet", other, ours), "another machine's channels", "boom.angle", "j1.angle")
    metadata = {"hilfit.schema": "hilfit/recording/1", "hilfit.machine": "crane"}
    refuse(save(tmp_path / "crane.parquet", columns, metadata), "'crane'", "'bench'")


def test_metadata_that_does_not_fit_is_refused(tmp_path: Path) -> None:
    ours = {"hilfit.schema": "hilfit/recording/1", "hilfit.machine": "bench"}
    path = tmp_path / "r.parquet"
    refuse(save(path, motion(), {"hilfit.schema": "hilfit/recording/9"}), "hilfit/recording/9")
    refuse(save(path, motion(), {**ours, "hilfit.role": "unloaded"}), "'unloaded'", "'train'")
    refuse(save(path, motion(), {**ours, "hilfit.units": "{"}), "hilfit.units")
    refuse(save(path, motion(), {**ours, "hilfit.units": '{"j1.rod": "kg"}'}), "j1.rod", "kg")
    assert len(read_recording(save(path, motion(), {**ours, "hilfit.role": "train"}), MACHINE, "validate")) == ROWS


def test_a_cycle_counter_that_goes_back_is_refused(tmp_path: Path) -> None:
    columns = motion()
    columns["cycle"] = np.arange(ROWS)
    columns["cycle"][250:] -= 100
    refuse(save(tmp_path / "r.parquet", columns), "cycle", "row 251")


def test_a_channel_that_was_silent_too_long_is_named(tmp_path: Path) -> None:
    columns = motion()
    flags = np.zeros(ROWS)
    flags[40:] = Quality.MISSING
    columns["j1.rod"][40:] = np.nan
    columns["j1.rod.quality"] = flags
    refuse(save(tmp_path / "r.parquet", columns), "j1.rod", "0.8 s", "at least 1 s")


def test_unloaded_arms_are_parked_but_their_cylinders_are_not_dead(tmp_path: Path) -> None:
    columns = motion()
    path = tmp_path / "unloaded.parquet"
    columns["j1.angle"][:] = 0.0
    assert len(read_recording(save(path, columns), MACHINE, "unloaded")) == ROWS
    # A cylinder that is not moved: encoder at rest, pressures only noisy.
    rng = np.random.default_rng(2)
    parked = {**columns, "j1.piston": np.full(ROWS, 120.0)}
    parked["j1.head"] = 30 + 0.1 * rng.standard_normal(ROWS)
    parked["j1.rod"] = 20 + 0.1 * rng.standard_normal(ROWS)
    assert len(read_recording(save(path, parked), MACHINE, "unloaded")) == ROWS
    # The same encoder while the pressures say that the cylinder moves: it is dead.
    refuse(save(path, {**columns, "j1.piston": np.full(ROWS, 120.0)}), "j1.piston", "constant", role="unloaded")
    refuse(save(path, {**parked, "j1.rod": np.full(ROWS, 20.0)}), "j1.rod", "constant", role="unloaded")


def test_in_operation_a_joint_may_be_parked(tmp_path: Path) -> None:
    columns = motion()
    columns["j1.angle"][:], columns["j1.piston"][:] = 0.0, 120.0
    path = save(tmp_path / "r.parquet", columns)
    assert len(read_recording(path, MACHINE, "operation")) == ROWS
    refuse(path, "j1.angle", "constant", role="validate")


def test_coarse_sensors_are_not_taken_for_saturated(tmp_path: Path) -> None:
    columns = motion()
    columns["j1.rod"] = np.round(columns["j1.rod"] / 2) * 2  # a resolution of 2 bar: 11 levels
    assert len(read_recording(save(tmp_path / "r.parquet", columns), MACHINE, "train")) == ROWS


def test_a_fine_sensor_that_rests_at_its_extreme_is_not_saturated(tmp_path: Path) -> None:
    """Noise of a third of its step: where the pressure rests for a quarter of a second, so do its values."""
    columns = motion()
    step = 0.02
    noise = np.random.default_rng(5).normal(0.0, step / 3, ROWS)
    columns["j1.rod"] = 30 + 3 * np.cos(np.arange(ROWS) / 9) + noise
    lowest = int(np.argmin(columns["j1.rod"]))
    columns["j1.rod"][lowest : lowest + 12] = columns["j1.rod"].min() - 5 * step
    columns["j1.rod"] = step * np.round(columns["j1.rod"] / step)
    assert len(read_recording(save(tmp_path / "r.parquet", columns), MACHINE, "operation")) == ROWS


def test_a_sensor_is_not_saturated_where_it_repeats_the_values_beside_its_extreme_too(tmp_path: Path) -> None:
    """A motion that shakes it everywhere but near its end, where it rests on few of its levels."""
    columns, step = motion(), 0.02
    rng = np.random.default_rng(6)
    pressure = 30 + 3 * np.cos(np.arange(ROWS) / 90) + rng.normal(0.0, 5 * step, ROWS)
    lowest = int(np.argmin(pressure[30:-60])) + 30
    rest = pressure.min() - 5 * step + step * np.repeat(rng.integers(0, 2, 16), 3)
    rest[20:30] = rest.min()
    pressure[lowest : lowest + len(rest)] = rest
    columns["j1.rod"] = step * np.round(pressure / step)
    assert len(read_recording(save(tmp_path / "r.parquet", columns), MACHINE, "operation")) == ROWS
    columns["j1.rod"] = np.maximum(columns["j1.rod"], np.quantile(columns["j1.rod"], 0.1))
    refuse(save(tmp_path / "r.parquet", columns), "j1.rod", "saturated", role="operation")


def test_a_pump_at_rest_on_two_levels_of_its_transducer_is_not_saturated() -> None:
    """A load-sensing pump stands by at its lowest pressure for most of the time; a step or two is all of its noise."""
    rng, step, row = np.random.default_rng(8), 0.002, np.arange(3000)
    pressures = [own for own in MACHINE.channels if own.quantity == "head_pressure"]
    channel = pressures[0].model_copy(update={"range": None})
    pressure = np.where(row % 600 < 400, 25.0, 25.0 + 60.0 * np.sin(row / 40.0) ** 4)
    shown = step * np.round((pressure + rng.normal(0.0, 0.4 * step, len(row))) / step)
    shown = np.maximum(shown, 25.0 - step)
    assert np.count_nonzero(shown == shown.min()) > 100
    not_saturated(Path("r.parquet"), channel, MACHINE, shown, row / RATE)
    with pytest.raises(RecordingError, match="saturated"):  # the same, of a transducer that shows nothing below
        not_saturated(Path("r.parquet"), channel, MACHINE, np.maximum(shown, 25.0), row / RATE)


def test_roles_and_kinds_of_file_are_checked(tmp_path: Path) -> None:
    columns = motion()
    values = {name: columns[name] for name in NAMES}
    with pytest.raises(RecordingError, match="role 'test' is unknown"):
        read_recording(save(tmp_path / "r.csv", columns), MACHINE, "test")
    with pytest.raises(RecordingError, match="unknown kind of file"):
        write_recording(tmp_path / "r.xlsx", MACHINE, "train", columns["time"], values)
    with pytest.raises(RecordingError, match=r"j1\.rod: no values"):
        write_recording(
            tmp_path / "r.csv", MACHINE, "train", columns["time"], {k: v for k, v in values.items() if k != "j1.rod"}
        )
    with pytest.raises(RecordingError, match="no such channel"):
        write_recording(tmp_path / "r.csv", MACHINE, "train", columns["time"], {**values, "x": columns["time"]})
    with pytest.raises(RecordingError, match=r"j1\.rod: has shape"):
        write_recording(tmp_path / "r.csv", MACHINE, "train", columns["time"], {**values, "j1.rod": np.zeros(3)})


@pytest.mark.slow
def test_every_sample_recording_is_accepted() -> None:
    files = sorted(SAMPLES.glob("*/*.parquet"))
    if not files:
        pytest.skip("shared/samples is not beside the repository")
    for file in files:
        machine = load_machine(file.parent / "machine.yaml")
        recording = read_recording(file, machine, file.stem.split("-")[0])
        assert recording.segments() == (slice(0, 3000),)
