"""A few seconds of the storm; the whole of it, on either database, is ``hilfit bench storm``."""

from __future__ import annotations

import pytest

from benchmarks.service.postgresql import AbsentError
from benchmarks.storm.run import run
from benchmarks.targets import lines_of, missed

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]


def test_nothing_is_lost_and_nothing_is_done_twice() -> None:
    try:  # with workers beside the server
        outcome = run(3.0, "postgresql", 7, lambda line: None, kills=3, longest=300.0, real=0)
    except AbsentError:
        outcome = run(3.0, "sqlite", 7, lambda line: None, kills=3, longest=300.0, real=0)
    assert not missed(outcome.checks), "\n".join(lines_of(outcome.checks))
