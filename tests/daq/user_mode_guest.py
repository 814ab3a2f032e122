"""The first process of the kernel that :mod:`user_mode_linux` boots: makes ``vcan0``, then runs the tests.

``python user_mode_guest.py ROOT ARGUMENT...`` runs pytest with these arguments in ROOT, and a line of its own says how
it ended.
Everything of the host is there to be read; what is written goes to memory and is gone at the end.
"""

from __future__ import annotations

import ctypes
import os
import platform
import subprocess
import sys
from pathlib import Path

ENDED = "the tests ended with "
MODULES = ("can-dev", "can", "can-raw", "can-bcm", "vcan")  # in the order in which they need one another
#: What is written goes here: in `/tmp` the tests themselves may lie.
MEMORY = Path("/dev/shm")
_FINIT_MODULE = 313  # system call of x86-64, the only processor that user-mode Linux runs on
_POWER_OFF = 0x4321FEDC  # reboot(2)
_libc = ctypes.CDLL(None, use_errno=True)


def _checked(result: int, what: str) -> None:
    if result != 0:
        raise OSError(ctypes.get_errno(), f"{what}: {os.strerror(ctypes.get_errno())}")


def mount(kind: str, place: str) -> None:
    """Mount a file system that needs no device."""
    _checked(_libc.mount(kind.encode(), place.encode(), kind.encode(), 0, None), f"mount {place}")


def load(name: str) -> None:
    """Load a module of the kernel; where it is built in there is no file, and nothing to do."""
    for path in Path("/usr/lib/uml/modules", platform.release()).rglob(f"{name}.ko"):
        with path.open("rb") as module:
            _checked(_libc.syscall(_FINIT_MODULE, module.fileno(), b"", 0), f"load {name}")


def main() -> None:
    """Everything, then off."""
    root, *arguments = (word for word in sys.argv[1:] if not word.startswith("console="))  # the kernel's own
    status = 1
    try:
        MEMORY.mkdir(exist_ok=True)
        for kind, place in (("proc", "/proc"), ("sysfs", "/sys"), ("tmpfs", str(MEMORY))):
            mount(kind, place)
        for name in MODULES:
            load(name)
        environment = {"PATH": "/usr/bin:/bin:/usr/sbin:/sbin", "PYTHONDONTWRITEBYTECODE": "1"}
        environment |= {"HOME": str(MEMORY), "TMPDIR": str(MEMORY)}
        for command in ("link add dev vcan0 type vcan", "link set vcan0 up", "link set lo up"):
            subprocess.run(["ip", *command.split()], check=True, env=environment)
        pytest = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", *arguments]
        status = subprocess.run(pytest, cwd=root, env=environment, check=False).returncode
    finally:
        print(f"{ENDED}{status}", flush=True)
        _libc.sync()
        _libc.reboot(_POWER_OFF)


if __name__ == "__main__":
    main()
