"""What goes wrong around the service: a locked store, an acquisition that dies, a page from elsewhere, use twice."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable

import pytest
from service_fakes import API, MACHINE, Running, wait_for_change
from starlette.websockets import WebSocketDisconnect

from server.alarms.alarm_desk import Alarms
from server.alarms.alarm_lifecycle import KINDS, AlarmKind
from server.machines.acquisition import Acquisition
from server.recordings.recording_sessions import Sessions


def settled(running: Running, condition: Callable[[], bool]) -> None:
    for _ in range(600):
        if condition():
            return
        wait_for_change(running.service, running.service.changes.number, 0.1)
    raise AssertionError("it never came to that")


@pytest.mark.slow
def test_a_locked_store_is_a_503_for_writers_while_readers_go_on(running: Running) -> None:
    running.client.post(f"{API}/machines", content=MACHINE)
    running.service[Alarms].report("lever", "residual_drift", "x", "warning", True)
    path = f"{API}/alarms/{running.client.get(f'{API}/alarms').json()['items'][0]['id']}"
    engine = running.service.database._engine
    engine.pool.dispose()  # connections made from now on wait for a moment only; the service closes this pool

    def impatient(connection: sqlite3.Connection, _record: object) -> None:
        connection.execute("PRAGMA busy_timeout=50")

    from sqlalchemy import event

    event.listen(engine, "connect", impatient)
    other = sqlite3.connect(running.service.files.database, isolation_level=None)
    try:
        other.execute("BEGIN IMMEDIATE")
        refused = running.client.post(f"{path}/acknowledge")
        assert refused.status_code == 503, refused.text
        assert refused.headers["retry-after"] == "5"
        assert refused.headers["content-type"] == "application/problem+json"
        assert "sqlite" not in refused.text.lower()
        assert running.client.get(path).json()["acknowledged"] is False
    finally:
        other.close()
        event.remove(engine, "connect", impatient)
    assert running.client.post(f"{path}/acknowledge").json()["acknowledged"] is True
    engine.pool.dispose()


@pytest.mark.slow
def test_an_acquisition_that_dies_is_an_alarm_until_it_is_back(
    running: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(KINDS, "acquisition_down", AlarmKind())

    def down() -> bool:
        return "acquisition_down" in [alarm.kind for alarm in running.service[Alarms].active()]

    running.client.post(f"{API}/machines", content=MACHINE)
    running.client.put(f"{API}/machines/lever/acquisition", json={"enabled": True})
    settled(running, lambda: running.service[Acquisition].running("lever") and not down())
    running.fakes.acquisition.failures += ["the bus is gone"] * 2
    running.fakes.acquisition.feeds[-1].alive = False
    settled(running, down)
    settled(running, lambda: running.service[Acquisition].running("lever") and not down())
    running.client.put(f"{API}/machines/lever/acquisition", json={"enabled": False})


def test_a_page_from_elsewhere_gets_no_signals(running: Running) -> None:
    with (
        pytest.raises(WebSocketDisconnect),
        running.client.websocket_connect(
            f"ws://127.0.0.1:8350{API}/live/stream?machine=lever", headers={"origin": "http://elsewhere.example"}
        ),
    ):
        raise AssertionError("it was let in")


@pytest.mark.slow
def test_a_machine_that_is_recorded_is_not_recorded_twice_and_what_is_in_use_stays(running: Running) -> None:
    running.client.post(f"{API}/machines", content=MACHINE)
    running.client.put(f"{API}/machines/lever/acquisition", json={"enabled": True})
    settled(running, lambda: running.service[Acquisition].running("lever"))
    first = running.client.post(f"{API}/recordings", json={"machine": "lever", "role": "train"}).json()["id"]
    second = running.client.post(f"{API}/recordings", json={"machine": "lever", "role": "train"})
    assert (second.status_code, first in second.json()["detail"]) == (409, True)
    assert running.client.delete(f"{API}/recordings/{first}").status_code == 409
    assert running.client.get(f"{API}/recordings/{first}/statistics").status_code == 409
    assert running.client.get(f"{API}/recordings/{first}/data?format=mcap").status_code == 409
    assert running.client.put(f"{API}/machines/lever/acquisition", json={"enabled": False}).status_code == 409
    running.service[Sessions].end_all()  # what a full disk does
    settled(running, lambda: running.client.get(f"{API}/recordings/{first}").json()["state"] == "sealed")
    running.client.put(f"{API}/machines/lever/acquisition", json={"enabled": False})
