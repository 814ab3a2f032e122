"""A PostgreSQL server for benchmarks and tests, from Debian's programs; loopback only, gone afterwards."""

from __future__ import annotations

import os
import pwd
import shutil
import socket
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import quote

from daq.errors import HilfitError

PROGRAMS = Path("/usr/lib/postgresql")
OWNER = "tests"
#: Asked for, as on every host; with a character that has a meaning in URLs.
PASSWORD = "tests%only"


class AbsentError(HilfitError):
    """PostgreSQL is not installed here; the text names what is missing."""


class PostgreSQL:
    """A running server; every user takes a database of its own.

    Attributes
    ----------
    programs : directory of its programs
    port : on which it listens
    """

    def __init__(self, port: int, programs: Path, start: Callable[[], None], host: str) -> None:
        self.programs, self.port = programs, port
        self._address = f"postgresql://{OWNER}:{quote(PASSWORD)}@{host}:{port}"
        self._start = start
        self._count = 0

    def new_database(self) -> str:
        """Return the URL of an empty database."""
        import psycopg

        self._count += 1
        name = f"store{self._count}"
        with psycopg.connect(f"{self._address}/postgres", autocommit=True) as connection:
            connection.execute(f'CREATE DATABASE "{name}"'.encode())
        return f"{self._address}/{name}"

    def set(self, name: str, value: str | None) -> None:
        """Set an option of the whole server (None: as it was), from the next transaction of every session on."""
        import psycopg

        change = f"ALTER SYSTEM RESET {name}" if value is None else f"ALTER SYSTEM SET {name} = '{value}'"
        with psycopg.connect(f"{self._address}/postgres", autocommit=True) as connection:
            connection.execute(change.encode())
            connection.execute(b"SELECT pg_reload_conf()")

    def revive(self) -> bool:
        """Start it again if it has ended by itself; whether it had."""
        import psycopg

        try:
            psycopg.connect(f"{self._address}/postgres", connect_timeout=10).close()
        except psycopg.OperationalError as error:
            if "refused" not in str(error):  # it is busy with what a crash of one of its processes left
                return False
            self._start()
            return True
        return False


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _let_in(data: Path, network: tuple[str, str] | None) -> str:
    """Let a network in, where one is given; return the address to listen on."""
    if network is None:
        return "127.0.0.1"
    with (data / "pg_hba.conf").open("a") as rules:
        rules.write(f"host all all {network[1]} scram-sha-256\n")
    return network[0]


@contextmanager
def postgresql_server(parent: Path | None = None, network: tuple[str, str] | None = None) -> Iterator[PostgreSQL]:
    """Start one in a temporary directory; stopped and removed at the end.

    Parameters
    ----------
    parent : where that is made, a directory that other accounts may enter
    network : its address and the network that it lets in, where other hosts use it

    Raises
    ------
    AbsentError
        If its server programs, or the driver, are not installed.
    """
    found = sorted(PROGRAMS.glob("*/bin/initdb"), key=lambda path: int(path.parts[-3]))
    if not found:
        raise AbsentError(f"PostgreSQL's server programs are not installed in {PROGRAMS}; install Debian's postgresql")
    try:
        import psycopg  # noqa: F401
    except ModuleNotFoundError:
        raise AbsentError("psycopg is not installed; run: pip install 'hilfit[postgresql]'") from None
    programs = found[-1].parent
    account: dict[str, Any] = {}
    if os.geteuid() == 0:  # it refuses to run as root
        nobody = pwd.getpwnam("nobody")
        account = {"user": nobody.pw_uid, "group": nobody.pw_gid, "extra_groups": []}
    # Not below a directory of ours, which other accounts may not enter.
    directory = Path(tempfile.mkdtemp(prefix="hilfit-postgresql-", dir=parent))

    def run(name: str, *arguments: str) -> None:
        done = subprocess.run(
            [str(programs / name), *arguments],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            timeout=120,
            cwd=directory,
            env={"LC_ALL": "C.UTF-8", "PATH": os.environ["PATH"]},
            **account,
        )
        if done.returncode != 0:
            raise AbsentError(f"{name} failed: {' '.join(done.stderr.decode(errors='replace').split())}")

    try:
        if account:
            os.chown(directory, account["user"], account["group"])
        data, port = directory / "data", _free_port()
        secret = directory / "password"
        secret.write_text(PASSWORD)
        if account:
            os.chown(secret, account["user"], account["group"])
        asks = ("--auth=scram-sha-256", f"--pwfile={secret}")
        run("initdb", "-D", str(data), "-U", OWNER, *asks, "--no-sync", "-E", "UTF8")
        host = _let_in(data, network)
        options = f"-p {port} -c listen_addresses={host} -c unix_socket_directories= -c fsync=off -c max_connections=60"

        def start() -> None:
            run("pg_ctl", "-D", str(data), "-w", "-t", "60", "-l", str(directory / "log"), "-o", options, "start")

        start()
        try:
            yield PostgreSQL(port, programs, start, host)
        finally:
            run("pg_ctl", "-D", str(data), "-m", "immediate", "-w", "stop")
    finally:
        shutil.rmtree(directory, ignore_errors=True)
