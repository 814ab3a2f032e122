"""Duties of every process of a simulated machine besides its job: take orders on stdin, report on stdout.

The first line on stdin is the configuration, every later one an order (both JSON). A child answers each with one line
on stdout. It ends when stdin closes, so it never outlives its parent. Nothing is taken from arguments or environment:
what only the plant may know reaches only the plant.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Mapping
from typing import Any

Order = Mapping[str, Any]
Handler = Callable[[Order], Any]


class Orders:
    """Orders from the parent; ``fileno`` becomes readable when one is there."""

    def __init__(self) -> None:
        self._buffer = b""
        self.closed = False

    def fileno(self) -> int:
        """Return the descriptor of stdin."""
        return 0

    def configuration(self) -> dict[str, Any]:
        """Block until the first line is there."""
        while b"\n" not in self._buffer:
            self._read()
            if self.closed:
                raise SystemExit(0)
        line, _, self._buffer = self._buffer.partition(b"\n")
        content: dict[str, Any] = json.loads(line)
        return content

    def _read(self) -> None:
        data = os.read(0, 1 << 16)
        self._buffer += data
        self.closed = self.closed or not data

    def work_off(self, handlers: Mapping[str, Handler]) -> None:
        """Read what is there, run each order's handler, answer."""
        self._read()
        while b"\n" in self._buffer:
            line, _, self._buffer = self._buffer.partition(b"\n")
            order = json.loads(line)
            try:
                answer = {"result": handlers[order["order"]](order)}
            except (KeyError, ValueError, TypeError) as error:
                answer = {"error": f"{type(error).__name__}: {error}"}
            report(answer)


def report(content: Mapping[str, Any]) -> None:
    """Report one line to the parent."""
    sys.stdout.write(json.dumps(content) + "\n")
    sys.stdout.flush()
