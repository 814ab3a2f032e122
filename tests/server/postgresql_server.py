"""A PostgreSQL server for tests, from the programs that Debian installs; loopback only, gone afterwards."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from benchmarks.service.postgresql import AbsentError, PostgreSQL, postgresql_server

__all__ = ["PostgreSQL", "postgresql"]


@pytest.fixture(scope="session")
def postgresql() -> Iterator[PostgreSQL]:
    """The server, started when the first test asks for it."""
    try:
        starting = postgresql_server()
        server = starting.__enter__()
    except AbsentError as absent:
        pytest.skip(str(absent))
    try:
        yield server
    finally:
        starting.__exit__(None, None, None)
