"""Wait for a database that is away: being restarted, locked for long, out of disk, or read-only."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

import structlog
from sqlalchemy.exc import DBAPIError, InterfaceError, OperationalError

from server.platform.errors import ServiceStopping

PAUSE_S = 1.0
#: s between two lines about what is waited for.
LOG_S = 60.0
Value = TypeVar("Value")
_log = structlog.stdlib.get_logger(__name__)


def away(error: DBAPIError) -> bool:
    """Test whether an error is of the database's absence, and not of what it was asked."""
    return error.connection_invalidated or isinstance(error, OperationalError | InterfaceError)


@contextmanager
def unless_away() -> Iterator[None]:
    """Do something with the database; nothing comes of it while that is away."""
    try:
        yield
    except DBAPIError as error:
        if not away(error):
            raise


def patiently(do: Callable[[], Value], pause: Callable[[float], object]) -> Value:
    """Return the value of ``do``, repeated as long as the database is away.

    Parameters
    ----------
    do : something that may be done twice
    pause : waits that many seconds; what it raises ends the waiting
    """
    logged = False
    while True:
        try:
            return do()
        except DBAPIError as error:
            if not away(error):
                raise
            if not logged:
                _log.warning("database_away", error=" ".join(str(error.orig).split()))
                logged = True
            pause(PAUSE_S)


class Patience:
    """Waits until something is there, or the process has to stop.

    Parameters
    ----------
    stopping : set when it has to; then ServiceStopping is raised

    Attributes
    ----------
    why : what is waited for by :meth:`until`; None: nothing
    """

    def __init__(self, stopping: threading.Event) -> None:
        self.stopping = stopping
        self.why: str | None = None
        self._logged = -math.inf

    def pause(self, seconds: float) -> None:
        """Wait a while."""
        if self.stopping.wait(seconds):
            raise ServiceStopping

    def patiently(self, do: Callable[[], Value]) -> Value:
        """Return the value of ``do``, however long the database is away."""
        return patiently(do, self.pause)

    def database(self, why: str) -> None:
        """Wait a while for a database that cannot be opened yet."""
        self.until(iter((why, None)).__next__)

    def until(self, why: Callable[[], str | None]) -> None:
        """Wait until nothing is missing, looking every second; once a minute the log names what is."""
        while (found := self.patiently(why)) is not None:
            if time.monotonic() - self._logged > LOG_S:
                self._logged = time.monotonic()
                _log.warning("waiting", reason=found)
            self.why = found
            self.pause(PAUSE_S)
        self.why = None
