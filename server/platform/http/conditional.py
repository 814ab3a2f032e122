"""The ASGI layer that answers HEAD as GET without a body, and 304 where a client has what would be sent."""

from __future__ import annotations

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send


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
