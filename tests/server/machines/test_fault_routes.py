"""Faults of the simulated machine over REST: what is offered, what begins, and who is refused."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from service_fakes import API, MACHINE, Fakes, Running, running_service

from server.machines.fault_routes import BREAKABLE
from server.machines.machine_desk import MachineDesk
from server.machines.simulation_child import MOST, FaultOrders
from server.platform.errors import InvalidError
from sim_backends import default_machine

FAULTS = f"{API}/machines/lever/faults"
DEATH = {"at": 0, "for": 5, "fault": "node_death", "bus": "can", "node": 31}
OFFER = {"fault": "node_death", "target": "node 31 on can", "entry": {"fault": "node_death", "bus": "can", "node": 31}}


class Breakable:
    """Takes orders as the simulated machine does."""

    def __init__(self) -> None:
        self.begun: list[dict[str, Any]] = []

    def order(self, order: str, **details: Any) -> Any:
        if order == "offers":
            return [OFFER]
        if order == "begin":
            if details["faults"][0].get("node") == 99:
                raise InvalidError("faults[0].node: bus 'can' has no node 99; there are 31")
            self.begun += details["faults"]
        return [{**fault, "left_s": 4.5} for fault in self.begun]


@pytest.fixture
def machine() -> Breakable:
    return Breakable()


@pytest.fixture
def running(tmp_path: Path, machine: Breakable) -> Iterator[Running]:
    fakes = Fakes()
    fakes.parts[BREAKABLE] = machine
    with running_service(tmp_path, fakes) as made:
        assert made.client.post(f"{API}/machines", content=MACHINE).status_code == 201
        made.service[MachineDesk].simulated = "lever"
        yield made


@pytest.mark.slow
def test_faults_are_offered_and_begin(running: Running, machine: Breakable) -> None:
    assert running.client.get(FAULTS).json() == {"simulated": True, "offers": [OFFER], "running": []}
    begun = running.client.post(FAULTS, json={"faults": [DEATH]})
    assert begun.status_code == 202 and begun.json()["running"] == [{**DEATH, "left_s": 4.5}]
    assert machine.begun == [DEATH]
    assert running.client.get(FAULTS).json()["running"] == [{**DEATH, "left_s": 4.5}]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("body", "words"),
    [
        ({"faults": []}, "faults"),
        ({"faults": [DEATH], "now": True}, "now"),
        ({"faults": [{**DEATH, "node": 99}]}, "bus 'can' has no node 99"),
    ],
)
def test_what_makes_no_sense_is_refused(running: Running, machine: Breakable, body: Any, words: str) -> None:
    refused = running.client.post(FAULTS, json=body)
    assert refused.status_code == 422 and words in refused.text
    assert machine.begun == []


@pytest.mark.slow
def test_faults_on_a_machine_that_is_not_simulated_are_refused(running: Running, machine: Breakable) -> None:
    running.service[MachineDesk].simulated = None
    assert running.client.get(FAULTS).json() == {"simulated": False, "offers": [], "running": []}
    refused = running.client.post(FAULTS, json={"faults": [DEATH]})
    assert refused.status_code == 409 and "is not simulated here" in refused.json()["detail"]
    assert machine.begun == []
    assert running.client.get(f"{API}/machines/nobody/faults").status_code == 404


class Simulated:
    """The simulated machine's side: its first SYNC was sent, and it remembers what it was told."""

    def __init__(self) -> None:
        self.told: list[tuple[str, str]] = []
        self.over = threading.Event()

    def order(self, process: str, order: str, **details: Any) -> Any:
        if order == "counts":
            return {"sync": 1}
        self.told.append((process, details["kind"]))
        if details["kind"] == "revive":
            self.over.set()
        return None


def test_orders_run_a_script_on_the_simulated_machine(tmp_path: Path) -> None:
    simulated, (machine, _) = Simulated(), default_machine()
    orders = FaultOrders(simulated, machine, tmp_path / "faults.jsonl")  # type: ignore[arg-type]
    begun = orders.answer(json.dumps({"order": "begin", "faults": [{**DEATH, "for": 0.05}]}))
    assert begun["result"][0]["fault"] == "node_death"
    assert simulated.over.wait(60)
    assert simulated.told == [("nodes", "kill"), ("nodes", "revive")]
    assert [offer["fault"] for offer in orders.answer('{"order": "offers"}')["result"]].count("node_death") > 1


@pytest.mark.parametrize(
    ("faults", "words"),
    [
        ([{**DEATH, "node": 99}], "has no node 99"),
        ([{**DEATH, "every": 10}], "every is for fault files"),
        ([{**DEATH, "fault": "rust"}], "there is no fault 'rust'"),
        ([DEATH] * (MOST + 1), f"at most {MOST} at once"),
    ],
)
def test_orders_that_make_no_sense_are_one_line(tmp_path: Path, faults: list[dict[str, Any]], words: str) -> None:
    simulated, (machine, _) = Simulated(), default_machine()
    orders = FaultOrders(simulated, machine, tmp_path / "faults.jsonl")  # type: ignore[arg-type]
    answer = orders.answer(json.dumps({"order": "begin", "faults": faults}))
    assert words in answer["error"] and "\n" not in answer["error"]
    assert simulated.told == [] and orders.answer('{"order": "running"}') == {"result": []}
