"""Bounds of one connection: uvicorn's protocol, with limits of headers, waiting and connections.

httptools hands headers over when they are whole, however long they are and however long that takes; uvicorn bounds only
how long a connection may rest between two requests. Here a request's line and headers have a size and a time, a body
may not stand still, and connections are counted. What is refused is told by a problem document, also what is no HTTP.
"""

from __future__ import annotations

import asyncio
import json
from dataclasses import dataclass
from typing import Any

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from daq.messages import Sentence
from server.platform.http.problems import status_phrase


@dataclass(frozen=True)
class HttpLimits:
    """Bounds of connections.

    Attributes
    ----------
    header_bytes : of a request's line and headers, and of what follows its body; four times what browsers send at most
    headers : of a request
    header_s : s from a request's first byte, or from connecting, to the end of its headers
    body_idle_s : s that a body may stand still while it is waited for
    connections : at once, WebSockets included
    """

    header_bytes: int = 64 * 2**10
    headers: int = 100
    header_s: float = 10.0
    body_idle_s: float = 30.0
    connections: int = 512


class BoundedHttp(HttpToolsProtocol):
    """One connection within :attr:`limits`."""

    limits = HttpLimits()

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._timer: asyncio.TimerHandle | None = None
        self._awaits_body = False
        self._refused = False
        self._pending = 0  # bytes since the request began, while its headers are not whole
        self._header_bytes = 0
        self._header_count = 0

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Note that a connection came."""
        super().connection_made(transport)
        if len(self.connections) > self.limits.connections:
            self._refuse(503, Sentence("server.too_many_connections"), ((b"retry-after", b"5"),))
            return
        self._start(self.limits.header_s)

    def connection_lost(self, exc: Exception | None) -> None:
        """Note that it went."""
        self._stop()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Read bytes of a request, or of several."""
        if self._refused:
            return
        if self._awaits_body:
            self._start(self.limits.body_idle_s)
        else:
            if self._timer is None:  # the first bytes of another request
                self._start(self.limits.header_s)
            self._pending += len(data)
        super().data_received(data)
        if self._pending > self.limits.header_bytes:
            self._too_large()

    def handle_websocket_upgrade(self) -> None:
        """Hand over to a WebSocket from here on."""
        self._stop()
        if not self._refused:
            super().handle_websocket_upgrade()

    def send_400_response(self, msg: str) -> None:
        """Refuse what is no HTTP."""
        if not self._refused:
            self._refuse(400, Sentence("server.no_request_of_http"))

    def on_header(self, name: bytes, value: bytes) -> None:
        """Note a whole header, or one that follows a body."""
        self._header_count += 1
        self._header_bytes += len(name) + len(value) + 4
        if self._header_bytes > self.limits.header_bytes or self._header_count > self.limits.headers:
            self._too_large()
            raise ValueError("too many headers")  # nothing more of this connection is parsed
        super().on_header(name, value)

    def on_headers_complete(self) -> None:
        """Note that the request can be answered."""
        self._pending = 0
        if len(self.url) > self.limits.header_bytes:
            self._too_large()
            raise ValueError("too long a line")
        self._awaits_body = True
        self._start(self.limits.body_idle_s)
        super().on_headers_complete()

    def on_message_complete(self) -> None:
        """Note that the body is whole; how long the answer takes is ours."""
        self._awaits_body = False
        self._pending = self._header_bytes = self._header_count = 0
        self._stop()
        super().on_message_complete()

    def _too_large(self) -> None:
        self._refuse(431, Sentence("server.head_too_long", header_bytes=self.limits.header_bytes))

    def _start(self, seconds: float) -> None:
        self._stop()
        self._timer = self.loop.call_later(seconds, self._late)

    def _stop(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _late(self) -> None:
        self._timer = None
        if self._awaits_body and self.flow.read_paused:  # it is we who do not read
            self._start(self.limits.body_idle_s)
        elif self._awaits_body and self.cycle is not None and self.cycle.response_started:
            self.transport.close()
        else:
            self._refuse(408, Sentence("server.request_not_in_time"))

    def _refuse(self, status: int, detail: Sentence, more: tuple[tuple[bytes, bytes], ...] = ()) -> None:
        """Answer with a problem document (RFC 9457) and hang up."""
        if self._refused or self.transport.is_closing():
            return
        self._refused = True
        self._stop()
        phrase = status_phrase(status)
        slug = phrase.lower().replace(" ", "-")
        content = {"type": f"urn:hilfit:problem:{slug}", "title": phrase, "status": status, "detail": detail}
        body = json.dumps({**content, "instance": "/", "message": detail.to_json()}).encode()
        headers = [
            (b"content-type", b"application/problem+json"),
            (b"content-length", str(len(body)).encode()),
            (b"x-content-type-options", b"nosniff"),
            (b"connection", b"close"),
            *more,
        ]
        lines = b"".join(name + b": " + value + b"\r\n" for name, value in headers)
        self.transport.write(f"HTTP/1.1 {status} {phrase}\r\n".encode() + lines + b"\r\n" + body)
        self.transport.close()
