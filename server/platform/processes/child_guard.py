"""Run as a script: become another program that is nice, writes nowhere else, and dies with what started it.

``python -I -S child_guard.py PARENT_PID NICENESS CONFINEMENT WRITABLE PROGRAM [ARGUMENT ...]``

NICENESS are two: of the process, and of its session among all others. CONFINEMENT is the file of
:mod:`daq.confinement`, WRITABLE are folders, ``:`` between them.

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
import time

PR_SET_PDEATHSIG = 1
#: ioprio_set(2): of this process, class idle: the disk is its own when nobody else wants it.
_IOPRIO_SET = {"x86_64": 251, "aarch64": 30}
_IDLE = 3 << 13
#: Of this process's session, among all sessions (sched(7)); a change may have to wait 0.1 s for another one.
_AUTOGROUP, _PATIENCE_S = "/proc/self/autogroup", 2.0


def die_with(parent: int) -> bool:
    """Let the kernel end this process with ``parent``; return False if that is dead already."""
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0) != 0:
        raise OSError(ctypes.get_errno(), "prctl(PR_SET_PDEATHSIG)")
    # The parent may have died before the call above; then no signal will ever come.
    return os.getppid() == parent


def rank_session(niceness: int) -> None:
    """Rank this process's session among the others; what is refused is left as it was.

    Where the kernel shares the processor session by session, as Debian's does, a process's own niceness counts only
    within its session: a nice child in a session of its own would have as much of the processor as all of the service.
    """
    end = time.monotonic() + _PATIENCE_S
    while time.monotonic() < end:
        try:
            with open(_AUTOGROUP, "w") as file:  # noqa: PTH123 - pathlib takes longer to load than all of this
                file.write(str(niceness))
        except BlockingIOError:
            time.sleep(0.02)
        except OSError:  # no such kernel, or no right to rank higher
            return
        else:
            return


def main(parent: int, niceness: list[int], confinement: str, writable: list[str], command: list[str]) -> None:
    """Replace this process by ``command``; return only if the parent is dead already."""
    if not die_with(parent):
        return
    os.setpriority(os.PRIO_PROCESS, 0, niceness[0])  # whatever the service itself has
    rank_session(niceness[1])
    # Never takes the core from whoever runs when it wakes up: acquisition and HTTP run for microseconds, often.
    os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
    if (number := _IOPRIO_SET.get(os.uname().machine)) is not None:
        ctypes.CDLL(None).syscall(number, 1, 0, _IDLE)  # where it is refused the disk is shared as before
    runpy.run_path(confinement)["confine"](writable)
    os.execvp(command[0], command)


if __name__ == "__main__":
    main(
        int(sys.argv[1]),
        [int(own) for own in sys.argv[2].split()],
        sys.argv[3],
        sys.argv[4].split(os.pathsep),
        sys.argv[5:],
    )
