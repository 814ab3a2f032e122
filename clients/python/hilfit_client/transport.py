"""Requests to the service, on the standard library alone."""

from __future__ import annotations

import http.client
import json
from collections.abc import Iterator, Mapping
from typing import IO, Any
from urllib.error import HTTPError
from urllib.parse import quote, urlencode
from urllib.request import ProxyHandler, Request, build_opener


class ProblemError(Exception):
    """The service refused a request: a problem document (RFC 9457).

    Attributes
    ----------
    status, title, detail : as in the document; ``detail`` is one line that says what to do
    code, values : what it was, and what that is about, for programs
    document : all of it
    """

    def __init__(self, status: int, document: dict[str, Any]) -> None:
        self.status = status
        self.title = str(document.get("title", ""))
        self.detail = str(document.get("detail", ""))
        self.code = str(document.get("code", ""))
        self.values: dict[str, Any] = dict(document.get("values") or {})
        self.document = document
        super().__init__(f"{status} {self.title}: {self.detail}")


class Transport:
    """Sends requests to one service.

    Parameters
    ----------
    url : like ``http://192.168.1.20:8350``
    token : of a paired device, or an API key; None on the service's own computer without access control
    timeout_s : of one request; a stream may be silent for as long
    """

    def __init__(self, url: str, token: str | None = None, timeout_s: float = 60.0) -> None:
        self._url = url.rstrip("/")
        self._token = token
        self._timeout_s = timeout_s
        # A service on the machine's own network is not behind the office's proxy.
        self._opener = build_opener(ProxyHandler({}))
        #: ``ETag`` of the last answer, for ``if_match``; None if it had none.
        self.etag: str | None = None

    def quoted(self, part: str) -> str:
        """Quote a part of a path."""
        return quote(part, safe="")

    def json(self, method: str, path: str, **sent: Any) -> Any:
        """Return the JSON that is answered."""
        return json.loads(self.content(method, path, **sent))

    def text(self, method: str, path: str, **sent: Any) -> str:
        """Return the text that is answered."""
        return self.content(method, path, **sent).decode()

    def content(self, method: str, path: str, **sent: Any) -> bytes:
        """Return the bytes that are answered."""
        with self._open(method, path, **sent) as answer:
            return answer.read()

    def nothing(self, method: str, path: str, **sent: Any) -> None:
        """Send a request with an empty answer."""
        self.content(method, path, **sent)

    def events(self, method: str, path: str, **sent: Any) -> Iterator[dict[str, Any]]:
        """Yield server-sent events with JSON in them, until the service ends the stream."""
        with self._open(method, path, **sent) as answer:
            for line in answer:
                if line.startswith(b"data:"):
                    yield json.loads(line[5:])

    def _open(
        self,
        method: str,
        path: str,
        *,
        query: Mapping[str, Any] | None = None,
        headers: Mapping[str, str | None] | None = None,
        json: dict[str, Any] | None = None,
        content: bytes | None = None,
    ) -> IO[bytes]:
        asked = {key: str(value) for key, value in (query or {}).items() if value is not None}
        url = self._url + path + (f"?{urlencode(asked)}" if asked else "")
        sent = {key: value for key, value in (headers or {}).items() if value is not None}
        if json is not None:
            content = _dumped(json)
            sent["Content-Type"] = "application/json"
        elif content is not None:
            sent["Content-Type"] = "application/octet-stream"
        if self._token is not None:
            sent["Authorization"] = f"Bearer {self._token}"
        try:
            answer: http.client.HTTPResponse = self._opener.open(
                Request(url, content, sent, method=method), timeout=self._timeout_s
            )
        except HTTPError as error:
            with error:
                raise ProblemError(error.code, _document(error.read())) from None
        self.etag = answer.headers.get("ETag")
        return answer


def _dumped(content: dict[str, Any]) -> bytes:
    return json.dumps(content).encode()


def _document(content: bytes) -> dict[str, Any]:
    """Parse a problem document; one from between us and the service is one too."""
    try:
        found = json.loads(content)
    except ValueError:
        found = None
    return found if isinstance(found, dict) else {"detail": content[:200].decode(errors="replace")}
