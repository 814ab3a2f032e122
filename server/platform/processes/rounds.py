"""Looks that are taken again and again, on a thread of their own, until it is stopped."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import structlog

#: s between two lines of the log about looks that fail.
LOG_S = 60.0
_log = structlog.stdlib.get_logger(__name__)


class Rounds:
    """Calls ``look`` every so many s; one that fails is logged, and the next one may go well.

    Parameters
    ----------
    name : of the thread and in the log
    at_once : whether the first look is at once, and not after ``every_s``
    """

    def __init__(self, name: str, every_s: float, look: Callable[[], object], *, at_once: bool = False) -> None:
        self._name, self._every_s, self._look, self._at_once = name, every_s, look, at_once
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def start(self) -> None:
        """Start; returns at once."""
        self._thread.start()

    def stop(self) -> None:
        """Stop, and wait for a look that is being taken; also if it never started."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()

    def _run(self) -> None:
        logged = -LOG_S
        while not self._stop.wait(0.0 if self._at_once else self._every_s):
            self._at_once = False
            try:
                self._look()
            except Exception as error:  # of a store, a disk or an engine that is away
                if time.monotonic() - logged >= LOG_S:
                    logged = time.monotonic()
                    _log.error("look_failed", of=self._name, exc_info=error)
