"""Last words of a child program, in the protocol of :mod:`server.platform.processes.children`."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

from daq.errors import HilfitError, InputError
from daq.messages import with_their_messages


def send(**content: Any) -> None:
    """Write a line of the protocol."""
    print(json.dumps(with_their_messages(content)), flush=True)


def ended(work: Callable[[], dict[str, Any] | None], too_much: str = "needs too much memory") -> int:
    """Do the work of a child and report how it ended; return the exit code.

    Parameters
    ----------
    work : returns the summary; what it raises as HilfitError is the error, and 2 the code of an InputError
    too_much : what is reported, in one line, if there is not enough memory for it
    """
    try:
        send(summary=work() or {})
    except HilfitError as error:
        send(error=str(error))
        return 2 if isinstance(error, InputError) else 1
    except (MemoryError, RecursionError):
        send(error=too_much)
        return 2
    return 0
