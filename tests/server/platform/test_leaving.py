"""A service that has stopped ends, whatever a thread of another package still waits for."""

from __future__ import annotations

import subprocess
import sys

import pytest

WAITS = """
import threading
from server.platform.processes.leaving import leave
if {waits}:
    threading.Thread(target=threading.Event().wait).start()
print("all is closed")
leave(0.1)
print("no thread was left")
"""


@pytest.mark.parametrize("waits", [True, False])
def test_a_thread_that_waits_without_end_does_not_keep_the_process(waits: bool) -> None:
    done = subprocess.run(
        [sys.executable, "-c", WAITS.format(waits=waits)], capture_output=True, text=True, timeout=60, check=True
    )
    assert done.stdout.splitlines() == ["all is closed"] + ["no thread was left"] * (not waits)
