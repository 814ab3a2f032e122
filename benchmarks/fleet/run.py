"""Two workers on hosts of their own against one server: the same work there as here, cut off, and killed.

All identifications are of one pair of recordings without the loop, so every report has to equal the first in all that
is no time.
"""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

import httpx2

from benchmarks.fleet.site import START_S, Site, kill_now_and_then, new_site
from benchmarks.service.hosts import COMMAND, end, order_of, ordered, wait_for_jobs, wait_until
from benchmarks.targets import Check, Outcome, Show, fact, figure
from sim_backends import default_machine
from sim_backends.plant.cases import make_case

#: Machine time of each recording, s.
CASE_S = 60.0
#: Seconds of one identification at most.
ONE_S = 300.0
#: Identifications that are timed for each place.
TIMED = 4
#: And for a rate.
MANY = 16
#: Seconds more that an identification on another host may take.
AWAY_S = 1.0
#: Of two workers beside one, where there are two cores.
BOTH = 1.6
#: Processor s of an identification with everything that it needs.
JOB_S = 1.2


def run(jobs: int, cut: float, every: float, show: Show) -> Outcome:
    """Measure and try; see the module.

    Raises
    ------
    AbsentError
        If PostgreSQL, moto's server or network namespaces are not there.
    """
    with new_site(2, show) as site:
        make_case(site.directory / "case", default_machine(), 1, seconds=CASE_S)
        with site.served() as client:
            return _measured(site, client, jobs, cut, every)


def _measured(site: Site, client: httpx2.Client, jobs: int, cut: float, every: float) -> Outcome:
    order = order_of(client, site.directory / "case") | {"options": {"loop": False}}
    folder = str(site.directory / "here")
    site.workers["here"], _ = site.started([*COMMAND, "worker", "--name", "here", "--data-dir", folder, "--json"])
    (first,) = _done(client, [ordered(client, order)])
    beside = _timed(client, order)
    end(site.workers.pop("here"))
    site.show(f"on the server's host: {beside:.2f} s each")
    site.work(site.places[0])
    _done(client, [ordered(client, order)])
    away = _timed(client, order)
    one = _rate(client, order)
    site.work(site.places[1])
    _done(client, [ordered(client, order) for _ in range(4)])
    before = site.processor()  # the processes of stages are there, as they were while one worked alone
    two = _rate(client, order)
    own, stages = ((now - then) / MANY for then, now in zip(before, site.processor(), strict=True))
    site.show(f"on another host: {away:.2f} s each; two do {two / one:.2f} of what one does")
    told, kills = _troubled(site, client, order, jobs, cut, every)
    reference = _comparable(_report(client, first))
    same = sum(_comparable(_report(client, job)) == reference for job in told)
    done = sum(_state(client, job) == "done" for job in told)
    listed = {row["id"] for row in client.get("/workers").json()["items"]}
    extra, shown = away - beside, f"{away - beside:.2f} ({away:.2f} there, {beside:.2f} here)"
    shared = BOTH if (os.cpu_count() or 1) > 1 else None
    wanted = {"server", *(f"worker-{place.name}" for place in site.places)}
    parts = f"{own + stages:.2f} (service and workers {own:.2f}, stages {stages:.2f})"
    return Outcome(
        (
            Check("s more on another host", extra, shown, "at most", AWAY_S, "1"),
            figure("two workers beside one", two / one, "{:.2f}", least=shared),
            figure("processor s per job", own + stages, most=JOB_S, shown=parts),
            figure("workers killed", kills, least=1.0),
            fact("every job done once", done == len(told), f"{done} of {len(told)}"),
            fact("reports equal to the undisturbed one", same == len(told), f"{same} of {len(told)}"),
            fact("all hosts are listed", wanted <= listed, ", ".join(sorted(listed))),
        ),
        (f"{os.cpu_count()} cores; load before the end {os.getloadavg()[0]:.1f}; one was cut off for {cut:g} s",),
    )


def _troubled(
    site: Site, client: httpx2.Client, order: Any, jobs: int, cut: float, every: float
) -> tuple[list[dict[str, str]], int]:
    """Order everything; pull the first host's wire while it works, then kill the other again and again."""
    asked = [ordered(client, order) for _ in range(jobs)]
    wait_until(lambda: any(_state(client, job) == "running" for job in asked), START_S, "a job")
    site.places[0].connect(False)
    site.show(f"{site.places[0].name} is cut off for {cut:g} s")
    plugged, kills = time.monotonic() + cut, 0
    deadline = time.monotonic() + cut + ONE_S + 10 * jobs
    kill = kill_now_and_then(site, site.places[1:], every, site.work)
    left = list(asked)
    while left or plugged:
        assert time.monotonic() < deadline, f"{len(left)} of {jobs} jobs are not done"
        if plugged and time.monotonic() > plugged:
            site.places[0].connect(True)
            plugged = 0.0
        kills = kill() if left else kills
        left = [job for job in left if _state(client, job) not in ("done", "failed", "cancelled")]
        time.sleep(0.3)
    site.show(f"{jobs} jobs are over, {kills} workers were killed")
    return asked, kills


def _state(client: httpx2.Client, made: dict[str, str]) -> str:
    return str(client.get(f"/jobs/{made['job']}").json()["state"])


def _done(client: httpx2.Client, asked: list[dict[str, str]]) -> list[dict[str, str]]:
    wait_for_jobs(client, [made["job"] for made in asked], ONE_S)
    return asked


def _timed(client: httpx2.Client, order: Any) -> float:
    """Time one identification, ordered when the one before is over: the median, s."""
    took = []
    for _ in range(TIMED):
        began = time.monotonic()
        _done(client, [ordered(client, order)])
        took.append(time.monotonic() - began)
    return sorted(took)[len(took) // 2]


def _rate(client: httpx2.Client, order: Any) -> float:
    """Count identifications a second while there are enough of them."""
    began = time.monotonic()
    _done(client, [ordered(client, order) for _ in range(MANY)])
    return MANY / (time.monotonic() - began)


def _report(client: httpx2.Client, made: dict[str, str]) -> Any:
    return client.get(f"/identifications/{made['id']}/report.json").raise_for_status().json()


def _comparable(report: Any) -> Any:
    """Strip a report of its time, and files of their folders: where they lie differs from host to host."""
    data = [part | {"file": Path(part["file"]).name} for part in report["data"]]
    return report | {"created": None, "data": data}
