"""Workers on other hosts: the same work there as here, cut off, and killed; and a night of recalibrations.

All identifications of ``run`` are of one pair of recordings without the loop, so every report has to equal the first in
all that is no time. In ``night`` a thousand machines are recalibrated, and it is added up how long that takes where
there are eight cores. All of the service is real but for three things that are measured apart, so that two cores do in
minutes what a site has hours for: an acquisition stands still, a recording is one that was simulated before and takes
its time divided by :data:`SPEED`, and stages take nothing (:mod:`benchmarks.fleet.night_host`). What a fit takes is
measured on the arms themselves, in the process that a worker would start, and so is the comparison with the calibration
before.

With R = machines / recordings at a time x seconds of a recording, and c = processor s of a recalibration (server,
workers, fit, comparison) / cores, fits run beside recordings, and the last ones begin when the last recordings end:

    night = max(R + recordings at a time x c, seconds of a recording + machines x c)
"""

from __future__ import annotations

import hashlib
import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from typing import Any

import httpx2
import sqlalchemy as sa

from benchmarks.fleet.namespaces import Host
from benchmarks.fleet.night_host import NightOrder, made_file
from benchmarks.fleet.site import START_S, Site, kill_now_and_then, new_site
from benchmarks.service.hosts import COMMAND, ONE_CORE, end, order_of, ordered, wait_for_jobs, wait_until
from benchmarks.service.start import cpu_s
from benchmarks.storm.checks import COUNTED, comparable, count_results
from benchmarks.targets import Check, Outcome, Show, fact, figure
from daq import Machine
from daq.machine.machine_file import machine_to_yaml
from fitting.pipeline.stage_names import STAGES
from server.composition.declarations import TABLES
from server.identifications.identification_job import StageRequest, fitting_program
from server.identifications.identification_results import MODEL_FILE
from server.machines.machine_store import Machines
from server.platform.database.engine import Database
from server.platform.files import DataDirectory
from server.platform.settings import Settings
from server.recalibrations.recalibration_job import PROGRAM
from sim_backends.machines import ARMS, default_machine
from sim_backends.plant.cases import make_case, plan_case, write_table

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
    asked, kills = _troubled(site, client, order, jobs, cut, every)
    reference = comparable(_report(client, first))
    same = sum(comparable(_report(client, job)) == reference for job in asked)
    done = sum(_state(client, job) == "done" for job in asked)
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
            fact("every job done once", done == len(asked), f"{done} of {len(asked)}"),
            fact("reports equal to the undisturbed one", same == len(asked), f"{same} of {len(asked)}"),
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


#: Machine seconds per second, and of a recording in the night that is run; what they are at a site.
SPEED, QUICK_S, SITE_S = 10.0, 30.0, 300.0
#: Cores that a site has, and hours that its night may take.
CORES, NIGHT_H = 8, 2.0
#: Two thirds of normal operation are fitted, a third judges the fit.
SHARES = {"operation": 2 / 3, "validate": 1 / 3}
#: Seconds of a machine until the night counts as stuck.
PATIENCE_S = 10.0
#: Machines of the night that is added up, and recordings that a site has at a time.
MACHINES, MOST_AT_ONCE = 1000, int(Settings.model_fields["recordings_at_once"].default)
OVER = "SELECT count(*) FROM jobs WHERE kind = 'recalibration' AND state IN ('done', 'failed', 'cancelled')"
SLOTS = "SELECT count(*), count(DISTINCT schedule), count(*) FILTER (WHERE state = 'ordered') FROM schedule_slots"
JOBS = "SELECT kind, state, count(*) FROM jobs GROUP BY kind, state ORDER BY kind, state"
RESULTS = f"SELECT count(*), count(DISTINCT subject) FROM {COUNTED}"
CALIBRATIONS = "SELECT count(*) FROM calibrations"
AT_ONCE = """SELECT max((SELECT count(*) FROM recordings AS b WHERE b.created <= a.created AND b.ended > a.created))
FROM recordings AS a"""


def night(machines: int, arms: int, every: float, show: Show) -> Outcome:
    """Run a night and add it up; see the module.

    Raises
    ------
    AbsentError
        If PostgreSQL, moto's server or network namespaces are not there.
    """
    with new_site(2, show) as site:
        made = site.directory / "recordings"
        made.mkdir()
        drawn = [_arm(number, made) for number in range(min(arms, machines))]
        show(f"{len(drawn)} arms are simulated")
        order = site.directory / "order.json"
        order.write_text(json.dumps(asdict(NightOrder(str(site.data), SPEED, str(made)))))
        checks, idle, parts = _night(site, order, drawn, machines, every)
        outputs = site.directory / "fits"
        fit = _fits(drawn, made, outputs)
        show(f"a fit takes {fit:.2f} s of processor time")
        parts |= {"fit with the loop": fit, "comparison": _comparison(drawn, made, outputs)}
    checks.append(figure("processor s a second of the server while nothing is due", idle, "{:.2f}"))
    each_s = sum(parts.values())
    shown = f"{each_s:.1f} ({', '.join(f'{what} {taken:.2f}' for what, taken in parts.items())})"
    checks.append(Check("processor s a recalibration", each_s, shown))
    hours = _night_h(MACHINES, MOST_AT_ONCE, SITE_S, each_s / (CORES - idle))
    checks.append(figure(f"hours of {MACHINES} machines, {CORES} cores", hours, "{:.2f} h", most=NIGHT_H))
    return Outcome(tuple(checks), (f"{os.cpu_count()} cores; load {os.getloadavg()[0]:.1f}",))


def _arm(number: int, made: Path) -> Machine:
    """Make one arm, with the buses of the demonstration's, and its recordings of both lengths."""
    kind, (wired, _) = tuple(ARMS)[number % len(ARMS)], default_machine()
    drawn, _ = ARMS[kind](number)
    both = zip(drawn.channels, wired.channels, strict=False)  # nothing is read there
    channels = tuple(channel.model_copy(update={"source": other.source}) for channel, other in both)
    machine = drawn.model_copy(update={"name": f"arm-{number}", "buses": wired.buses, "channels": channels})
    for whole in (QUICK_S, SITE_S):
        for (role, share), stem in zip(SHARES.items(), ("train-1", "validate"), strict=True):
            table, _ = plan_case(kind, number, whole * share).record(stem)
            write_table(made_file(made, machine.name, role, whole * share), machine, role, table)
    return machine


def _night(
    site: Site, order: Path, arms: list[Machine], machines: int, every: float
) -> tuple[list[Check], float, dict[str, float]]:
    """Run the night: what was counted; processor s a second of an idle server; and s a recalibration, by host."""
    program = [sys.executable, "-P", "-m", "benchmarks.fleet.night_host", str(order)]

    def again(place: Host) -> None:
        site.work(place, [*program, place.name])

    url = site.environment["HILFIT_DATABASE_URL"]
    with site.served(program) as client, closing(Database(url, TABLES, changed=lambda: None)) as database:
        count_results(database)
        files = DataDirectory(site.data)
        for number in range(machines):
            _scheduled(client, database, files, arms[number % len(arms)], number)
        site.show(f"{machines} machines are acquired and scheduled")
        for place in site.places:
            again(place)
        assert site.server is not None
        before, began = cpu_s(site.server.pid), time.monotonic()
        time.sleep(PATIENCE_S)
        idle = (cpu_s(site.server.pid) - before) / (time.monotonic() - began)
        before, all_before, began = cpu_s(site.server.pid), site.processor()[0], time.monotonic()
        order.with_name("tomorrow").touch()
        kill, kills = kill_now_and_then(site, site.places, every, again), 0
        shown = began
        while (over := _ask(database, OVER)[0][0]) < machines:
            if time.monotonic() - began > START_S + PATIENCE_S * machines:
                raise RuntimeError(f"{over} of {machines} recalibrations were over in time")
            if time.monotonic() - shown > every:
                shown = time.monotonic()
                site.show(f"{over} of {machines} after {shown - began:.0f} s")
            kills = kill()
            time.sleep(1.0)
        seconds = time.monotonic() - began
        server = cpu_s(site.server.pid) - before
        workers = site.processor()[0] - all_before - server
        site.show(f"{machines} machines in {seconds:.0f} s, {kills} workers killed")
        parts = {"server": (server - idle * seconds) / machines, "workers": workers / machines}
        return list(_counted(database, machines, kills, seconds)), idle, parts


def _scheduled(client: httpx2.Client, database: Database, files: DataDirectory, arm: Machine, number: int) -> None:
    """Add a machine of some arm, acquired, with a schedule that is due once a day; its file is not read."""
    name = f"site-{number:04d}-{arm.name}"
    content = machine_to_yaml(arm.model_copy(update={"name": name})).encode()
    file = files.machine_file(name, 1)
    file.parent.mkdir()
    file.write_bytes(content)
    Machines(database).add(name, 1, hashlib.sha256(content).hexdigest())
    client.put(f"/machines/{name}/acquisition", json={"enabled": True}).raise_for_status()
    wish = {"machine": name, "cron": "30 2 * * *", "timezone": "UTC", "duration_s": QUICK_S, "deadline_s": 86400}
    client.post("/schedules", json=wish).raise_for_status()


def _ask(database: Database, query: str) -> list[Any]:
    with database.read() as connection:
        return list(connection.execute(sa.text(query)).all())


def _fits(arms: list[Machine], made: Path, outputs: Path) -> float:
    """Time a fit with the loop, of whole recordings, in a worker's process for all of them, processor s."""
    orders = []
    for number, arm in enumerate(arms):
        output = outputs / str(number)
        output.mkdir(parents=True)
        machine = output / "machine.yaml"
        machine.write_text(machine_to_yaml(arm), encoding="utf-8")
        recordings = [(role, made_file(made, arm.name, role, SITE_S * share)) for role, share in SHARES.items()]
        request = StageRequest(machine, tuple(recordings), {}, output).write()
        orders += [{"arguments": [str(request), stage], "log": str(outputs / "log")} for stage in STAGES]
    command = [*fitting_program().command, *orders[0]["arguments"]]
    lines = "".join(f"{json.dumps(order)}\n" for order in orders[1:])
    taken, printed = _processor(command, lines)
    done = printed.count('"stays": true')
    if done != len(orders):
        raise RuntimeError(f"{done} of {len(orders)} stages were done: {printed[-300:]}")
    return taken / len(arms)


def _comparison(arms: list[Machine], made: Path, outputs: Path) -> float:
    """Time a comparison with the calibration before, which has a process of its own, processor s."""
    recordings = [str(made_file(made, arms[0].name, "validate", SITE_S * SHARES["validate"]))]
    of = {"model": str(outputs / "0" / MODEL_FILE), "recordings": recordings}
    request = outputs / "comparison.json"
    request.write_text(json.dumps({"active": of, "new": of}))
    return _processor([*PROGRAM, str(request)], "")[0]


def _processor(command: list[str], lines: str) -> tuple[float, str]:
    """Time a process with one thread, processor s; return its output too."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(command, input=lines, capture_output=True, text=True, env=os.environ | ONE_CORE)
    if done.returncode != 0:
        raise RuntimeError(f"{command[3]} failed: {done.stdout[-300:]} {done.stderr[-300:]}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, done.stdout


def _counted(database: Database, machines: int, kills: int, seconds: float) -> Iterator[Check]:
    """Check that the database has everything once for each machine; ``kills`` of workers in ``seconds``."""
    (slots,), (results,), (calibrations,) = (_ask(database, query) for query in (SLOTS, RESULTS, CALIBRATIONS))
    jobs = {f"{kind} {state}": count for kind, state, count in _ask(database, JOBS)}
    done = dict.fromkeys(("identification done", "recalibration done"), machines)
    yield fact("every slot had its turn once", set(slots) == {machines}, f"{slots[2]} of {machines}")
    yield fact("every job done", jobs == done, ", ".join(f"{count} {what}" for what, count in jobs.items()))
    yield fact("every result stored once", set(results) == {machines}, f"{results[0]} of {machines}")
    yield fact("every calibration proposed once", calibrations[0] == machines, f"{calibrations[0]} of {machines}")
    yield Check("workers killed", kills, f"{kills} in {seconds:.0f} s")
    yield figure("recordings at a time", _ask(database, AT_ONCE)[0][0], most=float(MOST_AT_ONCE))


def _night_h(machines: int, at_once: int, seconds: float, each_s: float) -> float:
    """Compute the hours of a night; see the module.

    Parameters
    ----------
    at_once, seconds : recordings at a time, and s of each
    each_s : s of a recalibration on all cores together
    """
    recorded = machines / at_once * seconds
    return max(recorded + at_once * each_s, seconds + machines * each_s) / 3600
