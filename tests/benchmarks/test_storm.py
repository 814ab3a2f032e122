"""A short storm: each fault once, three kills. Ten times as long, with fits, it is ``hilfit bench storm``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Literal

import pytest

# Machines on buses are those of the tests of acquisition.
sys.path.insert(0, str(Path(__file__).parents[1] / "daq"))

from shorter_arm import shorter_arm

from benchmarks.service.postgresql import AbsentError
from benchmarks.storm.run import run
from benchmarks.targets import lines_of, missed

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

#: s: of each fault, and between two.
SHORT = ((1.0, 2.0), (2.0, 3.0))


@pytest.mark.parametrize("database", ["sqlite", "postgresql"])
def test_nothing_is_lost_and_nothing_is_done_twice(
    database: Literal["sqlite", "postgresql"], monkeypatch: pytest.MonkeyPatch
) -> None:
    # Nothing is fitted: of the arm that is acquired meanwhile two joints do.
    monkeypatch.setattr("benchmarks.storm.run.default_machine", lambda: shorter_arm(1, 2))
    try:  # PostgreSQL with workers beside the server; each fault comes once
        outcome = run(3.0, database, 7, lambda line: None, kills=3, longest=120.0, real=0, pace=SHORT, everywhere=False)
    except AbsentError as absent:
        pytest.skip(str(absent))
    assert not missed(outcome.checks), "\n".join(lines_of(outcome.checks))
