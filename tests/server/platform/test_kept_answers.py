"""Lists that are answered from memory: never older than what they depend on, and each asker gets its own."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest
from sqlalchemy.exc import OperationalError

from server.composition.declarations import RESOURCES
from server.platform.authorization.principals import LOCAL, Principal
from server.platform.http.kept_answers import LARGEST_BYTES, Conditional, KeptAnswers
from server.platform.resource import kept_lists

LISTS = {"/api" + path: names for path, names in kept_lists(RESOURCES).items()}
BOUND = Principal("key-1", "bound", "viewer", ("lever",), "key")


class Application:
    """Answers with ``status`` and ``body``, and counts how often it was asked."""

    def __init__(self) -> None:
        self.asked = 0
        self.status, self.body = 200, b"[]"

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        self.asked += 1
        scope["route"] = "the route"
        headers = [(b"content-type", b"application/json"), (b"content-length", str(len(self.body)).encode())]
        await send({"type": "http.response.start", "status": self.status, "headers": headers})
        for part in (self.body[:2], self.body[2:]):
            await send({"type": "http.response.body", "body": part, "more_body": part is self.body[:2]})


class Bench:
    def __init__(self) -> None:
        self.application = Application()
        self.counters: dict[str, int] = {}
        self.layer = Conditional(KeptAnswers(self.application, LISTS, self.read))

    async def read(self) -> dict[str, int]:
        return self.counters

    def ask(
        self,
        path: str = "/api/jobs",
        query: bytes = b"",
        who: Principal | None = LOCAL,
        known: str = "",
        verb: str = "GET",
    ) -> tuple[int, bytes, dict[bytes, bytes], Any]:
        sent: list[dict[str, Any]] = []
        scope = {"type": "http", "method": verb, "path": path, "query_string": query, "headers": []}
        scope["hilfit.principal"] = who
        if known:
            scope["headers"] = [(b"if-none-match", known.encode())]

        async def send(message: dict[str, Any]) -> None:
            sent.append(message)

        async def receive() -> dict[str, Any]:
            return {"type": "http.request", "body": b"", "more_body": False}

        asyncio.run(self.layer(scope, receive, send))  # type: ignore[arg-type]
        body = b"".join(message.get("body", b"") for message in sent[1:])
        return sent[0]["status"], body, dict(sent[0]["headers"]), scope.get("route")


def test_a_kept_list_is_renewed_only_after_a_change_of_what_it_depends_on() -> None:
    bench = Bench()
    for _ in range(3):
        assert bench.ask()[:2] == (200, b"[]")
    assert bench.ask()[3] == "the route", "metrics name it"
    assert bench.application.asked == 1
    bench.counters = {"machines": 5}
    bench.ask()
    assert bench.application.asked == 1
    bench.application.body = b"[1]"
    bench.counters = {"machines": 5, "jobs": 1}
    assert bench.ask()[:2] == (200, b"[1]")


def test_queries_and_askers_have_answers_of_their_own() -> None:
    bench = Bench()
    for query, who in ((b"", LOCAL), (b"limit=1", LOCAL), (b"", BOUND), (b"limit=1", BOUND)):
        bench.application.body = f"[{bench.application.asked}]".encode()
        bench.ask(query=query, who=who)
    assert [bench.ask(query=q, who=w)[1] for w in (LOCAL, BOUND) for q in (b"", b"limit=1")] == [
        b"[0]", b"[1]", b"[2]", b"[3]",
    ]  # fmt: skip
    bench.ask(who=None)
    assert bench.application.asked == 5, "somebody unknown gets nothing from memory"


@pytest.mark.parametrize("path", ["/api/status", "/api/live", "/api/jobs/job-1", "/other/jobs"])
def test_live_values_and_changes_are_not_kept(path: str) -> None:
    bench = Bench()
    bench.ask(path)
    bench.ask(path)
    bench.ask("/api/jobs", verb="POST")
    assert bench.application.asked == 3


def test_a_refusal_and_what_is_too_large_are_passed_on_and_not_kept() -> None:
    bench = Bench()
    bench.application.status = 422
    assert [bench.ask()[0], bench.ask()[0]] == [422, 422]
    bench.application.status, bench.application.body = 200, b"x" * (LARGEST_BYTES + 1)
    assert bench.ask()[1] == bench.ask()[1] == bench.application.body
    assert bench.application.asked == 4


def test_a_known_etag_is_answered_with_304() -> None:
    bench = Bench()
    _, _, headers, _ = bench.ask()
    tag = headers[b"etag"].decode()
    for known in (tag, tag.removeprefix("W/"), f'"other", {tag}', "*"):
        status, body, sent, _ = bench.ask(known=known)
        assert (status, body, sent[b"etag"].decode()) == (304, b"", tag)
        assert b"content-length" not in sent
    assert bench.ask(known='"other"')[0] == 200


def test_without_a_store_the_route_says_so() -> None:
    bench = Bench()

    async def gone() -> dict[str, int]:
        raise OperationalError("SELECT", {}, Exception("gone"))

    bench.layer = KeptAnswers(bench.application, LISTS, gone)
    bench.application.status = 503
    assert bench.ask()[0] == 503


def test_simultaneous_requests_read_the_store_once() -> None:
    bench = Bench()
    inner = bench.application

    async def run() -> list[bytes]:
        go = asyncio.Event()

        async def slow(scope: Any, receive: Any, send: Any) -> None:
            await go.wait()
            bench.counters = {"jobs": bench.counters.get("jobs", 0) + 1}  # it changes faster than it is made
            await inner(scope, receive, send)

        layer, bodies = KeptAnswers(slow, LISTS, bench.read), []

        async def ask() -> None:
            sent: list[dict[str, Any]] = []

            async def send(message: dict[str, Any]) -> None:
                sent.append(message)

            scope = {"type": "http", "method": "GET", "path": "/api/jobs", "query_string": b"", "headers": []}
            await layer(scope | {"hilfit.principal": LOCAL}, None, send)  # type: ignore[arg-type]
            bodies.append(sent[1]["body"])

        tasks = [asyncio.create_task(ask()) for _ in range(10)]
        await asyncio.sleep(0)
        go.set()
        await asyncio.gather(*tasks)
        return bodies

    assert asyncio.run(run()) == [b"[]"] * 10
    assert inner.asked == 1
