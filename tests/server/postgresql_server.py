"""A PostgreSQL server for tests, from the programs that Debian installs; loopback only, gone afterwards."""

from __future__ import annotations

import os
import pwd
import shutil
import socket
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

import psycopg
import pytest

PROGRAMS = Path("/usr/lib/postgresql")


class PostgreSQL:
    """A running server; every test takes a database of its own."""

    def __init__(self, port: int) -> None:
        self._address = f"postgresql://tests@127.0.0.1:{port}"
        self._count = 0

    def new_database(self) -> str:
        """URL of an empty database."""
        self._count += 1
        name = f"store{self._count}"
        with psycopg.connect(f"{self._address}/postgres", autocommit=True) as connection:
            connection.execute(f'CREATE DATABASE "{name}"'.encode())
        return f"{self._address}/{name}"


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@pytest.fixture(scope="session")
def postgresql() -> Iterator[PostgreSQL]:
    """The server, started when the first test asks for it."""
    found = sorted(PROGRAMS.glob("*/bin/initdb"), key=lambda path: int(path.parts[-3]))
    if not found:
        pytest.skip("PostgreSQL's server programs are not installed in /usr/lib/postgresql")
    programs = found[-1].parent
    account: dict[str, int] = {}
    if os.geteuid() == 0:  # it refuses to run as root
        nobody = pwd.getpwnam("nobody")
        account = {"user": nobody.pw_uid, "group": nobody.pw_gid}
    # Not below pytest's own directory, which other accounts cannot enter.
    directory = Path(tempfile.mkdtemp(prefix="hilfit-postgresql-"))
    try:
        if account:
            os.chown(directory, account["user"], account["group"])
        data, port = directory / "data", _free_port()

        def run(name: str, *arguments: str) -> None:
            done = subprocess.run(
                [str(programs / name), *arguments],
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                timeout=120,
                cwd=directory,
                env={"LC_ALL": "C.UTF-8", "PATH": os.environ["PATH"]},
                extra_groups=[] if account else None,
                **account,  # type: ignore[call-overload]
            )
            assert done.returncode == 0, done.stderr.decode()

        run("initdb", "-D", str(data), "-U", "tests", "--auth=trust", "--no-sync", "-E", "UTF8")
        options = (
            f"-p {port} -c listen_addresses=127.0.0.1 -c unix_socket_directories= -c fsync=off -c max_connections=60"
        )
        run("pg_ctl", "-D", str(data), "-w", "-t", "60", "-l", str(directory / "log"), "-o", options, "start")
        try:
            yield PostgreSQL(port)
        finally:
            run("pg_ctl", "-D", str(data), "-m", "immediate", "-w", "stop")
    finally:
        shutil.rmtree(directory, ignore_errors=True)
