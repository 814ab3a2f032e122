"""Servers and workers as processes of their own, and identifications that are ordered of them."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any, TypeVar

import httpx2

from daq.errors import InputError

Answer = TypeVar("Answer")
API = "/api/v1"
COMMAND = (sys.executable, "-P", "-m", "server.commands.command_line")
#: Environment of a process that computes on one core only.
ONE_CORE = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
#: Recordings of a case that are uploaded and fitted (role, name).
FITTED = (("train", "train-1"), ("validate", "validate"))
#: Seconds that a process has to end by itself.
STOP_S = 90.0


def started(
    command: Sequence[str], log: IO[str] | int, environment: Mapping[str, str] | None = None
) -> tuple[subprocess.Popen[str], str]:
    """Start a command of hilfit; return it, once it is up, with its first line.

    It has a session of its own, as a service has: kernels share the processor session by session (sched(7), autogroup).

    Raises
    ------
    RuntimeError
        If it ended before.
    """
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=log, env=environment, text=True, start_new_session=True
    )
    assert process.stdout is not None
    line = process.stdout.readline()
    if not line:
        end(process)
        raise RuntimeError(f"{' '.join(command[-5:])} did not come up")
    return process, line


def end(process: subprocess.Popen[Any], seconds: float = STOP_S) -> int:
    """End a process by SIGTERM, by SIGKILL after so many seconds; wait for it, and return its exit code."""
    process.terminate()
    try:
        process.wait(seconds)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    if process.stdout is not None:
        process.stdout.close()
    return process.returncode


@contextmanager
def running(
    words: Sequence[str], log: IO[str] | int, environment: Mapping[str, str] | None = None, before: Sequence[str] = ()
) -> Iterator[tuple[subprocess.Popen[str], dict[str, Any]]]:
    """Run a command of hilfit (``words``, with ``--json``), started by ``before``; end it at the end of the block."""
    process, line = started([*before, *COMMAND, *words], log, environment)
    try:
        yield process, json.loads(line)
    finally:
        end(process)


def order_of(client: httpx2.Client, case: Path) -> dict[str, Any]:
    """Upload a case's machine and recordings; the body of an identification of them."""
    yaml = {"content-type": "application/yaml"}
    made = client.post("/machines", content=(case / "machine.yaml").read_bytes(), headers=yaml)
    machine = made.raise_for_status().json()["name"]
    return {"machine": machine, "recordings": uploaded(client, machine, case)}


def uploaded(client: httpx2.Client, machine: str, case: Path) -> list[dict[str, str]]:
    """Upload what is fitted of a case; the recordings as an identification names them."""
    chosen = []
    for role, stem in FITTED:
        query = {"machine": machine, "role": role, "name": f"{stem}.parquet"}
        sent = client.post("/recordings/upload", params=query, content=(case / f"{stem}.parquet").read_bytes())
        chosen.append({"id": sent.raise_for_status().json()["id"], "role": role})
    return chosen


def ordered(client: httpx2.Client, order: Mapping[str, Any], label: str = "") -> dict[str, str]:
    """Order one more identification; return its ``id`` and that of its ``job``."""
    made: dict[str, str] = client.post("/identifications", json={**order, "label": label}).raise_for_status().json()
    return made


def wait_for_jobs(client: httpx2.Client, jobs: Sequence[str], seconds: float) -> None:
    """Wait until all are done, each within so many seconds.

    Raises
    ------
    RuntimeError
        If one failed or was cancelled, or they were not done in time.
    """
    deadline = time.monotonic() + seconds * len(jobs)
    for id in jobs:
        while (job := client.get(f"/jobs/{id}").json())["state"] != "done":
            if job["state"] in ("failed", "cancelled"):
                raise RuntimeError(f"an identification of the benchmark {job['state']}: {job['error']}")
            if time.monotonic() > deadline:
                raise RuntimeError(f"not all of {len(jobs)} identifications were done in time")
            time.sleep(0.2)  # each look costs the server some milliseconds


def polled(ask: Callable[[], Answer], seconds: float, pause_s: float, *lost: type[Exception]) -> Answer | None:
    """Ask again and again until an answer holds; None if none did within so many seconds.

    Parameters
    ----------
    pause_s : s between two questions
    lost : what is raised where there is no answer yet
    """
    deadline = time.monotonic() + seconds
    while True:
        with suppress(*lost):
            if answer := ask():
                return answer
        if time.monotonic() > deadline:
            return None
        time.sleep(pause_s)


def wait_until(good: Callable[[], bool], seconds: float, what: str) -> None:
    """Wait until something holds; while the service does not answer it does not.

    Raises
    ------
    InputError
        If it does not within so many seconds.
    """
    if not polled(good, seconds, 0.05, httpx2.HTTPError):
        raise InputError(f"{what} was not there within {seconds:g} s; try again on a less busy computer")
