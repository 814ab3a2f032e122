"""Processor time between ``hilfit serve --simulate`` and the first live frame, one after the other.

On idle cores the time is the processor time of the longest chain: the service (or, beside it, the simulation and its
slowest device), then the acquisition. Measured so, it does not depend on who else uses the computer.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from benchmarks.targets import Check, figure

#: Seconds that may lie there.
MOST_CPU_S = 10.0


def children(pid: int) -> list[int]:
    """List processes that a process started (proc(5))."""
    found = []
    for task in Path(f"/proc/{pid}/task").iterdir():
        found += [int(child) for child in (task / "children").read_text().split()]
    return found


def descendants(pid: int) -> Iterator[int]:
    """Yield every process below one; what has gone meanwhile has none."""
    with suppress(OSError):
        for child in children(pid):
            yield child
            yield from descendants(child)


def cpu_s(pid: int) -> float:
    """Read the processor time of a process itself in s."""
    return cpu_with_children_s(pid)[0]


def cpu_with_children_s(pid: int) -> tuple[float, float]:
    """Read processor time of a process, and of its ended children, in s (proc(5): fields 14 to 17 of stat)."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    user, system, of_children, in_children = (int(ticks) / os.sysconf("SC_CLK_TCK") for ticks in fields[11:15])
    return user + system, of_children + in_children


def before_the_first_frame(service: int) -> Check:
    """Return the check, to be called when the first frame was seen.

    Parameters
    ----------
    service : process of ``hilfit serve --simulate``
    """
    started = {Path(f"/proc/{pid}/cmdline").read_text().replace("\0", " "): pid for pid in children(service)}
    simulation = next(pid for name, pid in started.items() if "simulation_child" in name)
    acquisition = next(pid for name, pid in started.items() if "acquisition_child" in name)
    devices = max((cpu_s(pid) for pid in children(simulation)), default=0.0)
    seconds = max(cpu_s(service), cpu_s(simulation) + devices) + cpu_s(acquisition)
    return figure("processor time before the first frame", seconds, "{:.1f} s", most=MOST_CPU_S)
