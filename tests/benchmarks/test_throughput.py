"""How the benchmark of several workers counts; the run itself is ``hilfit bench throughput``."""

from __future__ import annotations

import os

import pytest
from typer.testing import CliRunner

from benchmarks.service.throughput import EFFICIENT, _checks
from server.commands.command_line import build


def test_efficiency_is_what_a_worker_does_beside_what_one_alone_does() -> None:
    checks = {check.name: check for check in _checks({1: 100.0, 2: 190.0, 4: 200.0})}
    assert checks["identifications per hour, 2 workers"].measured == 190.0
    assert checks["efficiency of 2 workers"].measured == pytest.approx(0.95)
    assert checks["efficiency of 4 workers"].measured == pytest.approx(0.5)
    assert "efficiency of 1 workers" not in checks


def test_more_workers_than_cores_have_no_target(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    checks = {check.name: check for check in _checks({1: 100.0, 2: 170.0, 4: 200.0})}
    assert checks["efficiency of 2 workers"].target == EFFICIENT and not checks["efficiency of 2 workers"].met
    assert checks["efficiency of 4 workers"].target is None


@pytest.mark.parametrize("wrong", ["0", "1,two", "", "1,,2"])
def test_numbers_of_workers_that_are_none_are_refused_in_one_line(wrong: str) -> None:
    result = CliRunner().invoke(build(), ["bench", "throughput", "--workers", wrong])
    assert result.exit_code == 2
    assert "--workers" in result.output and "1,2,4" in result.output
