"""ASGI layers around all routes: whose requests are taken, how large they may be, headers against guessing."""

from __future__ import annotations

from collections.abc import Callable

from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from server.problems import problem
from server.settings import is_loopback


class BodyLimit:
    """Answers 413 to a request with more bytes than ``limit(path)``, whether it says so beforehand or not."""

    def __init__(self, app: ASGIApp, limit: Callable[[str], int]) -> None:
        self._app = app
        self._limit = limit

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, counting its bytes."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        limit = self._limit(scope["path"])
        text = f"the request is larger than {limit} bytes, the most that is taken here"
        declared = Headers(scope=scope).get("content-length", "0")
        if declared.isdecimal() and int(declared) > limit:
            await problem(Request(scope), 413, text, slug="too-large", title="Too large")(scope, receive, send)
            return
        received = 0

        async def counting() -> Message:
            nonlocal received
            message = await receive()
            received += len(message.get("body", b""))
            if received > limit:
                raise HTTPException(413, text)
            return message

        await self._app(scope, counting, send)


class OwnPagesOnly:
    """Answers 403 to a browser that a page from elsewhere sent here.

    Listening on this computer only does not keep out the web pages that its browser shows: one may post to
    ``http://127.0.0.1`` (then ``Origin`` is not ours), or let its own name point here (then ``Host`` is that name).
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on if it is from a program or a page of ours."""
        if scope["type"] == "http":
            headers = Headers(scope=scope)
            host, origin = headers.get("host", ""), headers.get("origin")
            if not is_loopback(_name(host)) or (origin is not None and origin.partition("://")[2] != host):
                text = "requests are taken from this computer and from pages of this service only"
                await problem(Request(scope), 403, text)(scope, receive, send)
                return
        await self._app(scope, receive, send)


def _name(host: str) -> str:
    """The name or address in a ``Host`` header, without the port (RFC 9110 section 7.2)."""
    if host.startswith("["):
        return host[1:].partition("]")[0]
    return host.partition(":")[0]


class SafeHeaders:
    """Adds headers that keep browsers from sniffing types, framing pages and sending referrers."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, adding to its response."""

        async def sending(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                headers["X-Content-Type-Options"] = "nosniff"
                headers["Referrer-Policy"] = "no-referrer"
                headers.setdefault("X-Frame-Options", "DENY")
            await send(message)

        await self._app(scope, receive, sending)
