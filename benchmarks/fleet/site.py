"""A server on this computer with PostgreSQL that asks for a password and an S3 server (moto), and workers elsewhere.

Workers are in network namespaces and see nothing of the server's files.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import IO

import httpx2

from benchmarks.fleet.namespaces import HERE, NETWORK, Host, hosts
from benchmarks.service.hosts import API, COMMAND, ONE_CORE, end, started, wait_until
from benchmarks.service.postgresql import AbsentError, postgresql_server
from benchmarks.service.start import cpu_with_children_s, descendants
from benchmarks.targets import Show

#: Seconds for something to come up.
START_S = 90.0
S3_PORT, BUCKET = 5077, "site"


@dataclass
class Site:
    """One server and its workers.

    Attributes
    ----------
    directory : for all files; ``data`` is the server's, which no worker sees
    environment : with the addresses of database and storage
    places : where workers are
    """

    directory: Path
    data: Path
    environment: Mapping[str, str]
    places: tuple[Host, ...]
    log: IO[str]
    show: Show
    workers: dict[str, subprocess.Popen[str]] = field(default_factory=dict)
    server: subprocess.Popen[str] | None = None
    spent: float = 0.0

    @contextmanager
    def served(self, command: Sequence[str] = ()) -> Iterator[httpx2.Client]:
        """Start the server, with no jobs of its own; a client of it. At the end all is ended."""
        given = command or [*COMMAND, "serve", "--port", "0", "--data-dir", str(self.data), "--json"]
        self.server, up = self.started(given, {"HILFIT_LOCAL_JOBS": "0"})
        try:
            with httpx2.Client(base_url=json.loads(up)["url"] + API, timeout=600) as client:
                yield client
        except Exception:
            self.log.flush()
            self.show((self.directory / "log").read_text()[-3000:])
            raise
        finally:
            for process in (*self.workers.values(), self.server):
                end(process)
            self.workers.clear()

    def work(self, place: Host, command: Sequence[str] = ()) -> None:
        """Start the worker of a host."""
        folder = str(self.directory / place.name)
        given = command or [*COMMAND, "worker", "--name", place.name, "--data-dir", folder, "--json"]
        self.workers[place.name], _ = self.started(place.command(given))

    def kill(self, place: Host) -> None:
        """Kill -9 the worker of a host, with all that it started."""
        victim = self.workers[place.name]
        self.spent += cpu_with_children_s(victim.pid)[0]
        os.killpg(victim.pid, signal.SIGKILL)
        end(victim)

    def started(
        self, command: Sequence[str], more: Mapping[str, str] | None = None
    ) -> tuple[subprocess.Popen[str], str]:
        """Start a process of the site, once it is up, with its first line."""
        return started(command, self.log, {**self.environment, **ONE_CORE, **(more or {})})

    def processor(self) -> tuple[float, float]:
        """Sum processor s of server and workers, those killed among them, and of their children, gone or there."""
        hosts = [process.pid for process in (self.server, *self.workers.values()) if process is not None]
        found = [cpu_with_children_s(pid) for pid in hosts]
        living = sum(sum(cpu_with_children_s(child)) for pid in hosts for child in descendants(pid))
        return self.spent + sum(own for own, _ in found), living + sum(gone for _, gone in found)


@contextmanager
def new_site(count: int, show: Show) -> Iterator[Site]:
    """Make a site with so many hosts for workers, of which nothing runs yet.

    Raises
    ------
    AbsentError
        If PostgreSQL, moto's server or network namespaces are not there.
    """
    with tempfile.TemporaryDirectory(prefix="hilfit-fleet-") as name:
        directory = Path(name)
        data = directory / "server"
        data.mkdir()
        with (
            hosts(count, data) as places,
            postgresql_server(network=(HERE, NETWORK)) as server,
            s3_server(directory) as (keys, storage),
            (directory / "log").open("w") as log,
        ):
            addresses = {"HILFIT_STORAGE_URL": storage, "HILFIT_DATABASE_URL": server.new_database()}
            yield Site(directory, data, os.environ | keys | addresses, places, log, show)


def kill_now_and_then(
    site: Site, places: Sequence[Host], every: float, again: Callable[[Host], None]
) -> Callable[[], int]:
    """Return a function to call often: every so many s it kills the next worker, ``again`` starts it; count so far."""
    state = {"last": time.monotonic(), "count": 0.0}

    def look() -> int:
        if time.monotonic() - state["last"] > every:
            victim = places[int(state["count"]) % len(places)]
            site.kill(victim)
            again(victim)
            state.update(last=time.monotonic(), count=state["count"] + 1)
        return int(state["count"])

    return look


@contextmanager
def s3_server(directory: Path) -> Iterator[tuple[dict[str, str], str]]:
    """Start moto's S3 server with an empty bucket: environment of its users, and a URL for storage."""
    program = shutil.which("moto_server") or os.environ.get("MOTO_SERVER")
    if program is None:
        raise AbsentError("moto_server is not installed, which stands for S3: pip install 'moto[server,s3]'")
    if find_spec("s3fs") is None:
        raise AbsentError("s3fs is not installed, by which hilfit reaches S3: pip install 'hilfit[s3]'")
    address = f"http://{HERE}:{S3_PORT}"
    environment = {"AWS_ACCESS_KEY_ID": "tests", "AWS_SECRET_ACCESS_KEY": "tests", "AWS_DEFAULT_REGION": "us-east-1"}
    with (directory / "s3.log").open("w") as log:
        process = subprocess.Popen([program, "-H", HERE, "-p", str(S3_PORT)], stdout=log, stderr=log)
    try:
        wait_until(lambda: httpx2.put(f"{address}/{BUCKET}", timeout=5).status_code == 200, START_S, "moto")
        yield environment | {"AWS_ENDPOINT_URL": address, "FSSPEC_S3_ENDPOINT_URL": address}, f"s3://{BUCKET}/hilfit"
    finally:
        end(process)
