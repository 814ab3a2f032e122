"""Two workers on hosts of their own against one server: the same work there as here, cut off, and killed.

The server is on this computer, with PostgreSQL that asks for a password and an S3 server (moto). Workers are in network
namespaces and see nothing of the server's files. All identifications are of one pair of recordings without the loop, so
every report has to equal the first in all that is no time.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import httpx2

from benchmarks.fleet.namespaces import HERE, NETWORK, Host, hosts
from benchmarks.service.hosts import wait_until
from benchmarks.service.postgresql import AbsentError, postgresql_server
from benchmarks.service.start import cpu_s
from benchmarks.targets import Check, Outcome, fact, figure
from sim_backends import default_machine
from sim_backends.plant.cases import make_case

#: Machine time of each recording, s, and what is uploaded (role, file).
CASE_S, FILES = 60.0, (("train", "train-1"), ("validate", "validate"))
#: Seconds for something to come up, and for one identification at most.
START_S, ONE_S = 90.0, 300.0
#: Identifications that are timed for each place.
TIMED = 4
S3_PORT, BUCKET = 5077, "site"
#: Seconds more that an identification on another host may take.
AWAY_S = 1.0
#: Of two workers beside one, where there are two cores.
BOTH = 1.6
_COMMAND = (sys.executable, "-P", "-m", "server.commands.command_line")
_ENDED = ("done", "failed", "cancelled")
Say = Callable[[str], None]


def run(jobs: int, cut: float, every: float, say: Say) -> Outcome:
    """Measure and try; see the module.

    Parameters
    ----------
    jobs : identifications while workers are cut off and killed
    cut : s that one is cut off, while it works
    every : s between two kills

    Raises
    ------
    AbsentError
        If PostgreSQL, moto's server or network namespaces are not there.
    """
    with tempfile.TemporaryDirectory(prefix="hilfit-fleet-") as name:
        directory = Path(name)
        data = directory / "server"
        data.mkdir()
        make_case(directory / "case", default_machine(), 1, seconds=CASE_S)
        with (
            hosts(2, data) as places,
            postgresql_server(network=(HERE, NETWORK)) as server,
            _s3(directory) as s3,
            (directory / "log").open("w") as log,
        ):
            storage = s3 | {"HILFIT_STORAGE_URL": f"s3://{BUCKET}/hilfit"}
            database = {"HILFIT_DATABASE_URL": server.new_database()}
            site = _Site(directory, data, os.environ | storage | database, log, say)
            try:
                return site.run(places, jobs, cut, every)
            except Exception:
                log.flush()
                say((directory / "log").read_text()[-3000:])
                raise
            finally:
                site.close()


@contextmanager
def _s3(directory: Path) -> Iterator[dict[str, str]]:
    """moto's S3 server with an empty bucket; the environment of whoever uses it."""
    program = shutil.which("moto_server") or os.environ.get("MOTO_SERVER")
    if program is None:
        raise AbsentError("moto_server is not installed, which stands for S3: pip install 'moto[server,s3]'")
    address = f"http://{HERE}:{S3_PORT}"
    environment = {"AWS_ACCESS_KEY_ID": "tests", "AWS_SECRET_ACCESS_KEY": "tests", "AWS_DEFAULT_REGION": "us-east-1"}
    with (directory / "s3.log").open("w") as log:
        process = subprocess.Popen([program, "-H", HERE, "-p", str(S3_PORT)], stdout=log, stderr=log)
    try:
        wait_until(lambda: httpx2.put(f"{address}/{BUCKET}", timeout=5).status_code == 200, START_S, "moto")
        yield environment | {"AWS_ENDPOINT_URL": address, "FSSPEC_S3_ENDPOINT_URL": address}
    finally:
        process.terminate()
        process.wait(30)


@dataclass
class _Site:
    """One server and its workers."""

    directory: Path
    data: Path
    environment: Mapping[str, str]
    log: IO[str]
    say: Say
    workers: dict[str, subprocess.Popen[str]] = field(default_factory=dict)
    server: subprocess.Popen[str] | None = None

    def run(self, places: tuple[Host, ...], jobs: int, cut: float, every: float) -> Outcome:
        """As :func:`run`."""
        self.server, address = self._started(
            ["serve", "--port", "0", "--data-dir", str(self.data), "--json"], {"HILFIT_LOCAL_JOBS": "0"}
        )
        with httpx2.Client(base_url=json.loads(address)["url"] + "/api/v1", timeout=60) as client:
            order = self._uploaded(client)
            local = ["worker", "--name", "here", "--data-dir", str(self.directory / "here"), "--json"]
            self.workers["here"], _ = self._started(local, {})
            first = self._done(client, [self._order(client, order)])[0]
            beside = self._timed(client, order)
            _end(self.workers.pop("here"))
            self.say(f"on the server's host: {beside:.2f} s each")
            self._work(places[0])
            self._done(client, [self._order(client, order)])
            away = self._timed(client, order)
            one = self._rate(client, order)
            self._work(places[1])
            self._done(client, [self._order(client, order) for _ in range(4)])
            own = self._processor()
            two = self._rate(client, order)
            own = (self._processor() - own) / (2 * TIMED)
            self.say(f"on another host: {away:.2f} s each; two do {two / one:.2f} of what one does")
            told, kills = self._troubled(client, order, places, jobs, cut, every)
            reference = _comparable(self._report(client, first))
            same = sum(_comparable(self._report(client, job)) == reference for job in told)
            states = [client.get(f"/jobs/{job['id']}").json()["state"] for job in told]
            listed = {row["id"] for row in client.get("/workers").json()["items"]}
        extra, shown = away - beside, f"{away - beside:.2f} ({away:.2f} there, {beside:.2f} here)"
        both = figure("two workers beside one", two / one, "{:.2f}", least=BOTH)
        wanted = {"server", *(f"worker-{place.name}" for place in places)}
        return Outcome(
            (
                Check("s more on another host", extra, shown, "at most", AWAY_S, "1"),
                both if (os.cpu_count() or 1) > 1 else figure("two workers beside one", two / one, "{:.2f}"),
                figure("processor s of service and workers per job", own, "{:.2f}"),
                figure("workers killed", kills, least=1.0),
                fact("every job done once", states == ["done"] * len(told), f"{states.count('done')} of {len(told)}"),
                fact("reports equal to the undisturbed one", same == len(told), f"{same} of {len(told)}"),
                fact("all hosts are listed", wanted <= listed, ", ".join(sorted(listed))),
            ),
            (f"{os.cpu_count()} cores; load before the end {os.getloadavg()[0]:.1f}; one was cut off for {cut:g} s",),
        )

    def _troubled(
        self, client: httpx2.Client, order: Any, places: tuple[Host, ...], jobs: int, cut: float, every: float
    ) -> tuple[list[dict[str, Any]], int]:
        """Order everything; pull the first host's wire while it works, then kill the other again and again."""
        asked = [self._order(client, order) for _ in range(jobs)]
        wait_until(lambda: any(self._state(client, job) == "running" for job in asked), START_S, "a job")
        places[0].connect(False)
        self.say(f"{places[0].name} is cut off for {cut:g} s")
        plugged, killed, kills = time.monotonic() + cut, time.monotonic(), 0
        deadline = time.monotonic() + cut + ONE_S + 10 * jobs
        left = list(asked)
        while left or time.monotonic() < plugged:
            assert time.monotonic() < deadline, f"{len(left)} of {jobs} jobs are not done"
            if plugged and time.monotonic() > plugged:
                places[0].connect(True)
                plugged = 0.0
            if time.monotonic() - killed > every and left:
                victim = self.workers[places[1].name]
                os.killpg(victim.pid, signal.SIGKILL)
                victim.wait()
                kills, killed = kills + 1, time.monotonic()
                self._work(places[1])
            left = [job for job in left if self._state(client, job) not in _ENDED]
            time.sleep(0.3)
        self.say(f"{jobs} jobs are over, {kills} workers were killed")
        return asked, kills

    def _state(self, client: httpx2.Client, job: dict[str, Any]) -> str:
        return str(client.get(f"/jobs/{job['id']}").json()["state"])

    def _work(self, place: Host) -> None:
        """Start the worker of a host."""
        folder = self.directory / place.name
        words = ["worker", "--name", place.name, "--data-dir", str(folder), "--json"]
        self.workers[place.name], _ = self._started(words, {}, place)

    def _started(
        self, words: list[str], more: Mapping[str, str], place: Host | None = None
    ) -> tuple[subprocess.Popen[str], str]:
        command = [*_COMMAND, *words] if place is None else place.command([*_COMMAND, *words])
        process = subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=self.log,
            text=True,
            env={**self.environment, **more, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
            start_new_session=True,
        )
        assert process.stdout is not None
        line = process.stdout.readline()
        if not line:
            raise RuntimeError(f"hilfit {words[0]} did not come up")
        return process, line

    def _uploaded(self, client: httpx2.Client) -> dict[str, Any]:
        case, yaml = self.directory / "case", {"content-type": "application/yaml"}
        name = client.post("/machines", content=(case / "machine.yaml").read_bytes(), headers=yaml).json()["name"]
        chosen = []
        for role, stem in FILES:
            query = {"machine": name, "role": role, "name": f"{stem}.parquet"}
            sent = client.post("/recordings/upload", params=query, content=(case / f"{stem}.parquet").read_bytes())
            chosen.append({"id": sent.raise_for_status().json()["id"], "role": role})
        return {"machine": name, "recordings": chosen, "options": {"loop": False}}

    def _order(self, client: httpx2.Client, order: Any) -> dict[str, Any]:
        made = client.post("/identifications", json=order).raise_for_status().json()
        return {"id": made["job"], "subject": made["id"]}

    def _done(self, client: httpx2.Client, asked: list[dict[str, Any]]) -> list[dict[str, Any]]:
        for job in asked:
            wait_until(lambda job=job: self._state(client, job) in _ENDED, ONE_S, "an identification")  # type: ignore[misc]
            assert self._state(client, job) == "done", client.get(f"/jobs/{job['id']}").json()["error"]
        return asked

    def _timed(self, client: httpx2.Client, order: Any) -> float:
        """Seconds of one identification, ordered when the one before is over: the median."""
        took = []
        for _ in range(TIMED):
            began = time.monotonic()
            self._done(client, [self._order(client, order)])
            took.append(time.monotonic() - began)
        return sorted(took)[len(took) // 2]

    def _rate(self, client: httpx2.Client, order: Any) -> float:
        """Identifications a second while there are enough of them."""
        began = time.monotonic()
        self._done(client, [self._order(client, order) for _ in range(2 * TIMED)])
        return 2 * TIMED / (time.monotonic() - began)

    def _processor(self) -> float:
        return sum(cpu_s(process.pid) for process in (self.server, *self.workers.values()) if process is not None)

    def _report(self, client: httpx2.Client, job: dict[str, Any]) -> Any:
        return client.get(f"/identifications/{job['subject']}/report.json").raise_for_status().json()

    def close(self) -> None:
        """End what still runs."""
        for process in (*self.workers.values(), self.server):
            if process is not None:
                _end(process)


def _end(process: subprocess.Popen[str]) -> None:
    process.terminate()
    try:
        process.wait(START_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    if process.stdout is not None:
        process.stdout.close()


def _comparable(report: Any) -> Any:
    """A report without when it was made, and with files by their names: where they lie differs from host to host."""
    data = [part | {"file": Path(part["file"]).name} for part in report["data"]]
    return report | {"created": None, "data": data}
