"""A short storm: each fault once, three kills. Ten times as long, with fits, it is ``hilfit bench storm``."""

from __future__ import annotations

from typing import Literal

import pytest

from benchmarks.service.postgresql import AbsentError
from benchmarks.storm.run import run
from benchmarks.targets import lines_of, missed

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

#: s: of each fault, and between two.
SHORT = ((1.0, 2.0), (2.0, 3.0))


@pytest.mark.parametrize("database", ["sqlite", "postgresql"])
def test_nothing_is_lost_and_nothing_is_done_twice(database: Literal["sqlite", "postgresql"]) -> None:
    try:  # PostgreSQL with workers beside the server; each fault comes once
        outcome = run(3.0, database, 7, lambda line: None, kills=3, longest=120.0, real=0, pace=SHORT, everywhere=False)
    except AbsentError as absent:
        pytest.skip(str(absent))
    assert not missed(outcome.checks), "\n".join(lines_of(outcome.checks))
