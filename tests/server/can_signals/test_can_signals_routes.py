"""DBC files of a machine over REST: their signals, download, and replacement that takes nothing from a channel."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from acquired_machines import MACHINES
from service_fakes import API, MACHINE, Fakes, Running, running_service

from daq.errors import MachineFileError
from server.can_signals import signal_child
from server.platform.processes.children import ChildResult
from server.platform.processes.file_children import FileChildren

pytest.importorskip("cantools")
CAN = f"{API}/can-signals"
DBC = """VERSION ""
NS_ :
BS_:
BU_: Sensors

BO_ 291 Boom: 8 Sensors
 SG_ Angle : 7|16@0- (0.01,0) [-180|180] "deg" Vector__XXX
 SG_ Torque : 16|16@1+ (0.1,-50) [0|400] "N m" Vector__XXX
 SG_ Spare : 32|16@1+ (0.1,0) [0|400] "bar" Vector__XXX
"""
ANGLE = "{bus: can, node: 1, object: 0x6004, data_type: int32}"
BUS = "{name: can, type: canopen, interface: virtual, channel: tests}"
LEVER = (
    MACHINE.replace(ANGLE, "{bus: plain, signal: Angle}")
    .replace("{bus: can, node: 2, object: 0x6130, data_type: float32}", "{bus: plain, signal: Torque}")
    .replace(BUS, "{name: plain, type: can_signals, interface: virtual, channel: tests, dbc: [lever.dbc]}")
)


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    with running_service(tmp_path_factory.mktemp("data"), Fakes()) as made:
        assert made.client.post(MACHINES, content=LEVER).status_code == 201
        yield made


REAL = FileChildren.run


def here(children: FileChildren, module: str, *arguments: Any, **options: Any) -> ChildResult:
    """What the child that reads DBC files does, done here: a process takes two seconds to load."""
    if module != "server.can_signals.signal_child":
        return REAL(children, module, *arguments, **options)
    folder = Path.cwd()
    try:
        signal_child.look(*arguments)
    except MachineFileError as error:
        return ChildResult("input", error=str(error))
    finally:
        os.chdir(folder)
    return ChildResult("done")


@pytest.fixture
def running(service: Running, monkeypatch: pytest.MonkeyPatch) -> Running:
    dbc(service).write_text(DBC)
    monkeypatch.setattr(signal_child, "limit_child", lambda *limits: None)
    monkeypatch.setattr(FileChildren, "run", here)
    return service


def dbc(running: Running) -> Path:
    return running.service.files.machines / "lever" / "lever.dbc"


def ask(running: Running, **query: Any) -> Any:
    answer = running.client.get(CAN, params={"machine": "lever", **query})
    assert answer.status_code == 200, answer.text
    return answer.json()


def send(running: Running, content: str, name: str = "lever.dbc", **headers: str) -> Any:
    return running.client.post(
        f"{CAN}/upload", params={"machine": "lever", "name": name}, content=content, headers=headers
    )


def test_signals_are_listed_and_searched(running: Running) -> None:
    found = ask(running)
    (bus,) = found["buses"]
    assert (bus["name"], bus["problems"], bus["left_out"]) == ("plain", [], 0)
    assert bus["files"] == [
        {
            "name": "lever.dbc",
            "sha256": hashlib.sha256(DBC.encode()).hexdigest(),
            "messages": 1,
            "signals": 3,
            "error": None,
            "error_message": None,
        }
    ]
    uses = {item["signal"]: item["channels"] for item in found["items"]}
    assert uses == {"Angle": ["joint1.angle"], "Torque": ["joint1.torque"], "Spare": []}
    assert [item["signal"] for item in ask(running, search="BAR boom")["items"]] == ["Spare"]
    assert ask(running, search="0x123")["found"] == 3
    few = ask(running, limit=1)
    assert few["found"] == 3 and len(few["items"]) == 1
    assert {"name": "oil_temperature", "of_a_joint": False} in found["quantities"]


def test_a_file_that_is_not_there_or_none_is_said_without_a_path_of_the_server(running: Running) -> None:
    for make in (lambda path: path.unlink(), lambda path: path.write_text("no such file")):
        make(dbc(running))
        (bus,) = ask(running)["buses"]
        (file,) = bus["files"]
        assert file["error"].startswith("bus 'plain': lever.dbc: ") and bus["problems"] == [file["error"]]


def test_a_file_comes_back_as_it_was_sent(running: Running) -> None:
    changed = DBC.replace("(0.01,0)", "(0.02,0)")
    answer = send(running, changed)
    assert answer.status_code == 200, answer.text
    digest = hashlib.sha256(changed.encode()).hexdigest()
    assert answer.json() == {"name": "lever.dbc", "sha256": digest}
    assert answer.headers["ETag"] == f'"{digest}"'
    back = running.client.get(f"{CAN}/file", params={"machine": "lever", "name": "lever.dbc"})
    assert back.text == changed
    angle = next(item for item in ask(running)["items"] if item["signal"] == "Angle")
    assert angle["factor"] == 0.02


def test_what_would_take_a_signal_away_or_is_no_file_is_refused(running: Running) -> None:
    for content, said in (
        (DBC.replace("SG_ Angle", "SG_ Ongle"), "joint1.angle: there is no signal 'Angle'"),
        ("hello", "bus 'plain': lever.dbc: is no DBC file"),
    ):
        answer = send(running, content)
        assert answer.status_code == 422 and answer.json()["detail"].startswith(said)
        assert str(running.service.files.root) not in answer.text
    assert dbc(running).read_text() == DBC
    assert not list(running.service.files.recordings.glob(".incoming-*"))


def test_a_file_that_somebody_else_replaced_is_not_overwritten(running: Running) -> None:
    old = hashlib.sha256(b"another").hexdigest()
    answer = send(running, DBC.replace("Spare", "Unused"), **{"If-Match": f'"{old}"'})
    assert answer.status_code == 412 and dbc(running).read_text() == DBC
    now = hashlib.sha256(DBC.encode()).hexdigest()
    assert send(running, DBC.replace("Spare", "Unused"), **{"If-Match": f'"{now}"'}).status_code == 200


@pytest.mark.parametrize("name", ["1.yaml", "../lever/lever.dbc", "other.dbc", "/etc/passwd"])
def test_only_files_that_the_machine_names_are_read_or_written(running: Running, name: str) -> None:
    assert running.client.get(f"{CAN}/file", params={"machine": "lever", "name": name}).status_code == 404
    assert send(running, DBC, name).status_code == 404
    assert {path.name for path in dbc(running).parent.iterdir()} == {"1.yaml", "lever.dbc"}


def test_a_machine_without_such_a_bus_and_one_that_is_not_there(running: Running) -> None:
    running.client.post(MACHINES, content=MACHINE.replace("name: lever", "name: other"))
    found = running.client.get(CAN, params={"machine": "other"}).json()
    assert (found["buses"], found["items"]) == ([], [])
    assert running.client.get(CAN, params={"machine": "nobody"}).status_code == 404


def test_backups_hold_the_file(running: Running) -> None:
    made = running.client.post(f"{API}/backups")
    assert made.status_code == 201, made.text
    copy = max(running.service.files.backups.iterdir()) / "machines" / "lever" / "lever.dbc"
    assert copy.read_text() == DBC


@pytest.mark.slow
def test_a_child_with_limits_reads_it(service: Running) -> None:
    dbc(service).write_text(DBC.replace("Spare", "Really"))
    assert [item["signal"] for item in ask(service, search="really")["items"]] == ["Really"]
    answer = send(service, "hello")
    assert answer.status_code == 422 and answer.json()["detail"].startswith("bus 'plain': lever.dbc: is no DBC file")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("result", "status"),
    [
        (ChildResult("failed", error="was ended by SIGXCPU; is the memory too small?", exceeded=True), 422),
        (ChildResult("failed", error="took longer than 180 s and was ended"), 503),
        (ChildResult("failed", error="exit code 1"), 503),
    ],
)
def test_a_child_that_ends_early(
    running: Running, monkeypatch: pytest.MonkeyPatch, result: ChildResult, status: int
) -> None:
    monkeypatch.setattr(FileChildren, "run", lambda *order, **options: result)
    answer = send(running, DBC.replace("Spare", "Long"))
    assert answer.status_code == status and dbc(running).read_text() == DBC
