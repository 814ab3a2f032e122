"""The process of numerical jobs: it stays for the next one."""

from __future__ import annotations

import threading

from server.platform.processes.children import Child

#: Seconds that it stays: to load its libraries takes two, and what it keeps of its recordings is memory.
WARM_S = 5.0


class WarmChild:
    """The process of numerical jobs, which ends when there was no job for :data:`WARM_S`.

    Parameters
    ----------
    used : held by whoever works with it
    """

    def __init__(self, used: threading.Lock) -> None:
        self.child = Child()
        self._used = used
        self._lock = threading.Lock()
        self._timer: threading.Timer | None = None

    def cool(self) -> None:
        """End the process a while after a job is over, unless it is at work then, or another job was over since."""
        with self._lock:
            if self._timer is not None:
                self._timer.cancel()
            self._timer = threading.Timer(WARM_S, self._end)
            self._timer.daemon = True
            self._timer.start()

    def close(self) -> None:
        """End it now."""
        with self._lock:
            if self._timer is not None:
                self._timer.cancel()
        self._end()

    def _end(self) -> None:
        if self._used.acquire(blocking=False):  # else it is at work, and is asked again when that is over
            try:
                self.child.end()
            finally:
                self._used.release()
