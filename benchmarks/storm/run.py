"""Kill servers, workers, stages and acquisitions at random for a while; then look whether anything was lost or doubled.

The simulated machine is power and iron, not software of ours, so it is not killed: it is started here, and servers
acquire from it over its buses. Everything else is killed, also while it starts. Meanwhile jobs are cancelled in every
stage, the disk is full for some seconds, the store refuses to be written, and the clock is set forward and back.
"""

from __future__ import annotations

import json
import os
import random
import tempfile
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager, nullcontext
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

from benchmarks.fleet.namespaces import HERE, NETWORK, hosts
from benchmarks.fleet.site import s3_server
from benchmarks.service.hosts import polled
from benchmarks.service.postgresql import PostgreSQL, postgresql_server
from benchmarks.storm.checks import all_checks, amcheck, count_results
from benchmarks.storm.clock import SetClock, clock_file
from benchmarks.storm.faults import PACE, Pace, Weather, possible_faults, small_disk
from benchmarks.storm.host import HostOrder, worker_directory
from benchmarks.storm.processes import REAL_KILLS, Herd, Killing, OnHost
from benchmarks.storm.stages import STAGES
from benchmarks.storm.traffic import Acknowledged, Client, Traffic, becomes_quiet, prepare, real_order, undisturbed
from benchmarks.targets import Check, Outcome, Show, fact, figure
from server.composition.declarations import TABLES
from server.platform.database.engine import Database
from server.platform.files import DataDirectory
from sim_backends import SimulatedMachine, default_machine
from sim_backends.plant.cases import make_case

#: Kills that are aimed at, for every one that there should be: now and then there is nothing to kill.
AIM = 2.5
#: Real identifications: all have to get done.
REAL = 2
#: Machine time of their recordings: about 4 s of processor time each, and the start of seven processes.
REAL_S = 20.0
#: Machine seconds per second.
SPEED = 4.0
#: Seconds until everything that was ordered has to be over, after the last kill; more where an undisturbed real
#: identification takes long.
QUIET_S = 180.0
WORKERS = 2
#: Seconds that the process of a job has to end after the last one.
LEAVING_S = 30.0


def run(
    seconds: float, kind: Literal["sqlite", "postgresql"], seed: int, show: Show, *, apart: bool = False, **more: Any
) -> Outcome:
    """Run a storm of so many seconds (``more``: the other fields of :class:`_Storm`).

    Parameters
    ----------
    apart : workers are in network namespaces and share no folder, only PostgreSQL and an S3 server

    Raises
    ------
    benchmarks.service.postgresql.AbsentError
        If PostgreSQL is asked for and not installed, or hosts or S3 cannot be had.
    """
    storm = _Storm(seconds, random.Random(seed), show, **more)
    with (
        small_disk() if storm.faults else nullcontext() as disk,
        tempfile.TemporaryDirectory(prefix="hilfit-storm-") as name,
        _elsewhere(Path(name), (disk or Path(name)) / "data") if apart else nullcontext(_Elsewhere()) as elsewhere,
        postgresql_server(disk, elsewhere.network) if kind == "postgresql" else nullcontext() as server,
    ):
        directory = Path(name)
        machine, truth = default_machine()
        with SimulatedMachine(machine, truth, speed=SPEED, workdir=directory / "machine") as simulated:
            if storm.real:
                make_case(directory / "case", (machine, truth), seed, seconds=REAL_S)
            files, clock = DataDirectory((disk or directory) / "data"), SetClock(clock_file(directory / "order.json"))
            faults = possible_faults(files, disk, server, clock) if storm.faults else ()
            weather = Weather(faults, random.Random(seed), storm.pace)
            return storm.run(directory, simulated.machine_path, server, files, weather, elsewhere)


@dataclass(frozen=True)
class _Elsewhere:
    """Places of workers: what starts a command on the host of each, and what they share with the server.

    Without hosts they are on this one.
    """

    starters: tuple[OnHost, ...] = ()
    storage_url: str | None = None
    network: tuple[str, str] | None = None


@contextmanager
def _elsewhere(directory: Path, data: Path) -> Iterator[_Elsewhere]:
    """Start hosts that do not see ``data``, the server's directory, and an S3 server with keys in this environment."""
    data.mkdir()
    with hosts(WORKERS, data) as places, s3_server(directory) as (keys, url):
        os.environ.update(keys)
        yield _Elsewhere(tuple(place.command for place in places), url, (HERE, NETWORK))


@dataclass(frozen=True)
class _Storm:
    """Definition of a storm.

    Attributes
    ----------
    seconds : of killing, at least
    kills : that there should be; a computer that is busy with other work starts processes slowly, so the storm goes on
        until then
    longest : seconds that it goes on at most
    real : real identifications that are ordered after that, and hit; the others have light stages
    faults : with a full disk, a read-only store and jumps of the clock; the storm goes on until each came
    pace : of the faults (:class:`benchmarks.storm.faults.Weather`)
    everywhere : with faults, the storm also goes on until a job was cancelled in each stage
    """

    seconds: float
    chance: random.Random
    show: Show
    kills: int
    longest: float
    real: int = REAL
    faults: bool = True
    pace: Pace = PACE
    everywhere: bool = True

    def run(
        self, directory: Path, machine: Path, postgresql: PostgreSQL | None, files: DataDirectory, weather: Weather,
        elsewhere: _Elsewhere,
    ) -> Outcome:  # fmt: skip
        """Start the hosts, kill, and check what is left; ``machine``: file of the one that is acquired."""
        url = None if postgresql is None else postgresql.new_database()
        order = directory / "order.json"
        storage = None if url is None else elsewhere.storage_url or f"file://{directory}/storage"
        content = HostOrder(str(files.root), url, storage, datetime.now(UTC).isoformat())
        order.write_text(json.dumps(asdict(content)), encoding="utf-8")
        names = [] if url is None else [f"worker-{number + 1}" for number in range(WORKERS)]
        here = [list[str]] * WORKERS
        herd = Herd(order, dict(zip(names, elsewhere.starters or here, strict=False)), directory)
        noted, own = Acknowledged(), [worker_directory(order, name) for name in names]
        client = Client(lambda: herd.server.line if herd.server.up.is_set() else None, noted)
        try:
            with _database(files, url, herd) as database:
                name, recording = prepare(client, machine)
                count_results(database)
                order_real, real_s = (
                    self._first_real(client, noted, name, directory / "case") if self.real else ({}, 0.0)
                )
            traffic = Traffic(client, noted, name, recording)
            traffic.start()
            killed, revived = self._killed(herd, noted, traffic, weather, postgresql, order_real)
            traffic.stop()
            end = self._ended(herd, client, QUIET_S + 2 * self.real * real_s)
            seen = DataDirectory(files.root, storage)
            with _database(seen, url) as database:
                checks = list(all_checks(database, seen, noted, own))
            if url is not None and postgresql is not None:
                checks.append(amcheck(url, postgresql.programs))
        finally:
            weather.clear()
            for host in herd.hosts:
                host.kill()
        return Outcome((*killed, *_weather(weather, herd, noted, revived), *end, *checks, *_logs(herd, noted)))

    def _first_real(
        self, client: Client, noted: Acknowledged, machine: str, case: Path
    ) -> tuple[dict[str, Any], float]:
        """Order a real identification that nothing hits, and wait for it; return its order, and how many s it took."""
        order = real_order(client, machine, case)
        self.show("a real identification, undisturbed")
        asked = time.monotonic()
        noted.undisturbed = undisturbed(client, order)
        took = time.monotonic() - asked
        self.show(f"it took {took:.1f} s")
        return order, took

    def _killed(
        self, herd: Herd, noted: Acknowledged, traffic: Traffic, weather: Weather, database: PostgreSQL | None,
        order: dict[str, Any],
    ) -> tuple[list[Check], bool]:  # fmt: skip
        """Kill, with weather, until all that is asked for was seen; then while real identifications run.

        Returns the checks of what was killed, and whether the database had ended and came back.
        """
        show, real = self.show, self.real
        show(f"{self.seconds:g} s of kill -9; light stages stand for those of an identification, all else is real")
        killing = Killing(herd, self.chance, AIM * self.kills / self.seconds, show, weather)

        def wanted(past: float) -> bool:
            places = {cancel.where for cancel in noted.cancels.values()}
            missing = not weather.all_seen or (self.everywhere and not places.issuperset(STAGES))
            return past < self.seconds or herd.total < self.kills or (bool(weather.faults) and missing)

        killing.go_on(wanted, self.longest)
        weather.clear()
        revived = database is not None and database.revive()
        total, lasted = herd.total, killing.past
        kinds = ", ".join(f"{count} {kind}" for kind, count in herd.killed.items() if count)
        shown = f"{total} ({kinds}; {herd.starting} of them while they started) in {lasted:.0f} s"
        checks = [Check("processes killed", total, shown, "at least", float(self.kills), str(self.kills))]
        if real:
            show(f"{real} real identifications, too")
            herd.wait_up()
            killing.weather = None
            traffic.order_real(real, order)
            most = real * REAL_KILLS
            killing.go_on(lambda _: sum(herd.hits.values()) < most, self.longest)
            hits = sum(herd.hits.values())
            others = f"{herd.total - total - hits} other kills meanwhile, in {killing.past - lasted:.0f} s"
            shown = f"{hits} of {most}, and {others}"
            checks.append(figure("stages of real identifications killed", hits, least=1.0, shown=shown))
        return checks, revived

    def _ended(self, herd: Herd, client: Client, longest: float) -> tuple[Check, ...]:
        """Wait until nothing is under way any more, and stop all hosts."""
        before = time.monotonic()
        whole = herd.wait_up()
        # Stages have the lowest priority: a computer with other work may give them next to nothing.
        quiet = whole and becomes_quiet(client, longest)
        self.show(f"quiet {time.monotonic() - before:.1f} s after the last kill")
        left = _left(herd)
        codes = herd.stop()
        starts = sum(host.starts for host in herd.hosts)
        alone = left == dict.fromkeys(left, 0) | {"acquisition": 1}
        return (
            fact("quiet in time", quiet, f"after {starts} starts"),
            fact("one acquisition, no stage afterwards", alone, str(left)),
            fact("hosts stop in order", not any(codes), f"exit codes {codes}"),
        )


def _logs(herd: Herd, noted: Acknowledged) -> tuple[Check, ...]:
    """Check what the logs hold, and how requests were answered."""
    errors = ", ".join(f"{count} {event}" for event, count in sorted(herd.log_events().items())) or "none"
    answers = ", ".join(f"{count} x {status}" for status, count in sorted(noted.answers.items()))
    return Check("errors in the logs", None, errors), Check("answers by status (0: none)", None, answers)


def _left(herd: Herd) -> dict[str, int]:
    """Count children of each kind; one kept for another job has some time to end."""
    polled(lambda: not herd.children()["real stage"], LEAVING_S, 0.3)
    return {kind: len(pids) for kind, pids in herd.children().items()}


def _weather(weather: Weather, herd: Herd, noted: Acknowledged, revived: bool) -> Iterator[Check]:
    """Check what happened beside kills, and how the hosts took it."""
    seen = ", ".join(f"{count} times {name}" for name, count in sorted(weather.seen.items())) or "none"
    missing = [fault.name for fault in weather.faults if not weather.seen[fault.name]]
    yield fact("faults", not missing, seen if not missing else f"{seen}; not {', '.join(missing)}")
    shown = f"{len(herd.died)}" if not herd.died else f"{len(herd.died)}: {'; '.join(herd.died[:5])}"
    yield figure("hosts that ended by themselves", len(herd.died), most=0, shown=shown)
    refused = ", ".join(f"{count} with exit code {code}" for code, count in sorted(herd.refused.items()))
    yield Check("starts refused meanwhile", herd.refused.total(), refused or "none")
    if revived:
        yield Check("PostgreSQL", None, "ended by itself on the full disk, and was started again")
    broke = noted.answers.get(500, 0)
    yield figure("answers 500", broke, most=0)
    poor = f"{len(noted.poor)}" if not noted.poor else f"{len(noted.poor)}: {'; '.join(noted.poor[:3])}"
    yield figure("refusals that do not say what to do", len(noted.poor), most=0, shown=poor)


@contextmanager
def _database(files: DataDirectory, url: str | None, herd: Herd | None = None) -> Iterator[Database]:
    """Open the store, seen from here; ``herd``: whose server makes it."""
    if herd is not None and not herd.wait_up():
        raise RuntimeError(f"the service did not start; {herd.server.log.read_text()[-2000:]}")
    with closing(Database(url or files.database, TABLES, changed=lambda: None)) as database:
        yield database
