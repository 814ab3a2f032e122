"""Sessions of devices and keys: seen, ended, expired; and their streams end with them."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from access_fakes import Clock, Guarded, guarded_service
from service_fakes import API
from starlette.websockets import WebSocketDisconnect

from server.access.access_desk import FAILURES, Access
from server.access.connections import Connections, Presence, Stream
from server.audit.audit_resource import Audit
from server.composition.declarations import TABLES
from server.platform.authorization.principals import SERVICE
from server.platform.database.engine import Database
from server.platform.errors import ConflictError, ForbiddenError

ACCESS = f"{API}/access"
SOCKET = f"ws://127.0.0.1:8350{API}/live/stream?machine=lever"


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Guarded]:
    with guarded_service(tmp_path_factory.mktemp("data")) as service:
        yield service


def key(guarded: Guarded, **order: Any) -> tuple[str, str, dict[str, str]]:
    """Id, token and header of a new key."""
    order = {"name": "historian", "role": "viewer"} | order
    made = guarded.client.post(f"{ACCESS}/keys", json=order, headers=guarded.bearer("admin")).json()
    return made["id"], made["key"], {"Authorization": f"Bearer {made['key']}"}


def revoke(guarded: Guarded, id: str) -> None:
    assert guarded.client.delete(f"{ACCESS}/keys/{id}", headers=guarded.bearer("admin")).status_code == 204


def listed(guarded: Guarded, id: str) -> dict[str, Any]:
    return dict(guarded.client.get(f"{ACCESS}/keys/{id}", headers=guarded.bearer("admin")).json())


@pytest.mark.timeout(30)
def test_a_socket_ends_with_its_token(guarded: Guarded) -> None:
    id, token, headers = key(guarded)
    with guarded.client.websocket_connect(SOCKET, subprotocols=["hilfit.v1", f"bearer.{token}"]) as socket:
        assert socket.receive_json()["type"] == "snapshot"
        assert listed(guarded, id)["streams"] == 1
        revoke(guarded, id)
        with pytest.raises(WebSocketDisconnect) as ended:
            while True:
                socket.receive_json()
    assert ended.value.code == 1008
    assert guarded.client.get(f"{API}/machines", headers=headers).status_code == 401


@pytest.mark.timeout(30)
@pytest.mark.parametrize("path", [f"{API}/events"])
def test_an_event_stream_ends_with_its_token(guarded: Guarded, path: str) -> None:
    id, _, headers = key(guarded)
    with ThreadPoolExecutor(1) as pool:
        # The client hands out an answer when it is whole: that it does is what is tried.
        stream = pool.submit(guarded.client.get, path, headers=headers)
        while listed(guarded, id)["streams"] == 0:
            assert not stream.done()
        revoke(guarded, id)
        answer = stream.result()
    assert answer.status_code == 200
    assert answer.text.startswith("data: ")


@pytest.mark.slow
def test_revoking_a_key_does_not_end_the_stream_of_another(guarded: Guarded) -> None:
    id, _, _ = key(guarded)
    _, token, _ = key(guarded)
    with guarded.client.websocket_connect(SOCKET, subprotocols=["hilfit.v1", f"bearer.{token}"]) as socket:
        revoke(guarded, id)
        assert [socket.receive_json()["type"] for _ in range(2)] == ["snapshot", "heartbeat"]


@pytest.mark.parametrize("revoked", [True, False])
def test_a_stream_ends_when_its_token_expires_or_was_revoked_while_it_opened(revoked: bool) -> None:
    async def serve() -> bool:
        connections = Connections()
        if revoked:
            connections.end("key-1")
        stream = Stream()
        expires = None if revoked else "2026-01-01T00:00:00.010Z"
        with connections.stream("key-1", stream, "2026-01-01T00:00:00.000Z", expires):
            try:
                await asyncio.Event().wait()
            except asyncio.CancelledError:
                return stream.ended
        return False

    assert asyncio.run(serve())


def test_who_is_here_is_listed(guarded: Guarded) -> None:
    id, _, headers = key(guarded, days=7)
    before = listed(guarded, id)
    assert (before["seen"], before["address"], before["streams"]) == (None, None, 0)
    assert datetime.fromisoformat(before["expires"]) - datetime.fromisoformat(before["created"]) == timedelta(days=7)
    guarded.client.get(f"{API}/machines", headers=headers)
    after = listed(guarded, id)
    assert after["seen"] >= after["created"]
    assert after["address"] == "testclient"
    default = listed(guarded, key(guarded)[0])
    assert datetime.fromisoformat(default["expires"]) - datetime.fromisoformat(default["created"]) == timedelta(365)


def test_a_session_can_be_ended_by_its_own_device(guarded: Guarded) -> None:
    id, _, headers = key(guarded)
    assert guarded.client.delete(f"{ACCESS}/me", headers=headers).status_code == 204
    assert guarded.client.get(f"{ACCESS}/me", headers=headers).status_code == 401
    assert guarded.client.get(f"{ACCESS}/keys/{id}", headers=guarded.bearer("admin")).status_code == 404


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def access(tmp_path: Path, clock: Clock) -> Iterator[Access]:
    database = Database(tmp_path / "store.sqlite", TABLES, clock=clock, changed=lambda: None)
    yield Access(database, Audit(database), required=True, days=90)
    database.close()


def test_a_token_expires_also_where_it_is_remembered(access: Access, clock: Clock) -> None:
    code = access.open_code("viewer", None, SERVICE, days=2)
    _, token = access.pair(code.digits, "tablet")
    assert access.principal(token) is not None and access.known(token) is not None
    clock.now += timedelta(days=2) - timedelta(seconds=1)
    assert access.principal(token) is not None
    clock.now += timedelta(seconds=1)
    assert access.principal(token) is None and access.known(token) is None


def test_when_the_last_admin_has_expired_the_next_start_has_a_code(access: Access, clock: Clock) -> None:
    access.make_key("first", "admin", None, SERVICE, days=1)
    assert access.first_admin() is None
    clock.now += timedelta(days=1)
    assert access.first_admin() is not None


def test_a_bound_admin_can_be_revoked_while_one_unbound_admin_is_left(access: Access) -> None:
    unbound, _ = access.make_key("of all", "admin", None, SERVICE)
    bound, _ = access.holders.add("key", "of one", "admin", ("lever",), SERVICE.name)
    access.holders.remove(bound.id, "key")
    with pytest.raises(ConflictError, match="last admin"):
        access.holders.remove(unbound.id, "key")


def test_failed_pairings_are_in_the_audit_log_and_cannot_flood_it(access: Access) -> None:
    for _ in range(FAILURES.burst + 10):
        with pytest.raises(ForbiddenError):
            access.pair("0000000000", "guess", "192.0.2.7")
    access._failures.wait = lambda *_: 0  # type: ignore[method-assign]
    with pytest.raises(ForbiddenError):
        access.pair("0000000000", "guess", "192.0.2.8")
    newest, *others = access._audit.list(100).items
    assert len(others) == FAILURES.burst
    assert (newest.principal, newest.action, newest.subject) == ("nobody", "access.pair_failed", "192.0.2.8")
    assert newest.detail == {"name": "guess", "more_before": 10}
    assert others[0].subject == "192.0.2.7"


def test_presence_counts_streams() -> None:
    async def open_two() -> list[Presence]:
        connections = Connections()
        connections.note("key-1", "2026-01-01T00:00:00.000Z", "10.0.0.1")
        with connections.stream("key-1", Stream(), "", None):
            with connections.stream("key-1", Stream(), "", None):
                inner = connections.of("key-1")
            return [inner, connections.of("key-1"), connections.of("key-2")]

    seen = ("2026-01-01T00:00:00.000Z", "10.0.0.1")
    assert asyncio.run(open_two()) == [Presence(*seen, 2), Presence(*seen, 1), Presence()]


@pytest.mark.slow
def test_a_session_that_is_revoked_in_another_thread_ends_its_stream(guarded: Guarded) -> None:
    """Revoking happens in a thread of the pool, streams run in the event loop."""
    id, token, _ = key(guarded)
    with guarded.client.websocket_connect(SOCKET, subprotocols=["hilfit.v1", f"bearer.{token}"]) as socket:
        thread = threading.Thread(target=guarded.running.service[Access].holders.remove, args=(id, "key"))
        thread.start()
        with pytest.raises(WebSocketDisconnect):
            while True:
                socket.receive_json()
        thread.join()
