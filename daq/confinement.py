"""Confine a process: from now on it, and what it starts, writes below some folders only.

Linux has this for processes without any rights of their own (Landlock, since kernel 5.13; landlock(7)). It holds until
the process ends, also through ``execve``. What is open stays open. Reading is not confined, and neither are sockets.
Only the standard library is used: this runs before every child.
"""

from __future__ import annotations

import ctypes
import os
import struct
from collections.abc import Iterable
from pathlib import Path

_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446  # the same on every architecture
_VERSION_FLAG, _PATH_BENEATH = 1, 1
_PR_SET_NO_NEW_PRIVS = 38
_WRITE_FILE, _TRUNCATE, _REFER = 1 << 1, 1 << 14, 1 << 13
_ENTRIES = sum(1 << bit for bit in range(4, 13))  # removing and making of files, folders, devices, sockets, links


def landlock_version() -> int:
    """Return the version of the kernel's Landlock; 0 where there is none."""
    if os.uname().sysname != "Linux":
        return 0
    return max(0, int(ctypes.CDLL(None, use_errno=True).syscall(_CREATE_RULESET, None, 0, _VERSION_FLAG)))


def confine(writable: Iterable[str | os.PathLike[str]]) -> bool:
    """Let this process write below ``writable`` only; a folder that is not there allows nothing.

    Returns
    -------
    False where the kernel cannot do that: nothing is confined then. Version 1 and 2 do not see ``truncate(2)``.

    Raises
    ------
    OSError
        If the kernel can do it and does not.
    """
    version = landlock_version()
    if version == 0:
        return False
    libc = ctypes.CDLL(None, use_errno=True)
    rights = _WRITE_FILE | _ENTRIES | (_REFER if version >= 2 else 0) | (_TRUNCATE if version >= 3 else 0)
    ruleset = _checked(libc.syscall(_CREATE_RULESET, struct.pack("=Q", rights), ctypes.c_size_t(8), 0))
    try:
        for path in writable:
            try:
                opened = os.open(path, os.O_PATH | os.O_CLOEXEC)
            except FileNotFoundError:
                continue
            try:
                allowed = rights if Path(path).is_dir() else rights & (_WRITE_FILE | _TRUNCATE)
                rule = struct.pack("=Qi", allowed, opened)
                _checked(libc.syscall(_ADD_RULE, ruleset, _PATH_BENEATH, rule, 0))
            finally:
                os.close(opened)
        _checked(libc.prctl(_PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0))
        _checked(libc.syscall(_RESTRICT_SELF, ruleset, 0))
    finally:
        os.close(ruleset)
    return True


def _checked(result: int) -> int:
    if result < 0:
        number = ctypes.get_errno()
        raise OSError(number, f"Landlock: {os.strerror(number)}")
    return result
