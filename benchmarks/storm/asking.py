"""What the storm asks a service for before it begins, and after it is over."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.storm.traffic import Client, NoAnswerError

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
    for stem, role in (("train-1", "train"), ("validate", "validate")):
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
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        with suppress(NoAnswerError):
            if answer := ask():
                return answer
        time.sleep(0.2)
    raise RuntimeError(f"the service was not ready for the storm in {seconds:g} s")


def becomes_quiet(client: Client, seconds: float) -> bool:
    """Wait until no job is open and nothing is recorded, the schedule switched off; False if that takes too long."""
    deadline = time.monotonic() + seconds
    off = False
    while time.monotonic() < deadline:
        try:
            if not off:
                _, found = client.ask("GET", "/schedules")
                for schedule in found["items"]:
                    wish = {
                        key: value for key, value in schedule.items() if key not in ("id", "created", "next", "last")
                    }
                    code, _ = client.ask("PUT", f"/schedules/{schedule['id']}", wish | {"enabled": False})
                    off = code == 200
            _, status = client.ask("GET", "/status")
            _, found = client.ask("GET", "/recordings?state=recording")
            acquired = all(state["state"] == "running" for state in status["acquisition"].values())
            busy = sum(status["jobs"].get(state, 0) for state in ("queued", "running"))
            if off and acquired and not busy and not found["items"]:
                return True
        except NoAnswerError:
            pass
        time.sleep(0.3)
    return False
