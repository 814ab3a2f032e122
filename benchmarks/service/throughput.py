"""Identifications per hour with one, two and more worker processes on PostgreSQL, and how well they share the work.

A real server, real workers and a PostgreSQL of their own on this computer. The server works as well, so one worker is
the server alone. The identifications are of uploaded recordings of one case, so all are the same work. Efficiency is
jobs per hour beside as many times what one does.

What the computer itself gives is measured beside it: as many plain ``hilfit identify`` at once, which share nothing but
cores, caches and memory. So is the processor time of everything that is no identification.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import IO, Any

import httpx2

from benchmarks.service.postgresql import postgresql_server
from benchmarks.service.start import children, cpu_s
from benchmarks.targets import Check, Outcome, figure
from sim_backends import default_machine
from sim_backends.plant.cases import make_case

#: Machine time of each recording, s; what is uploaded (role, file); the order of magnitude of a recalibration.
CASE_S, FILES = 60.0, (("train", "train-1"), ("validate", "validate"))
#: Seconds that a process has to come up, and that one identification may take.
START_S, ONE_S = 60.0, 180.0
#: Share of what one worker does, times the workers, that is asked while there is a core for each.
EFFICIENT = 0.9
API = "/api/v1"
_COMMAND = (sys.executable, "-P", "-m", "server.commands.command_line")
Say = Callable[[str], None]


def run(workers: Sequence[int], jobs: int, say: Say) -> Outcome:
    """Measure each number of workers in turn, each with a database of its own.

    Parameters
    ----------
    workers : numbers of processes that work, the server among them
    jobs : identifications per worker

    Raises
    ------
    benchmarks.service.postgresql.AbsentError
        If PostgreSQL is not installed.
    """
    rates: dict[int, float] = {}
    plain: dict[int, float] = {}
    own: dict[int, float] = {}
    with postgresql_server() as server, tempfile.TemporaryDirectory(prefix="hilfit-throughput-") as name:
        directory = Path(name)
        make_case(directory / "case", default_machine(), 1, seconds=CASE_S)
        for count in workers:
            if count <= (os.cpu_count() or 1):
                plain[count] = _plain(directory, count, jobs)
                say(f"{count} plain 'hilfit identify' at once: {plain[count]:.0f} an hour")
            with (directory / f"log-{count}").open("w") as log:
                seconds, own[count] = _measured(directory, server.new_database(), count, jobs * count, log)
            rates[count] = 3600.0 * jobs * count / seconds
            say(f"{count} workers: {jobs * count} identifications in {seconds:.1f} s")
    return Outcome(
        (*_checks(rates), *_ceiling(plain), *_beside(own)),
        (f"{os.cpu_count()} cores; load before the end {os.getloadavg()[0]:.1f}",),
    )


def _checks(rates: dict[int, float]) -> Iterator[Check]:
    first = min(rates)
    for count, rate in rates.items():
        yield figure(f"identifications per hour, {count} workers", rate, "{:.0f}")
        if count > first:
            share = rate / count / (rates[first] / first)
            plain = figure(f"efficiency of {count} workers", share, "{:.0%}")
            asked = replace(plain, bound="at least", target=EFFICIENT, target_shown=f"{EFFICIENT:.0%}")
            yield asked if count <= (os.cpu_count() or 1) else plain


def _ceiling(rates: dict[int, float]) -> Iterator[Check]:
    """What the computer gives to identifications that share nothing."""
    first = min(rates, default=0)
    for count, rate in rates.items():
        if count > first:
            share = rate / count / (rates[first] / first)
            shown = f"{share:.0%} ({rate:.0f} an hour, {rates[first]:.0f} of {first})"
            yield Check(f"efficiency of {count} plain 'hilfit identify' at once", share, shown)


def _beside(own: dict[int, float]) -> Iterator[Check]:
    for count, seconds in own.items():
        yield figure(f"processor time of service and workers per job, {count} workers", seconds, "{:.2f} s")


def _plain(directory: Path, count: int, jobs: int) -> float:
    """Identifications per hour of so many processes at a time, each one after another."""
    case = directory / "case"
    command = [*_COMMAND, "identify", str(case / "machine.yaml"), "--train", str(case / "train-1.parquet")]
    command += ["--validate", str(case / "validate.parquet"), "--output"]

    def series(number: int) -> None:
        for job in range(jobs):
            output = directory / f"plain-{count}-{number}-{job}"
            subprocess.run([*command, str(output)], check=True, capture_output=True, env=_environment(None))

    began = time.monotonic()
    with ThreadPoolExecutor(count) as pool:
        list(pool.map(series, range(count)))
    return 3600.0 * count * jobs / (time.monotonic() - began)


def _environment(url: str | None) -> dict[str, str]:
    database = {} if url is None else {"HILFIT_DATABASE_URL": url}
    return os.environ | database | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


def _measured(directory: Path, url: str, workers: int, jobs: int, log: IO[str]) -> tuple[float, float]:
    """Seconds from the order of all jobs to the end of the last one, and s of processor time per job of all hosts.

    One job before them has warmed everything up. The stages are processes of their own and not in the second number.
    """
    data = directory / f"data-{workers}"
    environment = _environment(url)
    server = ["serve", "--port", "0", "--data-dir", str(data), "--json"]
    names = [f"worker-{number}" for number in range(1, workers)]
    commands = [["worker", "--data-dir", str(data), "--name", name, "--json"] for name in names]
    with (
        _process(server, environment, log) as said,
        httpx2.Client(base_url=json.loads(said)["url"] + API, timeout=60) as client,
        _all(commands, environment, log),
    ):
        order = _order(client, directory / "case")
        _wait(client, [_ordered(client, order, f"first {number}") for number in range(workers)])
        hosts = [pid for pid in children(os.getpid()) if "command_line" in _command_of(pid)]
        began, before = time.monotonic(), sum(map(cpu_s, hosts))
        _wait(client, [_ordered(client, order, f"job {number}") for number in range(jobs)])
        return time.monotonic() - began, (sum(map(cpu_s, hosts)) - before) / jobs


def _command_of(pid: int) -> str:
    return Path(f"/proc/{pid}/cmdline").read_text().replace("\0", " ")


def _order(client: httpx2.Client, case: Path) -> dict[str, Any]:
    """Upload machine and recordings; the body of an identification of them."""
    made = client.post("/machines", content=(case / "machine.yaml").read_bytes(), headers=_YAML)
    made.raise_for_status()
    chosen = []
    for role, stem in FILES:
        query = {"machine": made.json()["name"], "role": role, "name": f"{stem}.parquet"}
        sent = client.post("/recordings/upload", params=query, content=(case / f"{stem}.parquet").read_bytes())
        sent.raise_for_status()
        chosen.append({"id": sent.json()["id"], "role": role})
    return {"machine": made.json()["name"], "recordings": chosen}


_YAML = {"content-type": "application/yaml"}


def _ordered(client: httpx2.Client, order: dict[str, Any], label: str) -> str:
    """Path of the job of one more identification."""
    answer = client.post("/identifications", json=order | {"label": label})
    answer.raise_for_status()
    return f"/jobs/{answer.json()['job']}"


def _wait(client: httpx2.Client, places: Sequence[str]) -> None:
    deadline, left = time.monotonic() + ONE_S * len(places), list(places)
    while left:
        job = client.get(left[0]).json()
        if job["state"] in ("failed", "cancelled"):
            raise RuntimeError(f"an identification of the benchmark {job['state']}: {job['error']}")
        if job["state"] == "done":
            left.pop(0)
            continue
        if time.monotonic() > deadline:
            raise RuntimeError(f"{len(left)} of {len(places)} identifications were not done in time")
        time.sleep(0.1)


@contextmanager
def _process(arguments: Sequence[str], environment: dict[str, str], log: IO[str]) -> Iterator[str]:
    """A command of hilfit; its first line of output, once it is up. Ended by SIGTERM."""
    command = [*_COMMAND, *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, env=environment, text=True) as process:
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            if not line:
                raise RuntimeError(f"hilfit {arguments[0]} did not come up")
            yield line
        finally:
            process.terminate()
            process.wait(START_S)


@contextmanager
def _all(commands: Sequence[Sequence[str]], environment: dict[str, str], log: IO[str]) -> Iterator[None]:
    """Several commands side by side."""
    if not commands:
        yield
        return
    with _process(commands[0], environment, log), _all(commands[1:], environment, log):
        yield
