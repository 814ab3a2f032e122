"""One stage of a job while it is done: what it says of itself, whether it has to stop, and the process that does it."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import structlog
from sqlalchemy.exc import DBAPIError

from server.jobs.claims import Claim
from server.jobs.job_store import Jobs
from server.platform.database.patience import away
from server.platform.disk import Free
from server.platform.processes.children import LOOK_S, Child, ChildResult

#: Times that a stage is begun whose process somebody else kills: it may be the victim of a large neighbour, or be too
#: large itself.
ATTEMPTS = 3
#: Free bytes below which a stage that failed did so for want of room, whatever it says.
NO_ROOM_BYTES = 2**20
_log = structlog.stdlib.get_logger(__name__)


@dataclass
class StageWork:
    """A stage while it is done.

    Attributes
    ----------
    part : which of how many stages it is
    words : what it says of itself where it has nothing better
    free : free bytes where its files are
    stopping : whether the service is being stopped
    process : in which its program runs
    timeout_s : most seconds that this may take
    """

    jobs: Jobs
    claim: Claim
    stage: str
    part: tuple[int, int]
    words: str
    free: Free
    stopping: Callable[[], bool]
    process: Child
    timeout_s: float
    _starved: bool = field(default=False, init=False)
    _told: float = field(default=-LOOK_S, init=False)

    # A database that is away does not end a stage: it goes on, and is recorded when the database is back.

    def progress(self, fraction: float, text: str) -> None:
        """It has come so far. Stored four times a second at most: nobody reads faster, and each is a transaction."""
        now, (index, count) = time.monotonic(), self.part
        if now - self._told < LOOK_S or (fraction == 0.0 and text == self.words):  # said when the stage began
            return
        self._told = now
        within = min(1.0, max(0.0, fraction))
        try:
            self.jobs.progress(self.claim.job, self.stage, (index + within) / count, text or self.words, self.claim)
        except DBAPIError as error:
            if not away(error):
                raise

    def should_stop(self) -> bool:
        """Whether the service is stopped, or the job cancelled."""
        # It may have ended, and left its room, by the time that the stage has.
        self._starved = self._starved or self.free() < NO_ROOM_BYTES
        try:
            return self.stopping() or self.jobs.cancelling(self.claim.job, self.claim)
        except DBAPIError as error:
            if not away(error):
                raise
            return False

    def child(self, program: Sequence[str], arguments: Sequence[str], log: Path) -> ChildResult:
        """Run its program; anew where somebody killed it."""
        for attempt in range(1, ATTEMPTS + 1):
            try:
                result = self.process.run(
                    program,
                    arguments,
                    log=log,
                    timeout_s=self.timeout_s,
                    progress=self.progress,
                    should_stop=self.should_stop,
                )
            except OSError as error:
                _log.error("stage_not_started", job=self.claim.job, stage=self.stage, exc_info=error)
                return ChildResult("failed", error=f"cannot run ({error.strerror}); the log of the service says more")
            if result.outcome == "failed" and not result.killed and self._starved:
                return replace(result, error=f"{result.error} (the disk is full)")
            if not result.killed or attempt == ATTEMPTS or self.should_stop():
                break
            _log.warning("stage_killed", job=self.claim.job, stage=self.stage, attempt=attempt)
        return result
