"""The ASGI layer that lets the whole service stand below a path of a reverse proxy, ``/hilfit`` say.

Within, paths are what they are without it; nobody else has to know where the service stands, but who writes an address
down asks :func:`below`. Proxies that cut the path off and those that leave it are served alike.
"""

from __future__ import annotations

from urllib.parse import urlsplit

from starlette.datastructures import MutableHeaders
from starlette.responses import RedirectResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

#: No path, or names that need no quoting; a setting has to match it.
BASE_PATH = r"^(/[A-Za-z0-9_~-][A-Za-z0-9._~-]*)*$"
_KEY = "hilfit.base_path"


def below(scope: Scope, path: str) -> str:
    """Prefix a path of this service, ``/api/v1/jobs``, as a request's sender has to ask for it."""
    return f"{scope.get(_KEY, '')}{path}"


class BasePath:
    """Takes the base path off requests, and puts it before each ``Location``.

    Parameters
    ----------
    base : ``/hilfit``, without a slash behind it; empty where there is none
    """

    def __init__(self, app: ASGIApp, base: str) -> None:
        self._app = app
        self._base = base

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on."""
        if not self._base or scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        path = scope["path"]
        if path == self._base and scope["type"] == "http":  # files of the page are named relative to it
            await RedirectResponse(f"{self._base}/", 308)(scope, receive, send)
            return
        scope[_KEY] = self._base
        if path.startswith(f"{self._base}/"):
            scope["path"] = path.removeprefix(self._base)
            scope["raw_path"] = scope.get("raw_path", b"").removeprefix(self._base.encode())

        async def sending(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                if "location" in headers:
                    found = urlsplit(headers["location"])
                    headers["location"] = found._replace(path=self._base + found.path).geturl()
            await send(message)

        await self._app(scope, receive, sending)
