"""The ASGI layer in front of all routes: says who asks, limits how often, notes what was changed."""

from __future__ import annotations

import asyncio
import ipaddress
from collections.abc import Mapping
from contextlib import ExitStack
from typing import Any

import structlog
from fastapi.concurrency import run_in_threadpool
from sqlalchemy.exc import SQLAlchemyError
from starlette.datastructures import Headers
from starlette.requests import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from server.access.access_desk import Access
from server.access.connections import Stream
from server.access.rates import Rate, Rates
from server.audit.audit_resource import Audit
from server.platform.authorization.principals import Principal
from server.platform.errors import TooManyError, UnauthenticatedError
from server.platform.http.pages import CLOSED
from server.platform.http.problems import refused

#: WebSockets in browsers cannot send headers, but they can offer sub-protocols; this one carries the token.
BEARER = "bearer."
#: What an address that sent no known token has of a principal's rate, and its burst in seconds of that: enough for
#: the page's files, little for guessing.
STRANGERS_SHARE, STRANGERS_BURST_S = 0.05, 12.0
#: Pairing attempts of an address; of all together see :data:`server.access.pairing.MOST_FAILURES`.
PAIRING = Rate(1 / 6, 5)
PAIR_PATH = "/api/v1/access/pair"
#: All that is answered to somebody unknown, besides the page's own files and health.
OPEN = (PAIR_PATH, "/api/v1/openapi.json")
#: Answers that refuse somebody: not allowed, or not there for them. So many of one principal are noted.
_REFUSED = (403, 404)
_REFUSALS = Rate(1 / 6, 60)
_READING = ("GET", "HEAD", "OPTIONS")
_log = structlog.stdlib.get_logger(__name__)


class Gate:
    """Puts the principal into the scope as ``hilfit.principal`` (None: nobody known).

    Parameters
    ----------
    actions : what a call of an endpoint is called in the audit log
    rate : of each principal; whoever is at this computer without access control is not limited
    """

    def __init__(
        self, app: ASGIApp, access: Access, audit: Audit, actions: Mapping[Any, str], rate: Rate, rates: Rates
    ) -> None:
        self._app = app
        self._access = access
        self._audit = audit
        self._actions = actions
        self._rate = rate
        slow = STRANGERS_SHARE * rate.per_second
        self._strangers = Rate(slow, max(20, round(STRANGERS_BURST_S * slow)))
        self._rates = rates

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, unless there were too many."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        address = (scope.get("client") or ("unknown",))[0]
        principal = await self._principal(scope)
        seconds = self._wait(scope, principal, address)
        if seconds and scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1013})  # before it is accepted: the client sees 403
            return
        if seconds:
            error = TooManyError("server.too_many_requests", seconds=seconds)
            await refused(Request(scope), error, {"Retry-After": str(seconds)})(scope, receive, send)
            return
        if principal is None and scope["path"].startswith(CLOSED) and scope["path"] not in OPEN:
            await self._refuse(scope, receive, send)
            return
        scope["hilfit.principal"] = principal
        if principal is not None and principal.kind in ("device", "key"):
            self._access.connections.note(principal.id, self._access.now(), address)
            await self._while_valid(principal, scope, receive, send)
            return
        await self._pass(principal, scope, receive, send)

    async def _while_valid(self, principal: Principal, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on; a stream that it opens ends with the token."""
        access = self._access
        with ExitStack() as open_streams:
            stream = Stream()

            def opened() -> None:
                expires = access.expires(_token(scope) or "")
                open_streams.enter_context(access.connections.stream(principal.id, stream, access.now(), expires))

            async def sending(message: Message) -> None:
                if message["type"] == "http.response.start" and _is_stream(message):
                    opened()
                await send(message)

            if scope["type"] == "websocket":
                opened()
            try:
                await self._pass(principal, scope, receive, sending)
            except asyncio.CancelledError:
                if not stream.ended:
                    raise
                task = asyncio.current_task()
                assert task is not None
                task.uncancel()
                if scope["type"] == "websocket":
                    await send({"type": "websocket.close", "code": 1008, "reason": "the token is no longer valid"})
                else:
                    await send({"type": "http.response.body", "body": b"", "more_body": False})

    async def _pass(self, principal: Principal | None, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "websocket" or scope["method"] in _READING or principal is None:
            await self._app(scope, receive, send)
            return
        await self._noted(principal, scope, receive, send)

    async def _refuse(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})
            return
        unknown = UnauthenticatedError("server.pair_device_first_send")
        await refused(Request(scope), unknown)(scope, receive, send)

    async def _principal(self, scope: Scope) -> Principal | None:
        if not self._access.required:
            return self._access.principal(None)
        token = _token(scope)
        if token is None:
            return None
        known = self._access.known(token)
        return known if known is not None else await run_in_threadpool(self._access.principal, token)

    def _wait(self, scope: Scope, principal: Principal | None, address: str) -> int:
        if scope["path"] == PAIR_PATH:
            return self._rates.wait(f"pairing {_network(address)}", PAIRING)
        if principal is None:
            return self._rates.wait(f"address {_network(address)}", self._strangers)
        return 0 if principal.kind == "local" else self._rates.wait(f"principal {principal.id}", self._rate)

    async def _noted(self, principal: Principal, scope: Scope, receive: Receive, send: Send) -> None:
        status, made = 500, None

        async def sending(message: Message) -> None:
            nonlocal status, made
            if message["type"] == "http.response.start":
                status = message["status"]
                made = Headers(raw=message["headers"]).get("location")
            await send(message)

        try:
            await self._app(scope, receive, sending)
        finally:
            action = self._actions.get(scope.get("endpoint"))
            refused = status in _REFUSED and not self._rates.wait(f"refused {principal.id}", _REFUSALS)
            if action is not None and (status < 400 or refused):
                detail = {"status": status} | ({"location": made} if made else {})
                try:
                    await run_in_threadpool(self._audit.write, principal, action, scope["path"], detail)
                except SQLAlchemyError as error:  # what was done is done; the log of the service says it too
                    _log.error("audit_failed", action=action, subject=scope["path"], exc_info=error)


def _network(address: str) -> str:
    """Return a stranger's network: an IPv4 address, or the /64 of an IPv6 one (RFC 4291 section 2.5.4)."""
    try:
        found = ipaddress.ip_address(address)
    except ValueError:
        return address
    return address if found.version == 4 else str(ipaddress.ip_network((address, 64), strict=False))


def _is_stream(start: Message) -> bool:
    return Headers(raw=start["headers"]).get("content-type", "").startswith("text/event-stream")


def _token(scope: Scope) -> str | None:
    headers = Headers(scope=scope)
    kind, _, token = headers.get("authorization", "").partition(" ")
    if kind.lower() == "bearer" and token:
        return token.strip()
    if scope["type"] == "websocket":
        for offered in scope.get("subprotocols", ()):
            if offered.startswith(BEARER):
                return str(offered).removeprefix(BEARER)
    return None
