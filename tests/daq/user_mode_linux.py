"""Runs tests in a kernel with SocketCAN, whatever this computer has: user-mode Linux, a kernel that is a program.

``python tests/daq/user_mode_linux.py [PYTEST ARGUMENT...]`` boots Debian's ``user-mode-linux`` with this
computer's files (read-only), this Python and a virtual CAN bus ``vcan0``, and runs `test_on_socketcan.py` in it. No
right of root is needed, no network, and nothing is written. Where the kernel cannot be had it says why and ends with 0.
"""

from __future__ import annotations

import os
import platform
import shutil
import signal
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
KERNEL = "linux.uml"
BOUND_S = 120.0  # of everything; booting takes two
ENDED = "the tests ended with "  # as user_mode_guest.py says it
BOOT = (
    KERNEL, "mem=768M", "root=/dev/root", "rootfstype=hostfs", "rootflags=/", "ro", "quiet", "con=null",
    "con0=fd:0,fd:1",
)  # fmt: skip


def unavailable() -> str | None:
    """Why there is no such kernel here; None if there is."""
    if sys.platform != "linux" or platform.machine() != "x86_64":
        return "user-mode Linux runs on Linux on x86-64 only"
    if shutil.which(KERNEL) is None:
        return f"there is no {KERNEL}; where Debian's packages can be had: apt-get install user-mode-linux iproute2"
    if shutil.which("ip", path="/usr/bin:/bin:/usr/sbin:/sbin") is None:
        return "there is no ip, which makes the virtual bus: apt-get install iproute2"
    # It ends in a panic as soon as its first program does; where that is not the program's doing, it cannot run here.
    told = subprocess.run(
        [*BOOT, "init=/bin/true"], stdin=subprocess.DEVNULL, capture_output=True, timeout=BOUND_S, check=False
    ).stdout.decode(errors="replace")
    if "exitcode=0x00000000" in told:
        return None
    lines = [line.strip() for line in told.splitlines()]
    panic = next((n for n, line in enumerate(lines) if "panic" in line), len(lines))
    return f"this computer's processor or kernel runs no {KERNEL}: {'; '.join(lines[max(0, panic - 1) : panic + 1])}"


def run(arguments: list[str]) -> int:
    """Boot, run pytest with these arguments, and give its status; 1 if the kernel did not come so far.

    What it prints goes to standard output as it comes.
    """
    command = [*BOOT, f"init={sys.executable}", "--", str(HERE / "user_mode_guest.py"), str(ROOT), *arguments]
    status = 1
    with subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True
    ) as kernel:
        assert kernel.stdout is not None

        def late(signum: int, frame: object) -> None:
            print(f"user-mode Linux did not end within {BOUND_S:g} s, and was ended", flush=True)
            os.killpg(kernel.pid, signal.SIGKILL)

        signal.signal(signal.SIGALRM, late)
        signal.setitimer(signal.ITIMER_REAL, BOUND_S)
        for raw in kernel.stdout:
            line = raw.decode(errors="replace").rstrip()
            if line.startswith(ENDED):
                status = int(line.removeprefix(ENDED))
            else:
                print(line, flush=True)
        signal.setitimer(signal.ITIMER_REAL, 0.0)
    return status


def main() -> int:
    """The command."""
    reason = unavailable()
    if reason is not None:
        print(f"skipped: tests on SocketCAN: {reason}")
        return 0
    return run(sys.argv[1:] or ["-q", "-p", "no:xdist", str((HERE / "test_on_socketcan.py").relative_to(ROOT))])


if __name__ == "__main__":
    raise SystemExit(main())
