"""Limits of a process that reads files from outside: the kernel ends it beyond that.

The limits of :func:`resource.setrlimit` hold for the process that sets them. Each is far above what an honest file
takes, so that who meets one has sent something else.
"""

from __future__ import annotations

import os
import resource

#: Seconds of processor time for one machine file; the largest that is taken (:mod:`daq.safe_yaml`) needs about 2.
MACHINE_FILE_CPU_S = 15
#: For the DBC files of a machine.
DBC_CPU_S = 60
#: For one recording; reading 512 MB of CSV takes about a minute on one slow core.
RECORDING_CPU_S = 120
#: Address space, most of it never used, of Python with numpy, pyarrow and its threads while it reads a small CSV (1.8
#: GiB on two cores, 0.2 of it in memory), and what each further core adds.
_PROGRAM_BYTES, _CORE_BYTES = 3 * 2**30, 128 * 2**20
#: Memory that a process can write to: 0.4 GB for the same, more for readers of other tools' files.
_DATA_BYTES, _CORE_DATA_BYTES = 1536 * 2**20, 64 * 2**20
#: Bytes in memory per byte of a file: the shortest number of a CSV is two bytes of text and eight in memory, and
#: reading keeps the text, the table and two copies of it at once.
_PER_BYTE = 16
#: The largest file that a child may write.
_LARGEST_FILE = 8 * 2**30


def limit_child(cpu_s: int, file_bytes: int = 0) -> None:
    """Limit this process from now on.

    Parameters
    ----------
    cpu_s : seconds of processor time from now; then the kernel ends the process with SIGXCPU
    file_bytes : size of the file that it reads; memory beyond what that needs raises MemoryError
    """
    cores = os.cpu_count() or 1
    usage = resource.getrusage(resource.RUSAGE_SELF)
    used = usage.ru_utime + usage.ru_stime
    for kind, most in (
        (resource.RLIMIT_AS, _PROGRAM_BYTES + cores * _CORE_BYTES + _PER_BYTE * file_bytes),
        (resource.RLIMIT_DATA, _DATA_BYTES + cores * _CORE_DATA_BYTES + _PER_BYTE * file_bytes),
        (resource.RLIMIT_CPU, round(used + 0.5) + cpu_s),  # lowered and raised again by a process that stays
        (resource.RLIMIT_FSIZE, _LARGEST_FILE),
        (resource.RLIMIT_CORE, 0),
    ):
        _, hard = resource.getrlimit(kind)
        resource.setrlimit(kind, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))
