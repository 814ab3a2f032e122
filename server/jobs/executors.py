"""Processes that run jobs: each says now and then that it is there; the work of one that fell silent is taken over.

Its own clock decides nothing: what is silent is judged by when its last word was stored, seen from here.
"""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Callable
from importlib.metadata import version
from typing import Annotated

import sqlalchemy as sa

from server.platform.database.engine import Database
from server.platform.database.schema import metadata
from server.platform.database.stored import BESIDE, Kept, Stored
from server.platform.processes.rounds import Rounds

BEAT_S = 5.0
#: An executor that was not heard for so long has lost its work. Long against a garbage collection or a slow disk,
#: short against a fit.
SILENT_S = 30.0
#: Processes that run jobs; one that is silent for long has lost its work to the others.
executors = sa.Table(
    "executors",
    metadata,
    sa.Column("id", sa.String, primary_key=True),
    sa.Column("host", sa.String, nullable=False),
    sa.Column("started", sa.String, nullable=False),
    sa.Column("seen", sa.String, nullable=False),
)


class Host(Stored, table="hosts"):
    """Report of an executor about its host.

    ``load``: processes that wanted to run in the mean of the last minute. ``state``: works, or what it waits for.
    """

    id: Annotated[str, Kept(key=True)]
    host: Annotated[str, BESIDE]  # as in executors
    version: str
    cores: int
    load: float
    state: str
    heard: str


hosts = Host.table


class Silence:
    """Tells which executors have fallen silent.

    Only changes of what they wrote count, on this process' own monotonic clock: hosts need not agree about the time.

    Parameters
    ----------
    clock : s, monotonic
    """

    def __init__(self, database: Database, clock: Callable[[], float] = time.monotonic) -> None:
        self._database = database
        self._clock = clock
        self._began = self._looked = clock()
        self._seen: dict[str, tuple[str, float]] = {}

    def look(self) -> None:
        """Read who was there.

        A time in which nothing could be read is nobody's silence: the database was away for all, or we slept.
        """
        with self._database.read() as connection:
            rows = connection.execute(sa.select(executors.c.id, executors.c.seen)).all()
        now = self._clock()
        deaf = now - self._looked
        self._looked = now
        if deaf > SILENT_S / 2:
            self._began += deaf
            self._seen = {executor: (word, when + deaf) for executor, (word, when) in self._seen.items()}
        for row in rows:
            if self._seen.get(row.id, ("", 0.0))[0] != row.seen:
                self._seen[row.id] = (row.seen, now)

    def silent(self, executor: str) -> bool:
        """Test whether an executor sent nothing for :data:`SILENT_S`; since we listen, if never anything."""
        return self._clock() - self._seen.get(executor, ("", self._began))[1] > SILENT_S


class Heartbeat:
    """Reports now and then that this process is there, and calls ``each`` after it.

    Parameters
    ----------
    executor : name of this process
    each : done after every message; what it raises is logged
    state : what it reports of itself besides
    """

    def __init__(
        self,
        database: Database,
        executor: str,
        each: Callable[[], object] = lambda: None,
        state: Callable[[], str] = lambda: "works",
    ) -> None:
        self._state = state
        self._database = database
        self._executor = executor
        self._each = each
        self._started = database.now()
        self._count = 0
        self._rounds = Rounds("presence", BEAT_S, self._beat)

    def start(self) -> None:
        """Start; the first message is out before this returns."""
        self.send()
        self._rounds.start()

    def stop(self) -> None:
        """Stop."""
        self._rounds.stop()

    def send(self) -> None:
        """Log it once."""
        self._count += 1
        # The count makes every message a new one, whatever the clock does.
        values = {"host": socket.gethostname(), "started": self._started, "seen": f"{self._started} {self._count}"}
        own = {
            "version": version("hilfit"),
            "cores": os.cpu_count() or 1,
            "load": os.getloadavg()[0],
            "state": self._state(),
            "heard": self._database.now(),
        }
        with self._database.write() as connection:
            known = connection.execute(executors.update().where(executors.c.id == self._executor).values(**values))
            if known.rowcount == 0:
                connection.execute(executors.insert().values(id=self._executor, **values))
            connection.execute(hosts.delete().where(hosts.c.id == self._executor))
            connection.execute(hosts.insert().values(id=self._executor, **own))

    def _beat(self) -> None:
        self.send()
        self._each()
