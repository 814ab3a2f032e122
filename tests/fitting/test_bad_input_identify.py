"""``hilfit identify`` with bad input: exit code 2, one line that says where, and nothing written."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from synthetic_arm import make_recordings, planar_machine, truth

from daq.machine.machine_file import machine_to_yaml
from daq.recordings.recording import write_recording
from server.commands.command_line import main

ROLES = ("unloaded", "train", "repeat", "validate")


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A good machine file and good recordings, 15 s each, to be spoiled one by one; and another arm's."""
    directory = tmp_path_factory.mktemp("good")
    machine = planar_machine(2)
    (directory / "machine.yaml").write_text(machine_to_yaml(machine), encoding="utf-8")
    for recording in make_recordings(machine, truth(2), seconds=15.0):
        path = directory / f"{recording.role}.parquet"
        write_recording(path, machine, recording.role, recording.time, recording.values)
    other = planar_machine(1, name="another-arm")
    recording = make_recordings(other, truth(1), (("train", 9),), seconds=15.0)[0]
    write_recording(directory / "another.parquet", other, "train", recording.time, recording.values)
    one = make_recordings(machine, truth(2), (("train", 2),), seconds=15.0, moving=[1])[0]
    write_recording(directory / "one-joint.parquet", machine, "train", one.time, one.values)
    still = make_recordings(machine, truth(2), (("validate", 3),), seconds=15.0, moving=[])[0]
    write_recording(directory / "still.parquet", machine, "validate", still.time, still.values)
    return directory


@pytest.fixture
def arm(good: Path, tmp_path: Path) -> Path:
    """A copy that a test may spoil."""
    return Path(shutil.copytree(good, tmp_path / "arm"))


@dataclass(frozen=True)
class Outcome:
    code: int
    line: str


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Callable[[list[str]], Outcome]:
    """Run the command line in this process; its standard error has to be one line."""

    def call(arguments: list[str]) -> Outcome:
        with pytest.raises(SystemExit) as caught:
            main(arguments)
        written = capsys.readouterr()
        lines = written.err.splitlines()
        assert len(lines) == 1, written.err
        assert written.out == ""
        return Outcome(int(caught.value.code or 0), lines[0])

    return call


def command(arm: Path, **changed: str | None) -> list[str]:
    files = {role: f"{role}.parquet" for role in ROLES} | changed
    options = [part for role, name in files.items() if name is not None for part in (f"--{role}", str(arm / name))]
    return ["identify", str(arm / "machine.yaml"), *options, "-o", str(arm / "out"), "--json"]


def tree(directory: Path) -> dict[str, int]:
    return {str(p.relative_to(directory)): p.stat().st_mtime_ns for p in directory.rglob("*") if p.is_file()}


def columns(path: Path, change: Callable[[dict[str, np.ndarray]], None]) -> None:
    """Change a Parquet recording's columns and keep its metadata."""
    import pyarrow as pa

    table = pq.read_table(path)
    data = {name: table.column(name).to_numpy().copy() for name in table.column_names}
    change(data)
    pq.write_table(pa.table(data).replace_schema_metadata(table.schema.metadata), path)


def _edit(old: str, new: str) -> Callable[[Path], None]:
    def edit(arm: Path) -> None:
        path = arm / "machine.yaml"
        text = path.read_text(encoding="utf-8")
        assert old in text
        path.write_text(text.replace(old, new, 1), encoding="utf-8")

    return edit


def _spoil(change: Callable[[dict[str, np.ndarray]], None], name: str = "train.parquet") -> Callable[[Path], None]:
    return lambda arm: columns(arm / name, change)


def _swap_time(data: dict[str, np.ndarray]) -> None:
    data["time"][[300, 301]] = data["time"][[301, 300]]


def _nan_run(data: dict[str, np.ndarray]) -> None:
    data["joint2.head"][400:420] = np.nan


def _dead_sensor(data: dict[str, np.ndarray]) -> None:
    data["joint1.rod"][:] = 5e5


def _extra(data: dict[str, np.ndarray]) -> None:
    data["joint9.q"] = data["joint1.q"]


def _missing(data: dict[str, np.ndarray]) -> None:
    del data["joint2.rod"]


def _short(data: dict[str, np.ndarray]) -> None:
    for name in data:
        data[name] = data[name][:60]


def _empty(data: dict[str, np.ndarray]) -> None:
    for name in data:
        data[name] = data[name][:0]


def _truncate(arm: Path) -> None:
    path = arm / "train.parquet"
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def _text(arm: Path) -> None:
    (arm / "train.parquet").write_text("dear diary,\nnothing was recorded today\n", encoding="utf-8")


#: What is spoiled, and what the line has to name.
BAD = {
    "an unknown key in the machine file": (_edit("rate_hz:", "rate_hertz:"), ["machine.yaml", "rate_hertz"]),
    "a wrong unit": (_edit("unit: Pa", "unit: kg"), ["machine.yaml", "joint1.head", "kg"]),
    "a machine file that is no YAML": (_edit("schema:", "schema: [:"), ["machine.yaml", "YAML"]),
    "a machine file that is not there": (lambda arm: (arm / "machine.yaml").unlink(), ["machine.yaml", "no such file"]),
    "a recording that is not there": (lambda arm: (arm / "train.parquet").unlink(), ["train.parquet"]),
    "text instead of Parquet": (_text, ["train.parquet"]),
    "truncated Parquet": (_truncate, ["train.parquet"]),
    "a channel missing": (_spoil(_missing), ["train.parquet", "joint2.rod"]),
    "a channel too many": (_spoil(_extra), ["train.parquet", "joint9.q"]),
    "time that runs backwards": (_spoil(_swap_time), ["train.parquet", "time", "row"]),
    "a run of NaN": (_spoil(_nan_run), ["train.parquet", "joint2.head", "401"]),
    "a sensor that stands still": (_spoil(_dead_sensor), ["train.parquet", "joint1.rod", "constant"]),
    "a recording too short": (_spoil(_short), ["train.parquet", "no stretch of"]),
    "a recording without rows": (_spoil(_empty), ["train.parquet"]),
    "a bad repeat": (_spoil(_missing, "repeat.parquet"), ["repeat.parquet", "joint2.rod"]),
    "a bad validation": (_spoil(_nan_run, "validate.parquet"), ["validate.parquet", "joint2.head"]),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_one_line_and_nothing_is_written(
    name: str, arm: Path, run: Callable[[list[str]], Outcome]
) -> None:
    spoil, words = BAD[name]
    spoil(arm)
    before = tree(arm)
    outcome = run(command(arm))
    assert outcome.code == 2
    assert all(word in outcome.line for word in words), outcome.line
    assert tree(arm) == before and not (arm / "out").exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"train": None}, ["--train"]),
        ({"validate": None}, ["--validate"]),
        ({"train": "another.parquet"}, ["another.parquet", "another-arm", "test-arm"]),
        ({"train": "unloaded.parquet"}, ["unloaded.parquet", "unloaded", "train"]),
        ({"unloaded": "train.parquet"}, ["train.parquet", "unloaded"]),
        ({"validate": "copy.parquet"}, ["copy.parquet", "train.parquet", "another motion"]),
        ({"validate": "still.parquet"}, ["still.parquet", "no joint moves", "nothing can be judged"]),
        ({"train": "one-joint.parquet", "repeat": None}, ["one-joint.parquet", "ZZ1", "hilfit excite"]),
    ],
)
def test_recordings_in_the_wrong_place_are_one_line(
    changed: dict[str, str | None], words: list[str], arm: Path, run: Callable[[list[str]], Outcome]
) -> None:
    shutil.copy(arm / "train.parquet", arm / "copy.parquet")
    outcome = run(command(arm, **changed))
    assert outcome.code == 2
    assert all(word in outcome.line for word in words), outcome.line
    assert not (arm / "out").exists()


@pytest.mark.slow
@pytest.mark.parametrize("bandwidth", ["0", "-3", "40", "1e-9"])
def test_an_impossible_bandwidth_is_one_line(bandwidth: str, arm: Path, run: Callable[[list[str]], Outcome]) -> None:
    outcome = run([*command(arm), "--bandwidth", bandwidth])
    assert outcome.code == 2 and "bandwidth" in outcome.line and "a fifth of the rate" in outcome.line
    assert not (arm / "out").exists()


def test_a_file_where_the_report_should_go_is_left_alone(arm: Path, run: Callable[[list[str]], Outcome]) -> None:
    (arm / "out").write_text("mine", encoding="utf-8")
    outcome = run(command(arm))
    assert outcome.code == 2 and "out" in outcome.line and "-o" in outcome.line
    assert (arm / "out").read_text(encoding="utf-8") == "mine"


def test_an_unknown_effect_is_one_line(run: Callable[[list[str]], Outcome]) -> None:
    outcome = run(["effects", "show", "magic"])
    assert outcome.code == 2 and "magic" in outcome.line and "hilfit effects list" in outcome.line
