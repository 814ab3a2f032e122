"""The web page: built files that are data of this package, served from memory.

Only what was there at the start is served, under the name that it had: no path of a request ever reaches the file
system. Names below ``assets/`` hold a hash of the content, so what a browser has of them is good for ever; the page
itself and its texts are asked for each time (RFC 9111 section 5.2.2, RFC 8246).
"""

from __future__ import annotations

import gzip
import hashlib
import mimetypes
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files
from importlib.resources.abc import Traversable

from starlette.datastructures import Headers
from starlette.requests import Request
from starlette.responses import Response
from starlette.types import ASGIApp, Receive, Scope, Send

from daq.messages import Sentence
from server.platform.http.problems import problem

INDEX, NOT_FOUND = "index.html", "404.html"
FOR_EVER, EACH_TIME = "public, max-age=31536000, immutable", "no-cache"
#: Beginnings of paths that are answered only to whom is known.
CLOSED = ("/api/", "/metrics")
#: Paths of programs: what is not there is told by a problem document.
OF_PROGRAMS = (*CLOSED, "/healthz", "/livez", "/readyz")
#: Bytes below which compressing is not worth its headers.
_WORTH_COMPRESSING = 600
_READING = ("GET", "HEAD")
#: Types by suffix that an operating system's table may lack or have wrong.
_TYPES = {".js": "text/javascript", ".svg": "image/svg+xml", ".json": "application/json", ".woff2": "font/woff2"}


@dataclass(frozen=True)
class PageFile:
    """A built file as it is sent.

    Attributes
    ----------
    cache : ``Cache-Control``
    """

    content: bytes
    media_type: str
    etag: str
    cache: str

    @classmethod
    def of(cls, name: str, content: bytes) -> PageFile:
        """Build it from a built file's name, relative to the page's folder, and its content."""
        suffix = name[name.rfind(".") :]
        media_type = _TYPES.get(suffix) or mimetypes.types_map.get(suffix, "application/octet-stream")
        if media_type.startswith("text/"):
            media_type += "; charset=utf-8"
        return cls(
            content=content,
            media_type=media_type,
            etag=f'"{hashlib.sha256(content).hexdigest()[:32]}"',
            cache=FOR_EVER if name.startswith("assets/") else EACH_TIME,
        )

    @cached_property
    def compressed(self) -> bytes | None:
        """The same by gzip, made when first asked for; None where that gains nothing."""
        if len(self.content) < _WORTH_COMPRESSING:
            return None
        compressed = gzip.compress(self.content, 9, mtime=0)
        return compressed if len(compressed) < len(self.content) else None

    def response(self, headers: Headers, status: int = 200) -> Response:
        """Answer a request with ``headers``."""
        sent = {"ETag": self.etag, "Cache-Control": self.cache, "Vary": "Accept-Encoding"}
        if _takes_gzip(headers.get("accept-encoding", "")) and self.compressed is not None:
            return Response(self.compressed, status, {**sent, "Content-Encoding": "gzip"}, self.media_type)
        return Response(self.content, status, sent, self.media_type)


def page_files(base: str = "") -> Mapping[str, PageFile]:
    """Read all built files of this package by name, ``index.html`` or ``assets/page-0123abcd.js``.

    Parameters
    ----------
    base : path that the service is below
    """
    found = {name: file.read_bytes() for name, file in _walk(files("server") / "web" / "dist", "")}
    if NOT_FOUND in found:  # of any path, so its links cannot be relative, as those of all others are
        found[NOT_FOUND] = found[NOT_FOUND].replace(b'href="/', f'href="{base}/'.encode())
    return {name: PageFile.of(name, content) for name, content in found.items()}


class Pages:
    """Answers what no route takes: the page's files, then its own 404; programs get ``otherwise``.

    Parameters
    ----------
    built : the page's files by their names
    otherwise : answers requests of programs and WebSockets
    """

    def __init__(self, built: Mapping[str, PageFile], otherwise: ASGIApp) -> None:
        self._built = built
        self._otherwise = otherwise

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request."""
        path = str(scope.get("path", ""))
        if scope["type"] != "http" or path.startswith(OF_PROGRAMS) or INDEX not in self._built:
            await self._otherwise(scope, receive, send)
            return
        request = Request(scope)
        if scope["method"] not in _READING:
            text = Sentence("server.not_possible_here", scope=scope["method"])
            answer: Response = problem(request, 405, text, headers={"Allow": ", ".join(_READING)})
        else:
            answer = self._page(path.removeprefix("/") or INDEX, request.headers)
        await answer(scope, receive, send)

    def _page(self, name: str, headers: Headers) -> Response:
        found = self._built.get(name)
        if found is not None and name != NOT_FOUND:
            return found.response(headers)
        missing = self._built.get(NOT_FOUND)
        return Response("not found", 404) if missing is None else missing.response(headers, 404)


def _walk(folder: Traversable, prefix: str) -> Iterator[tuple[str, Traversable]]:
    if not folder.is_dir():
        return  # a source tree in which the page was not built
    for entry in sorted(folder.iterdir(), key=lambda entry: entry.name):
        if entry.is_dir():
            yield from _walk(entry, f"{prefix}{entry.name}/")
        else:
            yield prefix + entry.name, entry


def _takes_gzip(accepted: str) -> bool:
    """Test whether ``Accept-Encoding`` takes gzip (RFC 9110 section 12.5.3)."""
    for part in accepted.split(","):
        coding, _, weight = part.partition(";")
        if coding.strip().lower() in ("gzip", "*"):
            return weight.replace(" ", "").lower() not in ("q=0", "q=0.0", "q=0.00", "q=0.000")
    return False
