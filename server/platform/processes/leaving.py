"""The end of a process whose work is done, although threads of others wait for a database that is away."""

from __future__ import annotations

import os
import sys
import threading
import time

#: Seconds that threads have to end by themselves.
GRACE_S = 5.0


def leave(grace_s: float = GRACE_S) -> None:
    """Return if no thread would keep this process; end it with code 0 if one still does after a while.

    The workflow engine tries again without end what it wants to record. Everything of ours is closed by then, and what
    the engine did not record is done again after the next start, as after a kill.
    """
    deadline = time.monotonic() + grace_s
    for thread in threading.enumerate():
        if thread is not threading.current_thread() and not thread.daemon:
            thread.join(max(0.0, deadline - time.monotonic()))
            if thread.is_alive():
                sys.stdout.flush()
                sys.stderr.flush()
                os._exit(0)
