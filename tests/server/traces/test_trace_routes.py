"""A recording is looked at over REST: signals, spectrum, remarks, a part of it."""

from __future__ import annotations

import io
import time

import numpy as np
import pyarrow.parquet
import pytest
from acquired_machines import acquire
from scipy import signal
from service_fakes import API, MACHINE, Running, motion, recording_bytes

from server.platform.processes.file_children import FileChildren

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def recording(running: Running, tmp_path_factory: pytest.TempPathFactory) -> str:
    running.client.post(f"{API}/machines", content=MACHINE)
    content = recording_bytes(tmp_path_factory.mktemp("made"), "train", ".parquet", 20)
    return running.upload(content, "train", "made.parquet")


def test_signals_of_a_recording_are_rows_where_they_fit_and_extremes_where_not(
    running: Running, recording: str
) -> None:
    times, values = motion(20)
    url = f"{API}/recordings/{recording}/signals"
    rows = running.client.get(url, params={"start": 5, "end": 6, "channel": "joint1.torque"}).json()
    inside = (times >= 5) & (times <= 6)
    assert rows["moment_s"] == 0 and list(rows["channels"]) == ["joint1.torque"]
    assert np.allclose(rows["time"], times[inside])
    assert rows["channels"]["joint1.torque"]["high"] is None
    assert np.allclose(rows["channels"]["joint1.torque"]["low"], values["joint1.torque"][inside], rtol=1e-6)
    whole = running.client.get(url, params={"moments": 100}).json()
    assert len(whole["time"]) <= 101
    angle = whole["channels"]["joint1.angle"]
    assert angle["unit"] == "deg"
    assert max(angle["high"]) == pytest.approx(np.rad2deg(values["joint1.angle"].max()), rel=1e-6)
    assert min(angle["low"]) == pytest.approx(np.rad2deg(values["joint1.angle"].min()), rel=1e-6)
    refused = running.client.get(url, params={"channel": "joint9.angle"})
    assert refused.status_code == 422 and "channel 'joint9.angle'" in refused.json()["detail"]


def test_the_spectrum_has_the_power_of_the_signal_and_its_frequency(running: Running, recording: str) -> None:
    _, values = motion(20)
    found = running.client.get(f"{API}/recordings/{recording}/spectrum", params={"channel": "joint1.angle"}).json()
    frequency, density = signal.periodogram(np.rad2deg(values["joint1.angle"]), 50)
    assert found["seconds"] == pytest.approx(20)
    assert found["frequency"][np.argmax(found["density"])] == pytest.approx(frequency[np.argmax(density)], abs=0.2)
    step = found["frequency"][1] - found["frequency"][0]
    # Parseval: away from the motion's own frequency the two have the same power.
    assert np.sum(found["density"][20:]) * step == pytest.approx(
        np.sum(density[frequency >= found["frequency"][20]]) * frequency[1], rel=0.3
    )


def test_remarks_are_what_the_checks_find_and_a_part_is_a_recording_of_its_own(
    running: Running, recording: str
) -> None:
    remarks = running.client.get(f"{API}/recordings/{recording}/remarks").json()
    given = running.client.get(f"{API}/recordings/{recording}").json()["statistics"]["findings"]
    assert remarks["findings"] == given and remarks["events"] == []
    made = running.client.post(f"{API}/recordings/{recording}/cut", json={"start": 4, "end": 16, "label": "the middle"})
    assert made.status_code == 201, made.text
    row = made.json()
    assert (row["label"], row["role"], row["statistics"]["rows"]) == ("the middle", "train", 600)
    times, values = motion(20)
    table = pyarrow.parquet.read_table(io.BytesIO(running.client.get(f"{API}/recordings/{row['id']}/data").content))
    assert np.array_equal(table["time"].to_numpy(), times[200:800])
    assert np.allclose(np.deg2rad(table["joint1.angle"].to_numpy()), values["joint1.angle"][200:800])
    empty = running.client.post(f"{API}/recordings/{recording}/cut", json={"start": 50, "end": 60})
    assert empty.status_code == 422 and "has no rows from 50 s to 60 s" in empty.json()["detail"]
    assert running.client.post(f"{API}/recordings/{recording}/cut", json={"start": 6, "end": 5}).status_code == 422
    running.client.get(f"{API}/recordings/{row['id']}/signals")
    kept = running.service.files.recordings
    assert (kept / f"{row['id']}.signals.npz").is_file()
    assert running.client.delete(f"{API}/recordings/{row['id']}").status_code == 204
    assert list(kept.glob(f"{row['id']}*")) == []


def test_signals_of_a_machine_that_is_acquired(running: Running, recording: str) -> None:
    url = f"{API}/machines/lever/signals"
    assert running.client.get(url).json()["time"] == []
    acquire(running, "lever")
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        found = running.client.get(url, params={"seconds": 30}).json()
        if found["time"]:
            break
        time.sleep(0.1)
    assert found["channels"]["joint1.angle"]["low"] == [pytest.approx(30.0)]
    assert found["channels"]["joint1.torque"]["low"] == [None]
    assert running.client.get(url, params={"seconds": 30, "channel": "none"}).status_code == 422
    assert running.client.get(f"{API}/machines/absent/signals").status_code == 404


def test_a_part_that_is_too_short_is_refused_before_a_process_starts(
    running: Running, recording: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def started(*_: object, **__: object) -> None:
        raise AssertionError("a process was started for it")

    monkeypatch.setattr(FileChildren, "run", started)
    answer = running.client.post(f"{API}/recordings/{recording}/cut", json={"start": 4, "end": 4.9})
    assert answer.status_code == 422
    assert "end must be at least 1 s later than start" in answer.json()["detail"]
