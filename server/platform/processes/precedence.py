"""The service before whatever else runs on its computer: a tablet's request takes a millisecond of work.

Two things, each as far as the kernel lets us. A lower nice value takes a right (root, CAP_SYS_NICE, ``LimitNICE``);
where the service leads its session, as one that systemd or a container starts does, the session has it too. A shorter
slice takes none (EEVDF, Linux 6.12): whoever asks for little at a time has its turn sooner, and gets no more of
the processor than before. Threads that start later have both; children choose for themselves.
"""

from __future__ import annotations

import ctypes
import os
import struct
from contextlib import suppress

from server.platform.processes.child_guard import rank_session

NICENESS = -10
#: s * 1e-9; the shortest that the kernel takes.
SLICE_NS = 100_000
_SCHED_SETATTR = {"x86_64": 314, "aarch64": 274}
_ATTRIBUTES = "=IIQiIQQQ"  # sched_attr, version 0: size, policy, flags, nice, priority, runtime, deadline, period


def take_niceness() -> bool:
    """Ask for the niceness, for this thread and those that it starts; return whether it has that now."""
    with suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, min(NICENESS, os.getpriority(os.PRIO_PROCESS, 0)))
    return os.getpriority(os.PRIO_PROCESS, 0) <= NICENESS


def take_precedence() -> None:
    """Ask for both, for this thread and those that it starts; what is refused is left as it was."""
    if take_niceness() and os.getsid(0) == os.getpid():  # a person's shell would keep it
        rank_session(NICENESS)
    number = _SCHED_SETATTR.get(os.uname().machine)
    if number is not None and os.sched_getscheduler(0) == os.SCHED_OTHER:
        nice = os.getpriority(os.PRIO_PROCESS, 0)
        size = struct.calcsize(_ATTRIBUTES)
        asked = struct.pack(_ATTRIBUTES, size, os.SCHED_OTHER, 0, nice, 0, SLICE_NS, 0, 0)
        ctypes.CDLL(None).syscall(number, 0, asked, 0)
