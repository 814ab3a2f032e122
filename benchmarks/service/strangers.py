"""Busy processes of ordinary priority that belong to nobody here: what else a computer may have to do."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

#: So many processes count until their time is over, or whoever started them has gone.
_LOOP = """
import os, sys, time
number, end, parent = int(sys.argv[1]), time.monotonic() + float(sys.argv[2]), int(sys.argv[3])
first = os.getpid()
os.setpriority(os.PRIO_PROCESS, 0, 0)
while number > 1 and os.fork():
    number -= 1
while time.monotonic() < end and os.getppid() in (parent, first):
    for _ in range(100_000):
        pass
"""


@contextmanager
def strangers(number: int, longest_s: float) -> Iterator[None]:
    """Run so many busy loops during the block, in a session of their own, as another user's shell has them.

    Parameters
    ----------
    longest_s : s after which each ends by itself
    """
    if not number:
        yield
        return
    command = [sys.executable, "-I", "-S", "-c", _LOOP, str(number), str(longest_s), str(os.getpid())]
    with subprocess.Popen(command, start_new_session=True) as process:
        try:
            yield
        finally:
            os.killpg(process.pid, signal.SIGKILL)
