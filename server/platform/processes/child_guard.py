"""Run as a script: become another program that is nice, writes nowhere else, and dies with what started it.

``python -I -S child_guard.py PARENT_PID NICENESS CONFINEMENT WRITABLE PROGRAM [ARGUMENT ...]``

CONFINEMENT is the file of :mod:`daq.confinement`, WRITABLE are folders, ``:`` between them.

A server that is killed with SIGKILL cannot stop its children. Without this, a stage of a job would go on
writing while the restarted server runs the same stage again. ``prctl(PR_SET_PDEATHSIG)`` survives ``execve``
(prctl(2)). Kept free of imports beyond the standard library: it runs before every stage.
"""

from __future__ import annotations

import ctypes
import os
import runpy
import signal
import sys

PR_SET_PDEATHSIG = 1
#: ioprio_set(2): of this process, class idle: the disk is its own when nobody else wants it.
_IOPRIO_SET = {"x86_64": 251, "aarch64": 30}
_IDLE = 3 << 13


def die_with(parent: int) -> bool:
    """Let the kernel end this process with ``parent``; False if that is dead already."""
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0) != 0:
        raise OSError(ctypes.get_errno(), "prctl(PR_SET_PDEATHSIG)")
    # The parent may have died before the call above; then no signal will ever come.
    return os.getppid() == parent


def main(parent: int, niceness: int, confinement: str, writable: list[str], command: list[str]) -> None:
    """Replace this process by ``command``; return only if the parent is dead already."""
    if not die_with(parent):
        return
    os.setpriority(os.PRIO_PROCESS, 0, niceness)  # whatever the service itself has
    # Never takes the core from whoever runs when it wakes up: acquisition and HTTP run for microseconds, often.
    os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
    if (number := _IOPRIO_SET.get(os.uname().machine)) is not None:
        ctypes.CDLL(None).syscall(number, 1, 0, _IDLE)  # where it is refused the disk is shared as before
    runpy.run_path(confinement)["confine"](writable)
    os.execvp(command[0], command)


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3], sys.argv[4].split(os.pathsep), sys.argv[5:])
