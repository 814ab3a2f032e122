"""The process of numerical jobs stays for the next one, and ends when there is none."""

from __future__ import annotations

import os
import select
import sys
import threading
from pathlib import Path

import pytest

from server.jobs import job_host
from server.jobs.job_host import WarmChild

STAYS = """
import json, os, sys
while True:
    print(json.dumps({"summary": {"pid": os.getpid()}, "stays": True}), flush=True)
    if not sys.stdin.readline():
        break
"""


def run(warm: WarmChild, used: threading.Lock, log: Path) -> int:
    """Process that did a job."""
    with used:
        result = warm.child.run([sys.executable, "-S", "-c", STAYS], log=log, timeout_s=60.0)
    warm.cool()
    return int(result.summary["pid"])


def test_the_next_job_has_the_same_process_and_it_ends_when_there_is_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    used = threading.Lock()
    warm = WarmChild(used)
    first, second = (run(warm, used, tmp_path / "log") for _ in range(2))
    assert first == second
    watched = os.pidfd_open(first)
    monkeypatch.setattr(job_host, "WARM_S", 0.01)
    with used:  # at work: it is not ended
        warm.cool()
        assert not select.select([watched], [], [], 0.1)[0]
    warm.cool()
    assert select.select([watched], [], [], 60)[0]
    third = run(warm, used, tmp_path / "log")
    watched = os.pidfd_open(third)
    warm.close()
    assert select.select([watched], [], [], 60)[0]
