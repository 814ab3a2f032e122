"""ASGI layers that spare answers: one keeps those to lists until what they list changes, one leaves out their bodies.

Tablets ask for the same lists again and again. Every write of the store counts a revision of what it changed; as long
as the counters that a list depends on stand still, its last answer is true, and neither a thread, the store nor
pydantic has to be asked. What another host wrote is seen when the counters are read again
(:data:`server.live.revisions.POLL_S`).
"""

from __future__ import annotations

import asyncio
import hashlib
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from typing import Any
from weakref import WeakValueDictionary

from sqlalchemy.exc import SQLAlchemyError
from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from server.platform.authorization.principals import Principal

#: Answers that are kept, and the largest: queries are a client's to choose.
MOST, LARGEST_BYTES = 256, 2**18
Stamp = tuple[int, ...]
Key = tuple[str, bytes, tuple[str, ...] | None]


@dataclass(frozen=True)
class _Kept:
    """An answer; ``stamp``: the counters that it depends on, read before it was made; ``route`` is for metrics."""

    stamp: Stamp
    headers: list[tuple[bytes, bytes]]
    body: bytes
    route: Any


class KeptAnswers:
    """Answers lists that did not change; everything else is passed on.

    Parameters
    ----------
    lists : per path the revision counters that its answer depends on
    revisions : reads the revision counters, as new as this process's own writes
    """

    def __init__(
        self,
        app: ASGIApp,
        lists: Mapping[str, tuple[str, ...]],
        revisions: Callable[[], Awaitable[Mapping[str, int]]],
    ) -> None:
        self._app = app
        self._lists = lists
        self._revisions = revisions
        self._kept: dict[Key, _Kept] = {}
        self._making: WeakValueDictionary[Key, asyncio.Lock] = WeakValueDictionary()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or pass it on."""
        depends = self._lists.get(scope["path"]) if scope["type"] == "http" and scope["method"] == "GET" else None
        principal = scope.get("hilfit.principal")
        if depends is None or not isinstance(principal, Principal):
            await self._app(scope, receive, send)
            return
        key = (scope["path"], scope["query_string"], principal.machines)
        try:
            asked = await self._stamp(depends)
            answer: _Kept | list[Message] | None = self._true(key, asked)
            if answer is None:
                # When a list changes many ask at once; one of them asks the store, and the others wait for that answer.
                # It need be as new as the moment at which they asked, no newer: a list that changes faster than it is
                # made would else be made for each in turn.
                async with self._making.setdefault(key, asyncio.Lock()):
                    answer = self._true(key, asked)
                    if answer is None:
                        answer = await self._made(scope, receive, key, await self._stamp(depends))
        except SQLAlchemyError:  # the route says it in a problem document
            await self._app(scope, receive, send)
            return
        if isinstance(answer, list):
            for message in answer:
                await send(message)
            return
        scope["route"] = answer.route
        # A copy: layers around this one add headers of their own.
        await send({"type": "http.response.start", "status": 200, "headers": list(answer.headers)})
        await send({"type": "http.response.body", "body": answer.body})

    async def _stamp(self, depends: tuple[str, ...]) -> Stamp:
        counters = await self._revisions()
        return tuple(counters.get(name, 0) for name in depends)

    def _true(self, key: Key, asked: Stamp) -> _Kept | None:
        """Return the kept answer, if it was made when nothing was older than ``asked``."""
        kept = self._kept.get(key)
        new = kept is not None and all(had >= need for had, need in zip(kept.stamp, asked, strict=True))
        return kept if new else None

    async def _made(self, scope: Scope, receive: Receive, key: Key, stamp: Stamp) -> _Kept | list[Message]:
        """Call the route, keep its answer; return it as it is if it is no list, or too large."""
        messages: list[Message] = []

        async def holding(message: Message) -> None:
            messages.append(message)

        await self._app(scope, receive, holding)
        body = b"".join(message.get("body", b"") for message in messages[1:])
        if not messages or messages[0]["status"] != 200 or len(body) > LARGEST_BYTES:
            return messages
        etag = f'W/"{hashlib.blake2b(body, digest_size=12).hexdigest()}"'.encode()
        headers = [*messages[0]["headers"], (b"etag", etag), (b"cache-control", b"private, no-cache")]
        kept = _Kept(stamp, headers, body, scope.get("route"))
        self._kept.pop(key, None)
        self._kept[key] = kept
        if len(self._kept) > MOST:
            del self._kept[next(iter(self._kept))]
        return kept


class Conditional:
    """Asks for GET where HEAD was meant, and leaves out bodies that nobody needs (RFC 9110, 9.3.2 and 13.1.2)."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, and its answer back with or without a body."""
        if scope["type"] != "http" or scope["method"] not in ("GET", "HEAD"):
            await self._app(scope, receive, send)
            return
        head = scope["method"] == "HEAD"
        known = Headers(scope=scope).get("if-none-match", "")
        quiet = False

        async def sending(message: Message) -> None:
            nonlocal quiet
            if message["type"] == "http.response.start":
                quiet = head
                if message["status"] == 200 and _has(known, Headers(raw=message["headers"]).get("etag")):
                    quiet = True
                    kept = [pair for pair in message["headers"] if pair[0] not in (b"content-length", b"content-type")]
                    message = {**message, "status": 304, "headers": kept}
            elif quiet:
                message = {**message, "body": b""}
            await send(message)

        if head:
            scope["method"] = "GET"  # of this very scope: what the layers around tell of it stays with it
        await self._app(scope, receive, sending)


def _has(known: str, etag: str | None) -> bool:
    """Test whether a client that knows these tags has it; compared weakly."""
    tags = [tag.strip().removeprefix("W/") for tag in known.split(",")]
    return etag is not None and (etag.removeprefix("W/") in tags or tags == ["*"])
