"""Recordings in other forms: what was in comes out, hostile files cost one line, statistics are right."""

from __future__ import annotations

import io
import json
import math
import os
import re
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from asammdf import MDF, Signal
from mcap.reader import make_reader
from service_fakes import API, MACHINE, Running, motion, recording_bytes

from daq import parse_machine, read_recording, write_recording
from daq.recordings.recording_files import Table, read_table
from server.platform.processes.file_children import FileChildren
from server.recordings.formats.conversion_child import statistics
from server.recordings.formats.exports import Exports


@pytest.fixture(scope="module")
def sealed(running: Running, tmp_path_factory: pytest.TempPathFactory) -> str:
    running.client.post(f"{API}/machines", content=MACHINE)
    content = recording_bytes(tmp_path_factory.mktemp("made"), suffix=".parquet")
    return running.upload(content, "train", "made.parquet")


def download(running: Running, id: str, format: str) -> bytes:
    response = running.client.get(f"{API}/recordings/{id}/data", params={"format": format})
    assert response.status_code == 200, response.text
    assert f"{id}." in response.headers["content-disposition"]
    return response.content


def table_of(content: bytes, suffix: str, directory: Path) -> Table:
    path = directory / f"got{suffix}"
    path.write_bytes(content)
    return read_table(path)


@pytest.mark.slow
def test_all_four_forms_hold_the_same_numbers(running: Running, sealed: str, tmp_path: Path) -> None:
    original = table_of(download(running, sealed, "parquet"), ".parquet", tmp_path)
    csv = table_of(download(running, sealed, "csv"), ".csv", tmp_path)
    for name, values in original.columns.items():
        np.testing.assert_array_equal(csv.columns[name], values)
    (tmp_path / "got.mf4").write_bytes(download(running, sealed, "mdf4"))
    with MDF(tmp_path / "got.mf4") as file:
        for name, values in original.columns.items():
            if name != "time":
                signal = file.get(name)
                np.testing.assert_array_equal(signal.samples, values)
                np.testing.assert_array_equal(signal.timestamps, original.columns["time"])
        assert file.get("joint1.angle").unit == "deg"
    reader = make_reader(io.BytesIO(download(running, sealed, "mcap")))
    rows = [json.loads(message.data) for _, channel, message in reader.iter_messages()]
    assert [row["joint1.torque"] for row in rows] == list(original.columns["joint1.torque"])
    assert {channel.topic for channel in reader.get_summary().channels.values()} == {"/hilfit/frame"}  # type: ignore[union-attr]


@pytest.mark.slow
def test_a_conversion_leaves_no_files_behind(running: Running, sealed: str) -> None:
    download(running, sealed, "mcap")
    assert not list(running.service.files.recordings.glob(".incoming-*"))


@pytest.mark.slow
def test_an_mdf_file_comes_back_as_the_recording_that_it_was(running: Running, sealed: str, tmp_path: Path) -> None:
    content = download(running, sealed, "mdf4")
    id = running.upload(content, "validate", "again.mf4")
    assert running.client.get(f"{API}/recordings/{id}").json()["format"] == "parquet"
    first = table_of(download(running, sealed, "parquet"), ".parquet", tmp_path)
    second = table_of(download(running, id, "parquet"), ".parquet", tmp_path)
    for name, values in first.columns.items():
        np.testing.assert_array_equal(second.columns[name], values)


@pytest.mark.slow
def test_units_of_an_mdf_file_count_and_other_channels_do_not(running: Running, tmp_path: Path) -> None:
    time, values = motion(10)
    with MDF(version="4.10") as file:
        file.append(
            [
                Signal(values["joint1.angle"], time, name="joint1.angle", unit="rad"),
                Signal(values["joint1.torque"] / 1e3, time, name="joint1.torque", unit="kN m"),
                Signal(np.ones_like(time), time, name="EngineSpeed", unit="rpm"),
            ],
            common_timebase=True,
        )
        file.save(tmp_path / "logger.mf4")
    id = running.upload((tmp_path / "logger.mf4").read_bytes(), "train", "logger.mf4")
    got = table_of(download(running, id, "parquet"), ".parquet", tmp_path)
    assert set(got.columns) == {"time", "joint1.angle", "joint1.torque"}
    found = running.client.get(f"{API}/recordings/{id}/statistics").json()["channels"]
    assert found["joint1.torque"]["maximum"] == pytest.approx(values["joint1.torque"].max())


def test_channels_on_different_times_are_refused(tmp_path: Path) -> None:
    time, values = motion(10)
    with MDF(version="4.10") as file:
        file.append([Signal(values["joint1.angle"], time, name="joint1.angle")])
        file.append([Signal(values["joint1.torque"][::2], time[::2], name="joint1.torque")])
        file.save(tmp_path / "two.mf4")
    with pytest.raises(Exception, match="other times"):
        read_recording(tmp_path / "two.mf4", parse_machine(MACHINE), "train")


@pytest.mark.slow
def test_a_loggers_file_is_taken_with_a_map_and_brought_to_the_machines_rate(
    running: Running, sealed: str, tmp_path: Path
) -> None:
    time = np.arange(4000) / 200.0
    angle, torque = np.sin(time), 80.0 * np.cos(1.7 * time)
    rows = "\n".join(f"{1e3 * t:.0f};{a:.9f};{b:.9f}" for t, a, b in zip(time, angle, torque, strict=True))
    content = f"t_ms;q [rad];M\n{rows}\n".replace(".", ",").encode("utf-16")
    asked = {"machine": "lever", "role": "train", "name": "logger.txt"}

    def send(**more: Any) -> Any:
        return running.client.post(f"{API}/recordings/upload", params={**asked, **more}, content=content)

    columns = "joint1.angle: q\njoint1.torque: {column: M, unit: N m}"
    for more, word in (
        ({}, "channels"),
        ({"columns": columns}, "--resample"),
        ({"columns": "[", "resample": 1}, "YAML"),
    ):
        response = send(**more)
        assert response.status_code == 422, response.text
        assert word in response.json()["detail"]
    response = send(columns=columns, resample=True)
    assert response.status_code == 201, response.text
    assert not list(running.service.files.recordings.glob(".incoming-*"))
    stored = tmp_path / "stored.parquet"
    stored.write_bytes(download(running, response.json()["id"], "parquet"))
    read = read_recording(stored, parse_machine(MACHINE), "train")
    assert np.max(np.abs(read.values["joint1.angle"] - np.sin(read.time))) < 1e-3
    assert len(read.notes) == 1 and read.notes[0].startswith("logger.txt: resampled from 200 Hz")


HOSTILE = {
    "nothing": b"",
    "noise": bytes(range(256)) * 40,
    "a magic and nothing else": b"MDF     4.10    " + b"\0" * 48,
    "a magic and wild offsets": b"MDF     4.10    " + b"\0" * 48 + b"##HD" + b"\xff" * 400,
    "another kind": b"PAR1" + b"\0" * 100 + b"PAR1",
}


@pytest.mark.slow
@pytest.mark.parametrize("content", HOSTILE.values(), ids=list(HOSTILE))
@pytest.mark.parametrize("name", ["x.mf4", "x.parquet", "x.csv"])
def test_a_hostile_upload_is_refused_with_one_line(running: Running, sealed: str, content: bytes, name: str) -> None:
    response = running.client.post(
        f"{API}/recordings/upload", params={"machine": "lever", "role": "train", "name": name}, content=content
    )
    assert response.status_code == 422, response.text
    detail = response.json()["detail"]
    assert name in detail
    assert "\n" not in detail
    assert str(running.service.files.root) not in detail
    assert not list(running.service.files.recordings.glob(".incoming-*"))


@pytest.mark.slow
def test_a_truncated_upload_is_refused_in_every_form(running: Running, sealed: str) -> None:
    for format, name in (("parquet", "x.parquet"), ("mdf4", "x.mf4")):
        content = download(running, sealed, format)
        response = running.client.post(
            f"{API}/recordings/upload",
            params={"machine": "lever", "role": "train", "name": name},
            content=content[: len(content) // 2],
        )
        assert response.status_code == 422, (format, response.text)


def test_statistics_against_numpy(tmp_path: Path) -> None:
    machine = parse_machine(MACHINE)
    time, values = motion(10)
    time = np.concatenate([time[:200], time[200:] + 0.5])
    values["joint1.torque"][[3, 4]] = np.nan
    quality = np.zeros(len(time), dtype=np.uint8)
    quality[[3, 4]] = 2
    path = write_recording(tmp_path / "a.parquet", machine, "train", time, values, quality={"joint1.torque": quality})
    found = statistics(read_table(path), machine)
    torque = found["channels"]["joint1.torque"]
    assert (found["rows"], found["gaps"]) == (500, 1)
    assert found["seconds"] == pytest.approx(time[-1])
    assert torque["mean"] == pytest.approx(np.nanmean(values["joint1.torque"]))
    assert torque["std"] == pytest.approx(np.nanstd(values["joint1.torque"]))
    assert (torque["missing"], torque["quality"]) == (2, {"fresh": 498, "missing": 2})
    assert found["channels"]["joint1.angle"]["maximum"] == pytest.approx(math.degrees(values["joint1.angle"].max()))


def test_a_channel_without_values_has_no_statistics() -> None:
    columns: dict[str, Any] = {"time": np.arange(3) / 50, "joint1.torque": np.full(3, np.nan)}
    found = statistics(Table(columns, {}, ""), parse_machine(MACHINE))
    assert found["channels"]["joint1.torque"]["mean"] is None
    assert "joint1.angle" not in found["channels"]


@pytest.mark.slow
def test_statistics_go_with_the_recording(running: Running, csv: bytes) -> None:
    running.client.post(f"{API}/machines", content=MACHINE)
    id = running.upload(csv, "train")
    assert running.client.get(f"{API}/recordings/{id}/statistics").json()["rows"] == 500
    kept = running.service[Exports].kept_statistics(id)
    assert kept.is_file()
    running.client.delete(f"{API}/recordings/{id}")
    assert not kept.exists()
    assert running.client.get(f"{API}/recordings/{id}/statistics").status_code == 404


@pytest.mark.slow
def test_a_missing_library_says_what_to_install(
    running: Running, sealed: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    blocked = tmp_path / "asammdf"
    blocked.mkdir()
    (blocked / "__init__.py").write_text("raise ModuleNotFoundError('no', name='asammdf')")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    children = FileChildren()  # that start now
    monkeypatch.setattr(running.service[Exports], "_children", children)
    response = running.client.get(f"{API}/recordings/{sealed}/data", params={"format": "mdf4"})
    children.close()
    assert response.status_code == 503
    assert "pip install 'hilfit[export]'" in response.json()["detail"]


@pytest.mark.slow
def test_parquet_from_elsewhere_is_read_without_our_metadata(running: Running, sealed: str) -> None:
    time, values = motion(10)
    buffer = io.BytesIO()
    table = pa.table({"time": time, **{name: np.asarray(column) for name, column in values.items()}})
    pa.parquet.write_table(table, buffer)
    id = running.upload(buffer.getvalue(), "train", "foreign.parquet")
    assert re.fullmatch(r"rec-[0-9a-f]{16}", id)
