"""ASGI layers around all routes: whose requests are taken, how large they may be, headers against guessing."""

from __future__ import annotations

import ipaddress
from collections.abc import Callable, Collection

from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from daq.messages import Sentence
from server.platform.errors import ForbiddenError, TooLargeError
from server.platform.http.problems import refused
from server.platform.settings import is_loopback

#: What is data is no page: nothing in it may do anything (Content Security Policy, level 3).
API_POLICY = "default-src 'none'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
#: The page loads its own files only and talks to its own service only. Its drawings set styles by the object model
#: (``element.style``), which a policy does not govern; styles written in markup are refused.
PAGE_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; "
    "font-src 'self'; connect-src 'self'; manifest-src 'self'; frame-src 'self' blob:; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)


#: Scheme of the page's origin by that of a request.
_SCHEMES = {"http": "http", "https": "https", "ws": "http", "wss": "https"}


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
        text = Sentence("server.request_larger_bytes_most", limit=limit)
        declared = Headers(scope=scope).get("content-length", "0")
        if declared.isdecimal() and int(declared) > limit:
            await refused(Request(scope), TooLargeError(text))(scope, receive, send)
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
    ``http://127.0.0.1`` (then ``Origin`` is not ours, or ``Sec-Fetch-Site`` says so), or let its own name point here
    (then ``Host`` is that name). WebSockets are judged alike: browsers open them to anywhere.

    Parameters
    ----------
    hosts : names, or names with a port, that other computers use; ``Host`` may also be of this computer
    addresses : whether it may be any address (then a token is needed anyway); no page can point its own address here
    """

    def __init__(self, app: ASGIApp, hosts: Collection[str] = (), addresses: bool = False) -> None:
        self._app = app
        self._hosts = frozenset(host.lower() for host in hosts)
        self._addresses = addresses

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on if it is from a program or a page of ours."""
        if scope["type"] in ("http", "websocket"):
            headers = Headers(scope=scope)
            host = headers.get("host", "")
            refusal = None
            if not self._ours(host):
                refusal = Sentence("server.no_name_service", host=host)
            elif _from_elsewhere(scope, headers, f"{_SCHEMES[scope['scheme']]}://{host}"):
                refusal = Sentence("server.requests_taken_programs_pages")
            if refusal is not None and scope["type"] == "websocket":
                await send({"type": "websocket.close", "code": 1008})  # before it is accepted: the client sees 403
                return
            if refusal is not None:
                await refused(Request(scope), ForbiddenError(refusal))(scope, receive, send)
                return
        await self._app(scope, receive, send)

    def _ours(self, host: str) -> bool:
        name = _name(host)
        if is_loopback(name) or host.lower() in self._hosts or name.lower() in self._hosts:
            return True
        return self._addresses and _is_address(name)


def _from_elsewhere(scope: Scope, headers: Headers, own: str) -> bool:
    """Test whether a browser names a page of another origin than ``own`` as a request's sender."""
    if headers.get("origin", own).lower() != own.lower():
        return True
    # Browsers leave Origin out where a page may not say its own; what they say of the site they always say (Fetch
    # Metadata). A link from elsewhere to a page of ours is cross-site as well, and only reads.
    changes = scope["type"] == "websocket" or scope["method"] not in ("GET", "HEAD", "OPTIONS")
    return changes and headers.get("sec-fetch-site", "none") not in ("same-origin", "none")


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def _name(host: str) -> str:
    """Return the name or address in a ``Host`` header, without the port (RFC 9110 section 7.2)."""
    if host.startswith("["):
        return host[1:].partition("]")[0]
    return host.partition(":")[0]


class SafeHeaders:
    """Adds headers that keep browsers from sniffing types, framing pages and sending referrers."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, adding to its response."""
        api = str(scope.get("path", "")).startswith(("/api/", "/metrics", "/healthz", "/livez", "/readyz"))

        async def sending(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                headers["X-Content-Type-Options"] = "nosniff"
                headers["Referrer-Policy"] = "no-referrer"
                headers.setdefault("Content-Security-Policy", API_POLICY if api else PAGE_POLICY)
                headers.setdefault("X-Frame-Options", "DENY")
            await send(message)

        await self._app(scope, receive, sending)
