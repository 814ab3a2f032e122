"""The valves of a bench are identified over REST by the program that a site runs, and no bus hears of it."""

from __future__ import annotations

import io
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from pathlib import Path

import can
import pytest
import yaml
from service_fakes import API, Fakes, Running, running_service
from valve_bench import Bench, machine_of, written

from daq.machine.machine_file import machine_to_yaml
from server.valves.valve_fits import ValveResults
from server.valves.valve_resource import VALVE_PROGRAM

VALVES = f"{API}/valves"


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Running]:
    """A service with the program that a site has."""
    fakes = Fakes()
    del fakes.parts[VALVE_PROGRAM]
    with running_service(tmp_path / "data", fakes) as running:
        yield running


@pytest.mark.slow
def test_a_bench_is_identified_over_rest(site: Running, tmp_path: Path) -> None:
    machine = machine_of()
    tree = yaml.safe_load(machine_to_yaml(machine))
    tree["buses"] = [{"name": "can0", "type": "canopen", "interface": "virtual", "channel": "valves"}]
    for number, channel in enumerate(tree["channels"]):
        channel["source"] = {"bus": "can0", "node": 1 + number, "object": 0x6300, "data_type": "int16"}
    bus = can.Bus(interface="virtual", channel="valves")
    answer = site.client.post(f"{API}/machines", content=yaml.safe_dump(tree))
    assert answer.status_code == 201, answer.text
    chosen = []
    for seed, role in ((1, "operation"), (2, "validate")):
        file = written(tmp_path, machine, Bench(), seed, 25.0)
        query = {"machine": "bench", "role": role, "name": file.name}
        answer = site.client.post(f"{API}/recordings/upload", params=query, content=file.read_bytes())
        assert answer.status_code == 201, answer.text
        chosen.append({"id": answer.json()["id"]})
    made = site.client.post(VALVES, json={"machine": "bench", "recordings": chosen, "options": {"loop": False}}).json()
    assert site.follow(made["job"])[-1]["state"] == "done"
    axis = site.client.get(f"{VALVES}/{made['id']}").json()["axes"]["boom"]
    assert axis["judged_on"] == "validate" and axis["error"] < 0.1
    for way, edge in zip(("extend", "retract"), Bench().edges, strict=True):
        assert axis["edges"][way] == pytest.approx(edge, abs=0.02)  # 2 % of full speed is less than 2 % of full beyond
    content = site.client.get(f"{VALVES}/{made['id']}/inverse.zip", params={"format": "python"}).content
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        text = archive.read("valve_boom.py").decode()
    place = site.service[ValveResults].directory(made["id"]) / "inverse"
    assert text == (place / "valve_boom.py").read_text()
    assert "hilfit writes no command" in text
    heard = bus.recv(0)
    bus.shutdown()
    assert heard is None, "nothing was sent to the bus of the valves"


@pytest.mark.slow
def test_what_identifies_valves_knows_no_bus() -> None:
    """Its process has no library that could open one, so that no frame can come from there."""
    text = "import sys, fitting.pipeline.stage_program; print(*{name.partition('.')[0] for name in sys.modules})"
    run = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=True)
    loaded = set(run.stdout.split())
    assert "fitting" in loaded and not loaded & {"can", "canopen", "pymodbus", "serial", "socketcan"}
