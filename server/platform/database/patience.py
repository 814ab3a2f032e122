"""Wait for a database that is away: being restarted, locked for long, out of disk, or read-only."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import structlog
from sqlalchemy.exc import DBAPIError, InterfaceError, OperationalError

PAUSE_S = 1.0
Value = TypeVar("Value")
_log = structlog.stdlib.get_logger(__name__)


def away(error: DBAPIError) -> bool:
    """Whether an error is of the database's being there, and not of what it was asked."""
    return error.connection_invalidated or isinstance(error, OperationalError | InterfaceError)


def patiently(do: Callable[[], Value], pause: Callable[[float], object]) -> Value:
    """The value of ``do``, which is called again as long as the database is away.

    Parameters
    ----------
    do : something that may be done twice
    pause : waits that many seconds; what it raises ends the waiting
    """
    told = False
    while True:
        try:
            return do()
        except DBAPIError as error:
            if not away(error):
                raise
            if not told:
                _log.warning("database_away", error=" ".join(str(error.orig).split()))
                told = True
            pause(PAUSE_S)
