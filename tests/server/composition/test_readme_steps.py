"""The steps of README.md, run as they are printed; and that none of them harms the simulated machine."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from service_fakes import API, MACHINE, Fakes, motion, running_service
from test_server_process import server

from daq import parse_machine, write_recording
from server.machines.machine_desk import MachineDesk

pytestmark = pytest.mark.slow

README = (Path(__file__).parents[3] / "README.md").read_text(encoding="utf-8")
ARM = MACHINE.replace("name: lever", "name: folding-arm")


def steps() -> str:
    """The block of README.md that begins with the address of the API."""
    (found,) = re.findall(r"^```\n(API=.*?)^```$", README, re.MULTILINE | re.DOTALL)
    return str(found)


def recorded(path: Path, role: str) -> Path:
    """A recording of the machine."""
    return write_recording(path, parse_machine(ARM), role, *motion(10))


@pytest.fixture
def demo(tmp_path: Path) -> Iterator[Path]:
    """What ``hilfit demo`` leaves, of a smaller machine with the same name."""
    made = tmp_path / "hilfit-demo"
    for folder in ("machine", "recordings"):
        (made / folder).mkdir(parents=True)
    (made / "machine" / "machine.yaml").write_text(ARM)
    roles = {"unloaded": "unloaded", "train-1": "train", "train-2": "train", "repeat": "repeat", "validate": "validate"}
    for name, role in roles.items():
        recorded(made / "recordings" / f"{name}.parquet", role)
    yield tmp_path


@pytest.mark.skipif(shutil.which("curl") is None, reason="the steps use curl")
def test_the_steps_work_as_printed(demo: Path) -> None:
    with server(demo / "data") as (_, client):
        script = steps().replace("http://127.0.0.1:8350", str(client.base_url).rstrip("/"))
        done = subprocess.run(["bash", "-euc", script], cwd=demo, capture_output=True, text=True, timeout=120)
        assert done.returncode == 0, done.stderr
        assert '"state": "done"' in done.stdout
        assert "<title>report" in (demo / "report.html").read_text().lower()
        recordings = client.get(f"{API}/recordings").json()["items"]
        assert sorted(row["role"] for row in recordings) == ["repeat", "train", "train", "unloaded", "validate"]


def test_the_simulated_machine_keeps_its_file_and_its_recordings_can_be_uploaded(tmp_path: Path) -> None:
    with running_service(tmp_path / "data", Fakes()) as running:
        client, service = running.client, running.service
        assert client.post(f"{API}/machines", content=ARM).status_code == 201
        service[MachineDesk].simulated = "folding-arm"  # as --simulate leaves it
        service[MachineDesk].set_acquisition("folding-arm", True)
        other = ARM.replace("channel: tests", "channel: of-an-earlier-run")
        for place in ("machines", "machines/check"):
            answer = client.post(f"{API}/{place}", content=other)
            assert answer.status_code == 409, answer.text
            assert "simulates" in answer.json()["detail"]
        assert client.post(f"{API}/machines", content=ARM).status_code == 200, "its own file changes nothing"
        found = client.get(f"{API}/machines/folding-arm").json()
        assert (found["current"], found["machine"]["buses"][0]["channel"]) == (1, "tests")
        assert found["acquisition"]["restarts"] == 0
        query = {"machine": "folding-arm", "role": "train", "name": "made.parquet"}
        content = recorded(tmp_path / "made.parquet", "train").read_bytes()
        assert client.post(f"{API}/recordings/upload", params=query, content=content).status_code == 201
        assert client.post(f"{API}/machines", content=other.replace("folding-arm", "mine")).status_code == 201
        assert json.loads(client.get(f"{API}/status").text)["acquisition"].keys() == {"folding-arm"}
