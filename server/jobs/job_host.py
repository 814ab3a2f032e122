"""The host of the executions in one process: store, files, patience, and a process that is kept for the next job."""

from __future__ import annotations

import shutil
import threading
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext

from server.jobs.claims import Claims
from server.jobs.job_kinds import NUMERICAL, JobKind
from server.jobs.job_store import Jobs
from server.platform.database.engine import Database
from server.platform.database.patience import Patience
from server.platform.files import DataDirectory
from server.platform.processes.children import Child

#: Seconds that it stays: to load its libraries takes two, and what it keeps of its recordings is memory.
WARM_S = 5.0


class WarmChild:
    """The process of numerical jobs, which ends when there was no job for :data:`WARM_S`.

    Parameters
    ----------
    used : held by whoever works with it
    """

    def __init__(self, used: threading.Lock) -> None:
        self.child = Child()
        self._used = used
        self._lock = threading.Lock()
        self._timer: threading.Timer | None = None

    def cool(self) -> None:
        """End the process a while after a job is over, unless it is at work then, or another job was over since."""
        with self._lock:
            if self._timer is not None:
                self._timer.cancel()
            self._timer = threading.Timer(WARM_S, self._end)
            self._timer.daemon = True
            self._timer.start()

    def close(self) -> None:
        """End it now."""
        with self._lock:
            if self._timer is not None:
                self._timer.cancel()
        self._end()

    def _end(self) -> None:
        if self._used.acquire(blocking=False):  # else it is at work, and is asked again when that is over
            try:
                self.child.end()
            finally:
                self._used.release()


class JobHost(Patience):
    """One process that runs jobs.

    Parameters
    ----------
    name : of this process among those that share the store; the same after a restart
    leads : whether it stores the jobs, and what they leave
    stage_timeout_s : most seconds that a stage's process may take

    Attributes
    ----------
    stopping : set once no stage may begin any more and running ones are ended, unrecorded
    away : why the storage could not be reached when it was last asked for something
    """

    def __init__(
        self, database: Database, files: DataDirectory, name: str, *, leads: bool, stage_timeout_s: float
    ) -> None:
        super().__init__(threading.Event())
        self.jobs, self.claims, self.files = Jobs(database), Claims(database), files
        self.name, self.leads, self.stage_timeout_s = name, leads, stage_timeout_s
        self.away: str | None = None
        self._one_at_a_time = threading.Lock()
        self._warm = WarmChild(self._one_at_a_time)
        self._idle = threading.Condition()
        self._at_work = 0

    def out_of_reach(self) -> str | None:
        """Explain why no job can be done here now; None if the storage is there, and that of this store."""
        return self.files.storage.check(self.jobs.store())

    def free(self) -> int:
        """Count free bytes where files are kept."""
        return shutil.disk_usage(self.files.root).free

    @contextmanager
    def process(self, kind: JobKind) -> Iterator[Child]:
        """Provide a process for a job's stages; that of numerical ones remains a while, for the next job."""
        if kind.queue != NUMERICAL:
            with Child() as process:
                yield process
            return
        try:
            yield self._warm.child
        finally:
            self._warm.cool()

    @contextmanager
    def working(self, kind: JobKind) -> Iterator[None]:
        """Work on a stage: numerical ones one at a time, as a resumed job may come beside the queue."""
        with self.counted(), self._one_at_a_time if kind.queue == NUMERICAL else nullcontext():
            yield

    @contextmanager
    def counted(self) -> Iterator[None]:
        """Count work that is waited for before the engine stops."""
        with self._idle:
            self._at_work += 1
        try:
            yield
        finally:
            with self._idle:
                self._at_work -= 1
                self._idle.notify_all()

    def close(self, timeout_s: float) -> None:
        """Wait until nobody is at work, and end the process that was kept."""
        with self._idle:
            self._idle.wait_for(lambda: self._at_work == 0, timeout=timeout_s)
        self._warm.close()
