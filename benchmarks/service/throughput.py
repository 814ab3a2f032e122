"""Identifications per hour with one, two and more worker processes on PostgreSQL, and how well they share the work.

A real server, real workers and a PostgreSQL of their own on this computer. The server works as well, so one worker is
the server alone. The identifications are of uploaded recordings of one case, so all are the same work. Efficiency is
jobs per hour beside as many times what one does.

What the computer itself gives is measured beside it: as many plain ``hilfit identify`` at once, which share nothing but
cores, caches and memory. So is the processor time of everything that is no identification.
"""

from __future__ import annotations

import os
import subprocess
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import IO

import httpx2

from benchmarks.service.hosts import API, COMMAND, ONE_CORE, order_of, ordered, running, wait_for_jobs
from benchmarks.service.postgresql import postgresql_server
from benchmarks.service.start import cpu_s
from benchmarks.targets import Check, Outcome, Show, figure
from sim_backends import default_machine
from sim_backends.plant.cases import make_case

#: Machine time of each recording, s; the order of magnitude of a recalibration.
CASE_S = 60.0
#: Seconds that one identification may take.
ONE_S = 180.0
#: Share of what one worker does, times the workers, that is asked while there is a core for each.
EFFICIENT = 0.9


def run(workers: Sequence[int], jobs: int, show: Show) -> Outcome:
    """Measure each number of workers in turn, each with a database of its own.

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
                show(f"{count} plain 'hilfit identify' at once: {plain[count]:.0f} an hour")
            with (directory / f"log-{count}").open("w") as log:
                seconds, own[count] = _measured(directory, server.new_database(), count, jobs * count, log)
            rates[count] = 3600.0 * jobs * count / seconds
            show(f"{count} workers: {jobs * count} identifications in {seconds:.1f} s")
    what = "processor time of service and workers per job"
    beside = [figure(f"{what}, {count} workers", seconds, "{:.2f} s") for count, seconds in own.items()]
    return Outcome(
        (*_checks(rates), *_ceiling(plain), *beside),
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
    """Measure what the computer gives to identifications that share nothing."""
    first = min(rates, default=0)
    for count, rate in rates.items():
        if count > first:
            share = rate / count / (rates[first] / first)
            shown = f"{share:.0%} ({rate:.0f} an hour, {rates[first]:.0f} of {first})"
            yield Check(f"efficiency of {count} plain 'hilfit identify' at once", share, shown)


def _plain(directory: Path, count: int, jobs: int) -> float:
    """Count identifications per hour of so many processes at a time, each one after another."""
    case = directory / "case"
    command = [*COMMAND, "identify", str(case / "machine.yaml"), "--train", str(case / "train-1.parquet")]
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
    return os.environ | database | ONE_CORE


def _measured(directory: Path, url: str, workers: int, jobs: int, log: IO[str]) -> tuple[float, float]:
    """Time all jobs from the order to the end of the last, s; return processor s per job of all hosts too.

    One job before them has warmed everything up. The stages are processes of their own and not in the second number.
    """
    data = ["--data-dir", str(directory / f"data-{workers}"), "--json"]
    environment = _environment(url)
    with ExitStack() as stack:
        server, up = stack.enter_context(running(["serve", "--port", "0", *data], log, environment))
        client = stack.enter_context(httpx2.Client(base_url=up["url"] + API, timeout=60))
        names = [["worker", "--name", f"worker-{number}"] for number in range(1, workers)]
        hosts = [server, *(stack.enter_context(running([*name, *data], log, environment))[0] for name in names)]
        order = order_of(client, directory / "case")
        wait_for_jobs(client, [ordered(client, order)["job"] for _ in range(workers)], ONE_S)
        began, before = time.monotonic(), sum(cpu_s(host.pid) for host in hosts)
        wait_for_jobs(client, [ordered(client, order)["job"] for _ in range(jobs)], ONE_S)
        return time.monotonic() - began, (sum(cpu_s(host.pid) for host in hosts) - before) / jobs
