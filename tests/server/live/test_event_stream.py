"""``/events``: a client knows every counter at first, then what moved, and costs the store one read for all."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator

import pytest
from fastapi.concurrency import run_in_threadpool
from service_fakes import API, MACHINE, Running

from server.live.revisions import Revisions
from server.platform.changes import Changes


class Store:
    """Counters, and how often they were read."""

    def __init__(self) -> None:
        self.counters = {"machines": 3}
        self.reads = 0

    async def read(self) -> dict[str, int]:
        self.reads += 1
        return dict(self.counters)


def follower(store: Store, changes: Changes, **timing: float) -> Revisions:
    return Revisions(changes, store.read, **timing)


async def soon(events: AsyncIterator[tuple[str, int] | None]) -> tuple[str, int] | None:
    return await asyncio.wait_for(anext(events), 30)


def test_all_counters_come_first_and_then_those_that_changed() -> None:
    async def run() -> list[tuple[str, int] | None]:
        store, changes = Store(), Changes()
        events = follower(store, changes).follow()
        got = [await soon(events)]
        store.counters |= {"jobs": 1}
        changes.notify()
        got.append(await soon(events))
        store.counters["machines"] = 4
        changes.notify()
        got.append(await soon(events))
        return got

    assert asyncio.run(run()) == [("machines", 3), ("jobs", 1), ("machines", 4)]


def test_twenty_followers_are_one_read() -> None:
    async def run() -> int:
        store, changes = Store(), Changes()
        revisions = follower(store, changes)
        followers = [revisions.follow() for _ in range(20)]
        for events in followers:
            await soon(events)
        store.counters["machines"] += 1
        changes.notify()
        for events in followers:
            assert await soon(events) == ("machines", 4)
        return store.reads

    assert asyncio.run(run()) == 2


def test_what_another_process_changed_is_seen_without_being_told() -> None:
    async def run() -> tuple[str, int] | None:
        store, changes = Store(), Changes()
        events = follower(store, changes, poll_s=0.01).follow()
        await soon(events)
        store.counters["machines"] = 9
        return await soon(events)

    assert asyncio.run(run()) == ("machines", 9)


def test_a_quiet_event_stream_sends_heartbeats() -> None:
    async def run() -> tuple[str, int] | None:
        events = follower(Store(), Changes(), poll_s=0.01, heartbeat_s=0.05).follow()
        await soon(events)
        return await soon(events)

    assert asyncio.run(run()) is None


def test_a_stopping_service_ends_the_stream() -> None:
    async def run() -> None:
        changes = Changes()
        events = follower(Store(), changes).follow()
        await soon(events)
        changes.close()
        with pytest.raises(StopAsyncIteration):
            await soon(events)

    asyncio.run(run())


@pytest.mark.slow
def test_over_http_it_is_an_event_stream(running: Running) -> None:
    running.client.post(f"{API}/machines", content=MACHINE)
    running.service.changes.close()  # the stream says what there is, then ends: a test client reads it whole
    response = running.client.get(f"{API}/events")
    assert response.headers["content-type"].startswith("text/event-stream")
    assert response.headers["cache-control"] == "no-store"
    assert response.text == ""


@pytest.mark.slow
def test_its_lines_are_json(running: Running) -> None:
    from server.live.live_resource import _lines

    async def run() -> bytes:
        running.service.changes = Changes()

        async def read() -> dict[str, int]:
            return await run_in_threadpool(running.service.database.revisions)

        running.service.put({Revisions: Revisions(running.service.changes, read)})
        return await asyncio.wait_for(anext(_lines(running.service)), 30)

    line = asyncio.run(run())
    assert line.startswith(b"data: ")
    assert json.loads(line.removeprefix(b"data: ")) == {"resource": "machines", "revision": 1}
