"""A receiver of webhooks on the loopback interface; what it heard, and what it answers, is up to a test."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer


@dataclass
class Receiver:
    """What a receiver heard; ``answers`` are given in turn, the last one for ever, once ``hold`` is set."""

    port: int = 0
    answers: list[tuple[int, dict[str, str]]] = field(default_factory=lambda: [(200, {})])
    heard: list[tuple[str, dict[str, str], bytes]] = field(default_factory=list)
    hold: threading.Event | None = None
    changed: threading.Condition = field(default_factory=threading.Condition)

    def wait(self, count: int) -> None:
        """Wait until it heard that many requests."""
        with self.changed:
            assert self.changed.wait_for(lambda: len(self.heard) >= count, 60), self.heard


@contextmanager
def receiver() -> Iterator[Receiver]:
    """A receiver that runs."""
    found = Receiver()

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = self.rfile.read(int(self.headers["Content-Length"]))
            with found.changed:
                found.heard.append((self.path, {k.lower(): v for k, v in self.headers.items()}, body))
                status, headers = found.answers.pop(0) if len(found.answers) > 1 else found.answers[0]
                found.changed.notify_all()
            if found.hold is not None:
                found.hold.wait(60)
            with suppress(OSError):  # whoever asked was killed
                self._answer(status, headers)

        def _answer(self, status: int, headers: dict[str, str]) -> None:
            self.send_response(status)
            for name, value in headers.items():
                self.send_header(name, value)
            self.end_headers()

        def log_message(self, *_: object) -> None:
            """Says nothing."""

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    found.port = server.server_address[1]
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.05})
    thread.start()
    try:
        yield found
    finally:
        server.shutdown()
        thread.join()
        server.server_close()
