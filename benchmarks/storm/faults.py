"""Faults in a storm beside kills: a full disk, a store that refuses to be written, a clock that is set.

A disk that can be filled is a file system of its own in memory, which only root may mount; so is the attribute that
makes SQLite's file and folder immutable. Where this process may not, the storm goes without, which a check shows.
"""

from __future__ import annotations

import fcntl
import os
import random
import struct
import subprocess
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path

from benchmarks.service.postgresql import PostgreSQL
from benchmarks.storm.clock import SetClock
from server.platform.files import DataDirectory

#: The small disk: what the service keeps free (256 MiB), and room for the storm and PostgreSQL.
DISK_BYTES = 900 * 2**20
#: Seconds, from and to, that a fault lasts, and that lie between two of them.
Pace = tuple[tuple[float, float], tuple[float, float]]
PACE: Pace = ((2.0, 5.0), (4.0, 9.0))
#: Seconds by which the clock is set, one after the other: less than what the schedules write down one by one.
JUMPS_S = (1020.0, -1500.0, 660.0, -240.0)
#: FS_IOC_GETFLAGS, FS_IOC_SETFLAGS and FS_IMMUTABLE_FL of linux/fs.h.
_GET, _SET, _IMMUTABLE = 0x80086601, 0x40086602, 0x10


def _nothing() -> None:
    """Leave it as it is."""


@dataclass(frozen=True)
class Fault:
    """Something that goes wrong for a while.

    Attributes
    ----------
    begin : lets it go wrong
    hold : acts again and again until it ends; most stay as they are
    end : puts it right; what does not say how goes on from there
    """

    name: str
    begin: Callable[[], None]
    hold: Callable[[], None] = _nothing
    end: Callable[[], None] = _nothing


@contextmanager
def small_disk() -> Iterator[Path | None]:
    """Mount a file system of :data:`DISK_BYTES`, removed at the end; None where that is forbidden."""
    place = Path(tempfile.mkdtemp(prefix="hilfit-storm-disk-"))
    # PostgreSQL's account has to come through.
    place.chmod(0o755)
    options = f"size={DISK_BYTES},mode=0755"
    mounted = _runs("mount", "-t", "tmpfs", "-o", options, "hilfit-storm", str(place))
    try:
        yield place if mounted else None
    finally:
        # Whatever still looks at it keeps it until then, unseen.
        if mounted and not _runs("umount", str(place)):
            _runs("umount", "-l", str(place))
        place.rmdir()


def _runs(*command: str) -> bool:
    try:
        return subprocess.run(command, capture_output=True, timeout=30, check=False).returncode == 0
    except OSError:
        return False


def _full_disk(disk: Path) -> Fault:
    """Take every byte of a file system, and those that others give back meanwhile."""
    ballast = disk / "ballast"

    def fill() -> None:
        with ballast.open("ab") as file:
            found = os.fstatvfs(file.fileno())
            step = found.f_bavail * found.f_frsize
            while step >= found.f_frsize:
                try:
                    os.posix_fallocate(file.fileno(), os.fstat(file.fileno()).st_size, step)
                    return
                except OSError:  # somebody was quicker
                    step //= 2

    return Fault("disk full", fill, fill, lambda: ballast.unlink(missing_ok=True))


def _read_only(refuse: Callable[[bool], None]) -> Fault:
    """Let the store refuse to be changed; ``refuse`` makes it so, or takes that back."""
    return Fault("store read-only", begin=lambda: refuse(True), end=lambda: refuse(False))


def _immutable_database(database: Path) -> Fault:
    """Make SQLite's file, and the folder in which it makes its journal, immutable."""

    def refuse(wanted: bool) -> None:
        for place in (database.parent, database):
            _immutable(place, wanted)

    return _read_only(refuse)


def _may_be_immutable(place: Path) -> bool:
    """Test whether this process may set the attribute, and take it away."""
    try:
        _immutable(place, True)
        _immutable(place, False)
    except OSError:
        return False
    return True


def _immutable(place: Path, wanted: bool) -> None:
    descriptor = os.open(place, os.O_RDONLY)
    try:
        (flags,) = struct.unpack("l", fcntl.ioctl(descriptor, _GET, bytes(struct.calcsize("l"))))
        flags = flags | _IMMUTABLE if wanted else flags & ~_IMMUTABLE
        fcntl.ioctl(descriptor, _SET, struct.pack("l", flags))
    finally:
        os.close(descriptor)


def _read_only_sessions(server: PostgreSQL) -> Fault:
    """Make PostgreSQL's transactions read-only unless a session sets otherwise."""
    return _read_only(lambda on: server.set("default_transaction_read_only", "on" if on else None))


def _clock_set(clock: SetClock) -> Fault:
    """Set the hosts' wall clock, forward and back; it is not put right until it is set again."""
    jumps = cycle(JUMPS_S)

    def jump() -> None:
        clock.seconds += next(jumps)

    return Fault("clock set", jump)


def possible_faults(
    files: DataDirectory, disk: Path | None, server: PostgreSQL | None, clock: SetClock
) -> tuple[Fault, ...]:
    """Return the faults that this process may make.

    Parameters
    ----------
    files, server : the store: a directory with SQLite's file, or PostgreSQL
    disk : file system that may be filled; None where none could be mounted
    clock : of the hosts
    """
    found: list[Fault] = [_clock_set(clock)]
    if disk is not None:
        found.append(_full_disk(disk))
    if server is not None:
        found.append(_read_only_sessions(server))
    elif _may_be_immutable(files.root):
        found.append(_immutable_database(files.database))
    return tuple(found)


class Weather:
    """One fault after another, with calm between them.

    Parameters
    ----------
    faults : in an order of chance, each once before one comes again
    chance : of order and lengths
    pace : s that a fault lasts, and that lie between two, each from and to

    Attributes
    ----------
    faults : all of them
    seen : how often each began
    """

    def __init__(self, faults: Sequence[Fault], chance: random.Random, pace: Pace) -> None:
        self.faults = tuple(faults)
        self._chance = chance
        self._lasts, self._calm = pace
        self._left: list[Fault] = []
        self._now: Fault | None = None
        self._until = time.monotonic() + chance.uniform(*self._calm)
        self.seen: Counter[str] = Counter()

    @property
    def all_seen(self) -> bool:
        """True if each fault came at least once, and none is there now."""
        return self._now is None and all(self.seen[fault.name] for fault in self.faults)

    @property
    def shown(self) -> str:
        """Present faults, behind a comma."""
        return "" if self._now is None else f", {self._now.name}"

    def go_on(self) -> None:
        """Begin, hold or end what is due; called often."""
        if self._now is not None:
            self._now.hold()
        if not self.faults or time.monotonic() < self._until:
            return
        if self._now is not None:
            self.clear()
            return
        if not self._left:
            self._left = self._chance.sample(self.faults, len(self.faults))
        self._now = self._left.pop()
        self._until = time.monotonic() + self._chance.uniform(*self._lasts)
        self.seen[self._now.name] += 1
        self._now.begin()

    def clear(self) -> None:
        """End what is there."""
        over, self._now = self._now, None
        if over is not None:
            over.end()
        self._until = time.monotonic() + self._chance.uniform(*self._calm)
