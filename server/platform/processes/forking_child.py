"""A child that loads its libraries once and does each piece of work in a process forked from it.

``python -P -m server.platform.processes.forking_child MODULE [ARGUMENT ...]``, then more such orders on standard input:
``MODULE.main`` takes the arguments and gives the exit code.

Loading what looks at a recording takes two seconds of processor time, a fork a few milliseconds. The forked process
sets its own limits (:mod:`server.platform.processes.child_limits`), does one piece of work and ends, so that a hostile
file meets no process that has seen another one. Speaks the protocol of :mod:`server.platform.processes.children`.
"""

from __future__ import annotations

import gc
import json
import os
import select
import sys
import traceback
from collections.abc import Callable, Sequence
from importlib import import_module

from server.platform.processes.child_guard import die_with

#: Seconds without an order after which the child ends: it holds about 85 MB of memory.
IDLE_S = 60.0
Work = Callable[[Sequence[str]], int]


def main(arguments: Sequence[str], idle_s: float = IDLE_S) -> int:
    """Do the work of every order in a process of its own; returns the exit code.

    Parameters
    ----------
    arguments : of the first order, a module and what its ``main`` takes; further ones come over standard input
    idle_s : seconds without an order after which this returns
    """
    loaded: dict[str, Work] = {}
    log: str | None = None  # of the first order: this process's own standard error
    while True:
        what, *rest = arguments
        if what not in loaded:
            loaded[what] = import_module(what).main
            gc.collect()
            gc.freeze()  # pages of what is loaded stay shared with every fork
        code = _in_a_fork(loaded[what], rest, log)
        # The line before may have been broken off.
        print("\n" + json.dumps({"ended": code, "stays": True}), flush=True)
        order = _next_order(idle_s)
        if order is None:
            return 0
        arguments, log = order


def _next_order(idle_s: float) -> tuple[list[str], str] | None:
    """Read arguments and log of the next order; None if there will be none, or was none for long."""
    if not select.select([sys.stdin], [], [], idle_s)[0]:
        return None
    line = sys.stdin.readline()
    if not line:
        return None
    order = json.loads(line)
    return [str(argument) for argument in order["arguments"]], str(order["log"])


def _in_a_fork(work: Work, arguments: Sequence[str], log: str | None) -> int:
    """Run ``work`` in a forked process; return the exit code, negative if a signal ended it."""
    sys.stdout.flush()
    parent = os.getpid()
    process = os.fork()
    if process:
        return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
    code = 1
    try:
        if die_with(parent):
            _redirect(os.devnull, os.O_RDONLY, 0)
            if log is not None:
                _redirect(log, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 2)
            code = work(arguments)
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _redirect(path: str, flags: int, descriptor: int) -> None:
    opened = os.open(path, flags, 0o600)
    os.dup2(opened, descriptor)
    os.close(opened)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
