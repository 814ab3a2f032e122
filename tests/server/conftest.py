"""Fixtures of the service's tests; what they are made of is in :mod:`service_fakes`."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

# Arms and valves with known parameters are those of the tests of the identification, devices those of acquisition.
sys.path.insert(0, str(Path(__file__).parents[1] / "fitting"))
sys.path.insert(0, str(Path(__file__).parents[1] / "daq"))

from postgresql_server import postgresql
from service_fakes import Fakes, Running, children_as_important_as_tests, recording_bytes, running_service

from server.platform import logs

__all__ = ["postgresql"]


@pytest.fixture(scope="session", autouse=True)
def important_children() -> Iterator[None]:
    """No child that a test starts waits for all other tests; where its rank is tested, that is set anew."""
    with children_as_important_as_tests():
        yield


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """One service for all tests of a module; each test brings its own resources."""
    with running_service(tmp_path_factory.mktemp("data"), Fakes(), maximum_upload_bytes=400_000) as service:
        yield service


@pytest.fixture(scope="session")
def csv(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A good recording of :data:`MACHINE` as CSV."""
    return recording_bytes(tmp_path_factory.mktemp("made"))


@pytest.fixture(autouse=True)
def quiet_logs() -> Iterator[None]:
    """Logs as the service writes them, kept out of the tests' output.

    Set again after every test: a command that was tried has sent them to its captured standard error, which is closed.
    """
    logs.configure(stream=io.StringIO())
    yield
    logs.configure(stream=io.StringIO())


@pytest.fixture(autouse=True)
def no_settings_from_outside(monkeypatch: pytest.MonkeyPatch) -> None:
    """The environment of whoever runs the tests must not change what they test."""
    for name in [key for key in os.environ if key.startswith("HILFIT_")]:
        monkeypatch.delenv(name)
