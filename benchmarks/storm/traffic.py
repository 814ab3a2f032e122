"""The clients of a storm: they order, record and note what they were told, and ask again where no answer came."""

from __future__ import annotations

import http.client
import json
import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any
from urllib.parse import urlsplit

API = "/api/v1"
#: Jobs that may be open before no more are ordered.
MOST_OPEN = 6
PATIENCE_S = 15.0


class NoAnswerError(Exception):
    """The server was gone, or is still starting."""


@dataclass
class Told:
    """What the server acknowledged.

    Attributes
    ----------
    orders : key of an order -> id of the identification that was made
    rows : id of a recording -> most rows that the server said were recorded
    answers : how many by status; 0: none came
    real : keys of those orders whose identifications are real ones
    undisturbed : id of a real identification of the same input, from before the storm
    """

    orders: dict[str, str] = field(default_factory=dict)
    rows: dict[str, int] = field(default_factory=dict)
    answers: dict[int, int] = field(default_factory=dict)
    real: list[str] = field(default_factory=list)
    undisturbed: str = ""


class Client:
    """Asks whatever server there is at the moment."""

    def __init__(self, address: Callable[[], str | None], told: Told) -> None:
        self._address = address
        self._told = told
        self._lock = threading.Lock()

    def ask(self, method: str, path: str, content: Any = None, headers: dict[str, str] | None = None) -> Any:
        """The status and JSON of one answer; NoAnswerError if none came."""
        address = self._address()
        if address is None:
            raise NoAnswerError
        place = urlsplit(address)
        connection = http.client.HTTPConnection(place.hostname or "", place.port, timeout=PATIENCE_S)
        body = content if isinstance(content, bytes) or content is None else json.dumps(content).encode()
        kind = {"Content-Type": "application/json"} if body is not None else {}
        try:
            connection.request(method, API + path, body, kind | (headers or {}))
            answer = connection.getresponse()
            read = answer.read()
            self._count(answer.status)
            return answer.status, json.loads(read) if read else None
        except (OSError, http.client.HTTPException, ValueError):
            self._count(0)
            raise NoAnswerError from None
        finally:
            connection.close()

    def _count(self, status: int) -> None:
        with self._lock:
            self._told.answers[status] = self._told.answers.get(status, 0) + 1


class Traffic:
    """Orders identifications and makes recordings until stopped, each in a thread of its own.

    Parameters
    ----------
    recording : of which identifications are made
    """

    def __init__(self, client: Client, told: Told, machine: str, recording: str) -> None:
        self._client = client
        self._told = told
        self._machine = machine
        self._recording = recording
        self._stop = threading.Event()
        self._threads = [threading.Thread(target=run, daemon=True) for run in (self._order, self._record)]

    def start(self) -> None:
        """Start."""
        for thread in self._threads:
            thread.start()

    def stop(self) -> None:
        """Stop; what is under way is followed to its answer first, as long as there is a server."""
        self._stop.set()
        for thread in self._threads:
            thread.join()

    def _order(self) -> None:
        number = 0
        while not self._stop.is_set():
            key = f"storm-{number}"
            body = {"machine": self._machine, "recordings": [{"id": self._recording}], "label": key}
            made = self._until(partial(self._ordered, key, body))
            if made is not None:
                self._told.orders[key] = made
                number += 1
            self._stop.wait(0.3)

    def order_real(self, count: int, order: dict[str, Any]) -> None:
        """Order so many real identifications; returns once there was an answer to each."""
        for number in range(count):
            key = f"storm-real-{number}"
            made = self._until(partial(self._ordered, key, order | {"label": key}, math.inf))
            if made is not None:
                self._told.orders[key] = made
                self._told.real.append(key)

    def _ordered(self, key: str, body: dict[str, Any], most: float = MOST_OPEN) -> str | None:
        _, status = self._client.ask("GET", "/status")
        if sum(status["jobs"].get(state, 0) for state in ("queued", "running")) >= most:
            return None
        code, answer = self._client.ask("POST", "/identifications", body, {"Idempotency-Key": key})
        return str(answer["id"]) if code == 202 else None

    def _until(self, do: Callable[[], str | None]) -> str | None:
        """Ask until there is an answer: the same key makes nothing twice. None if told to stop without one."""
        while True:
            try:
                made = do()
            except NoAnswerError:
                made = None
            if made is not None or self._stop.wait(0.2):
                return made

    def _record(self) -> None:
        number = 0
        while not self._stop.is_set():
            # Some end by themselves, some run until something dies; some seconds are left for the schedules.
            seconds = (8.0, 30.0, 3.0)[number % 3]
            body = {"machine": self._machine, "role": "operation", "label": f"storm {number}", "seconds": seconds}
            try:
                code, answer = self._client.ask("POST", "/recordings", body)
                if code == 201:
                    number += 1
                    self._told.rows[answer["id"]] = 0
                    self._follow(answer["id"])
                    self._stop.wait(2.0)
            except NoAnswerError:
                pass
            self._stop.wait(0.3)

    def _follow(self, id: str) -> None:
        """Note how many rows the server says are safe, until the recording is over or the server is."""
        while not self._stop.is_set():
            _, row = self._client.ask("GET", f"/recordings/{id}")
            self._told.rows[id] = max(self._told.rows[id], int(row["statistics"].get("rows") or 0))
            if row["state"] != "recording":
                return
            time.sleep(0.1)
