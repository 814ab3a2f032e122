"""The clients of a storm: they order, cancel, record and note what was acknowledged; no answer, and they ask again."""

from __future__ import annotations

import json
import math
import queue
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import httpx2

from benchmarks.service.hosts import API, FITTED, polled
from benchmarks.storm.stages import STAGES

#: Jobs that may be open before no more are ordered.
MOST_OPEN = 3
PATIENCE_S = 15.0
#: Where jobs are cancelled: before the first stage, and in each.
CANCELLED_IN = ("queue", *STAGES)


class _NoAnswerError(Exception):
    """The server was gone, is still starting, or answers that it cannot at the moment."""


@dataclass(frozen=True)
class Cancelled:
    """A cancel that was acknowledged, of a job that had not ended.

    Attributes
    ----------
    identification : of the job
    at : s, UNIX time of the acknowledgement
    where : the stage in which the job was, or ``queue``
    """

    identification: str
    at: float
    where: str


@dataclass
class Acknowledged:
    """Acknowledgements of the server.

    Attributes
    ----------
    orders : key of an order -> id of the identification that was made
    rows : id of a recording -> most rows that the server reported as recorded
    answers : how many by status; 0: none came
    poor : refusals that are no problem document in one line, or 503 without a time to come again
    cancels : by job
    real : keys of those orders whose identifications are real ones
    asked : jobs that were to be cancelled, also where no answer came
    undisturbed : id of a real identification of the same input, from before the storm
    """

    orders: dict[str, str] = field(default_factory=dict)
    rows: dict[str, int] = field(default_factory=dict)
    answers: dict[int, int] = field(default_factory=dict)
    poor: list[str] = field(default_factory=list)
    cancels: dict[str, Cancelled] = field(default_factory=dict)
    real: list[str] = field(default_factory=list)
    asked: set[str] = field(default_factory=set)
    undisturbed: str = ""


class Client:
    """Asks whatever server there is at the moment."""

    def __init__(self, address: Callable[[], str | None], noted: Acknowledged) -> None:
        self._address = address
        self._noted = noted
        self._lock = threading.Lock()
        # A connection for each: a server that is killed takes those that were kept along.
        self._http = httpx2.Client(timeout=PATIENCE_S, limits=httpx2.Limits(max_keepalive_connections=0))

    def ask(self, method: str, path: str, content: Any = None, headers: dict[str, str] | None = None) -> Any:
        """Return status and JSON of one answer; NoAnswerError if none came."""
        address = self._address()
        if address is None:
            raise _NoAnswerError
        body = content if isinstance(content, bytes) or content is None else json.dumps(content).encode()
        kind = {"Content-Type": "application/json"} if body is not None else {}
        try:
            answer = self._http.request(method, address + API + path, content=body, headers=kind | (headers or {}))
            found = answer.json() if answer.content else None
        except (httpx2.HTTPError, ValueError):
            self._count(0)
            raise _NoAnswerError from None
        self._count(answer.status_code)
        if answer.is_error:
            self._look(f"{method} {path}: {answer.status_code}", answer, found)
        if answer.is_server_error:
            raise _NoAnswerError
        return answer.status_code, found

    def _look(self, what: str, answer: httpx2.Response, found: Any) -> None:
        """Note a refusal that does not name what is wrong and what to do."""
        detail = str(found.get("detail", "")) if isinstance(found, dict) else ""
        if not detail or "\n" in detail or not str(found.get("type", "")).startswith("urn:hilfit:problem:"):
            self._noted.poor.append(f"{what}: {found}")
        if answer.status_code == 503 and "Retry-After" not in answer.headers:
            self._noted.poor.append(f"{what} without Retry-After: {detail}")

    def _count(self, status: int) -> None:
        with self._lock:
            self._noted.answers[status] = self._noted.answers.get(status, 0) + 1


class Traffic:
    """Orders identifications and makes recordings until stopped, each in a thread of its own.

    Parameters
    ----------
    recording : of which identifications are made
    """

    def __init__(self, client: Client, noted: Acknowledged, machine: str, recording: str) -> None:
        self._client = client
        self._noted = noted
        self._machine = machine
        self._recording = recording
        self._stop = threading.Event()
        self._to_cancel: queue.Queue[str] = queue.Queue()
        self._threads = [threading.Thread(target=run, daemon=True) for run in (self._order, self._cancel, self._record)]

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
                self._noted.orders[key] = made
                if number % 2:
                    self._to_cancel.put(made)
                number += 1
            self._stop.wait(0.3)

    def _cancel(self) -> None:
        """Cancel every other order, each somewhere else."""
        number = 0
        while not self._stop.is_set():
            try:
                made = self._to_cancel.get(timeout=0.2)
            except queue.Empty:
                continue
            self._until(partial(self._cancelled, made, CANCELLED_IN[number % len(CANCELLED_IN)]))
            number += 1

    def _cancelled(self, identification: str, where: str) -> str | None:
        """Cancel a job once it is where it should be cancelled, or further; its id when it was, or has ended."""
        _, found = self._client.ask("GET", f"/identifications/{identification}")
        job, asked = str(found["job"]), False
        while not self._stop.is_set():
            _, row = self._client.ask("GET", f"/jobs/{job}")
            if row["state"] not in ("queued", "running"):
                return job
            there = row["stage"] if row["state"] == "running" and row["stage"] in STAGES else "queue"
            if asked or CANCELLED_IN.index(there) >= CANCELLED_IN.index(where):
                asked = True
                self._noted.asked.add(job)
                code, answer = self._client.ask("POST", f"/jobs/{job}/cancel")
                if code == 202 and answer["state"] in ("queued", "running", "cancelled"):
                    self._noted.cancels[job] = Cancelled(identification, time.time(), there)
                    return job
            time.sleep(0.03)
        return None

    def order_real(self, count: int, order: dict[str, Any]) -> None:
        """Order so many real identifications; returns once there was an answer to each."""
        for number in range(count):
            key = f"storm-real-{number}"
            made = self._until(partial(self._ordered, key, order | {"label": key}, math.inf))
            if made is not None:
                self._noted.orders[key] = made
                self._noted.real.append(key)

    def _ordered(self, key: str, body: dict[str, Any], most: float = MOST_OPEN) -> str | None:
        _, status = self._client.ask("GET", "/status")
        if sum(status["jobs"].get(state, 0) for state in ("queued", "running")) >= most:
            return None
        code, answer = self._client.ask("POST", "/identifications", body, {"Idempotency-Key": key})
        return str(answer["id"]) if code == 202 else None

    def _until(self, do: Callable[[], str | None]) -> str | None:
        """Ask until there is an answer: the same key makes nothing twice. None if ordered to stop first."""
        while True:
            try:
                made = do()
            except _NoAnswerError:
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
                    self._noted.rows[answer["id"]] = 0
                    self._follow(answer["id"])
                    self._stop.wait(2.0)
            except _NoAnswerError:
                pass
            self._stop.wait(0.3)

    def _follow(self, id: str) -> None:
        """Note how many rows the server reports safe, until the recording is over or the server is."""
        while not self._stop.is_set():
            try:
                _, row = self._client.ask("GET", f"/recordings/{id}")
            except _NoAnswerError:
                if self._stop.wait(0.5):
                    return
                continue
            self._noted.rows[id] = max(self._noted.rows[id], int(row["statistics"].get("rows") or 0))
            if row["state"] != "recording":
                return
            time.sleep(0.1)


#: Seconds until the machine is acquired, recorded and scheduled, before the first kill.
READY_S = 240.0


def prepare(client: Client, machine: Path) -> tuple[str, str]:
    """Acquire the machine, record what identifications are made of, and make the schedule; machine and recording."""
    content, yaml = machine.read_bytes(), {"Content-Type": "application/yaml"}
    name = str(_answer(lambda: client.ask("POST", "/machines", content, yaml)[1], READY_S)["name"])
    _answer(lambda: client.ask("PUT", f"/machines/{name}/acquisition", {"enabled": True}), READY_S)
    body: dict[str, Any] = {"machine": name, "role": "operation", "label": "before", "seconds": 4.0}
    recording = _answer(lambda: _created(client, "/recordings", body), READY_S)
    place = f"/recordings/{recording['id']}"
    _answer(lambda: client.ask("GET", place)[1]["state"] == "sealed", READY_S)
    wish = {"machine": name, "cron": "*/5 * * * *", "timezone": "UTC", "motion": "operation", "duration_s": 30.0}
    _answer(lambda: _created(client, "/schedules", wish), READY_S)
    return name, str(recording["id"])


def real_order(client: Client, name: str, case: Path) -> dict[str, Any]:
    """Upload what real identifications are made of; the body of such an order."""
    chosen = []
    for role, stem in FITTED:
        place = f"/recordings/upload?machine={name}&role={role}&name={stem}.parquet"
        content = (case / f"{stem}.parquet").read_bytes()
        chosen.append({"id": _answer(partial(_created, client, place, content), READY_S)["id"], "role": role})
    return {"machine": name, "recordings": chosen}


def undisturbed(client: Client, order: dict[str, Any]) -> str:
    """Return the id of a real identification that is done."""
    made = _answer(lambda: _created(client, "/identifications", order | {"label": "undisturbed"}), READY_S)
    place = f"/jobs/{made['job']}"
    _answer(lambda: client.ask("GET", place)[1]["state"] == "done", 2 * READY_S)
    return str(made["id"])


def _created(client: Client, path: str, body: Any) -> Any:
    status, answer = client.ask("POST", path, body)
    return answer if status in (201, 202) else None


def _answer(ask: Callable[[], Any], seconds: float) -> Any:
    answer = polled(ask, seconds, 0.2, _NoAnswerError)
    if answer is None:
        raise RuntimeError(f"the service was not ready for the storm in {seconds:g} s")
    return answer


def becomes_quiet(client: Client, seconds: float) -> bool:
    """Wait until no job is open and nothing is recorded, the schedule switched off; False if that takes too long."""
    off: set[str] = set()

    def quiet() -> bool:
        for schedule in [own for own in _items(client, "/schedules") if own["id"] not in off]:
            id, *_ = (schedule.pop(key, None) for key in ("id", "created", "next", "last"))
            if client.ask("PUT", f"/schedules/{id}", schedule | {"enabled": False})[0] == 200:
                off.add(id)
        status = client.ask("GET", "/status")[1]
        acquired = all(state["state"] == "running" for state in status["acquisition"].values())
        busy = sum(status["jobs"].get(state, 0) for state in ("queued", "running"))
        return bool(off) and acquired and not busy and not _items(client, "/recordings?state=recording")

    return bool(polled(quiet, seconds, 0.3, _NoAnswerError))


def _items(client: Client, path: str) -> Any:
    return client.ask("GET", path)[1]["items"]
