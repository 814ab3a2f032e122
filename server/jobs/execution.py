"""One execution of a job on one host: its stages as steps, from its claim to its end."""

from __future__ import annotations

import errno
import os
import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import structlog

from daq.errors import HilfitError
from daq.messages import Sentence, named
from server.jobs.claims import Claim
from server.jobs.job_host import JobHost
from server.jobs.job_kinds import JobError, JobKind, StageRun
from server.jobs.job_places import begin, place_name, tidy
from server.jobs.job_store import FINAL, Job, Result, State
from server.platform.database.patience import PAUSE_S, Value, unless_away
from server.platform.errors import ServiceStopping, TakenOver
from server.platform.files import RESERVE_BYTES, sync_tree
from server.platform.processes.children import LOOK_S, Child, ChildResult
from server.platform.storage import StorageAwayError

#: What a stage may say that failed for want of room.
NO_ROOM_WORDS = (os.strerror(errno.ENOSPC), os.strerror(errno.EDQUOT), "disk is full")
NO_ROOM = Sentence("server.waiting_for_room")
#: s between two looks at a storage that is away, and until a job that was begun is left to another host.
AWAY_S, PATIENCE_S = 1.0, 300.0
#: s of work that may be done again where another host goes on with a job: what a stage left is shared once more than
#: this would be, and at the end. To share costs as much as a short stage.
KEEP_S = 5.0
#: Times that a stage is begun whose process somebody else kills: it may be the victim of a large neighbour, or be too
#: large itself.
ATTEMPTS = 3
#: Free bytes below which a stage that failed did so for want of room, whatever it says.
NO_ROOM_BYTES = 2**20
_log = structlog.stdlib.get_logger(__name__)


@dataclass
class _StageWork:
    """A stage while it is done.

    Attributes
    ----------
    part : which of how many stages it is
    words : what it says of itself where it has nothing better
    process : in which its program runs
    """

    host: JobHost
    claim: Claim
    stage: str
    part: tuple[int, int]
    words: str
    process: Child
    _starved: bool = field(default=False, init=False)
    _recorded: float = field(default=-LOOK_S, init=False)

    # A database that is away does not end a stage: it goes on, and is recorded when the database is back.

    def progress(self, fraction: float, text: str) -> None:
        """Record its progress. Stored four times a second at most: nobody reads faster, and each is a transaction."""
        now, (index, count) = time.monotonic(), self.part
        if now - self._recorded < LOOK_S or (fraction == 0.0 and text == self.words):  # recorded when the stage began
            return
        self._recorded = now
        within = min(1.0, max(0.0, fraction))
        with unless_away():
            jobs = self.host.jobs
            jobs.progress(self.claim.job, self.stage, (index + within) / count, text or self.words, self.claim)

    def should_stop(self) -> bool:
        """Test whether the service is stopped, or the job cancelled."""
        # It may have ended, and left its room, by the time that the stage has.
        self._starved = self._starved or self.host.free() < NO_ROOM_BYTES
        with unless_away():
            if self.host.stopping.is_set() or self.host.jobs.cancelling(self.claim.job, self.claim):
                return True
        return False

    def child(self, program: Sequence[str], arguments: Sequence[str], log: Path) -> ChildResult:
        """Run its program; anew where somebody killed it."""
        for attempt in range(1, ATTEMPTS + 1):
            try:
                result = self.process.run(
                    program,
                    arguments,
                    log=log,
                    timeout_s=self.host.stage_timeout_s,
                    progress=self.progress,
                    should_stop=self.should_stop,
                )
            except OSError as error:
                _log.error("stage_not_started", job=self.claim.job, stage=self.stage, exc_info=error)
                return ChildResult("failed", error=Sentence("server.cannot_run", reason=error.strerror))
            if result.outcome == "failed" and not result.killed and self._starved:
                return replace(result, error=Sentence("server.while_disk_full", error=result.error))
            if not result.killed or attempt == ATTEMPTS or self.should_stop():
                break
            _log.warning("stage_killed", job=self.claim.job, stage=self.stage, attempt=attempt)
        return result


class Execution:
    """The stages of a job on this host.

    Parameters
    ----------
    claim : of the job
    process : in which its stages run
    requeue : lets any executor go on with it
    """

    def __init__(
        self, host: JobHost, kind: JobKind, row: Job, claim: Claim, process: Child, requeue: Callable[[Job], None]
    ) -> None:
        self._host, self._kind, self._row, self._claim, self._process = host, kind, row, claim, process
        self._requeue = requeue
        self._directory = kind.directory(row)
        self._place: str | None = None
        self._files: Mapping[str, str] = {}
        self._at_stake_s = 0.0  # of finished work that no other host has

    def begin_after(self, result: Mapping[str, Any]) -> None:
        """Begin the next stage after what was recorded of the one before, here or on another host."""
        self._place, self._files = result["place"], result["files"]
        self._at_stake_s = result.get("at_stake_s", 0.0)

    def run_stage(self, stage: str, part: tuple[int, int]) -> dict[str, Any]:
        """Run one stage, as a step, which is ``part`` of how many; return what is recorded of it."""
        host, row, name, began = self._host, self._row, place_name(self._claim, stage), time.monotonic()
        stopped = {"outcome": "stopped", "stage": stage, "error": None, "place": self._place, "files": self._files}
        with host.working(self._kind):
            if host.stopping.is_set():
                raise ServiceStopping
            shown = self._kind.words(stage)
            if not host.patiently(lambda: host.jobs.progress(row.id, stage, part[0] / part[1], shown, self._claim)):
                return stopped
            for attempt in range(1, ATTEMPTS + 1):
                result = self._kept(stage, part, name)
                if result.outcome != "failed" or attempt == ATTEMPTS or not self._lacked_room(result):
                    break
                _log.warning("stage_without_room", job=row.id, stage=stage, error=result.error)
                if not self._wait_for_room(stage, part):
                    return stopped
                shutil.rmtree(self._directory / name, ignore_errors=True)
            last = part[0] + 1 == part[1] or result.outcome != "done"
            at_stake = self._at_stake_s + time.monotonic() - began
            share = last or at_stake > KEEP_S
            files = self._share(name) if share else {}
        _log.info("stage_ended", job=row.id, stage=stage, outcome=result.outcome, error=result.error)
        kept = {"place": name, "files": files, "at_stake_s": 0.0 if share else at_stake}
        return self._outcome(stage, result) | kept

    def _share(self, name: str) -> Mapping[str, str]:
        """Let other hosts go on from what is in a place; its files by SHA-256."""
        storage, folder = self._host.files.storage, self._host.files.key(self._directory)
        return self._stored(partial(storage.keep, self._directory / name, folder))

    def _kept(self, stage: str, part: tuple[int, int], name: str) -> ChildResult:
        """Do a stage in its place, and see to it that its files survive a power cut."""
        try:
            start = partial(begin, self._host.files, self._directory, name, self._place, self._files)
            result = self._work(stage, part, self._directory / name, self._stored(start))
            sync_tree(self._directory / name)  # before it is recorded
        except OSError as error:
            reason = Sentence("server.files_cannot_be_kept", reason=error.strerror or error)
            result = ChildResult("failed", error=reason)
        if self._host.stopping.is_set() and result.outcome != "done":
            raise ServiceStopping
        return result

    def _lacked_room(self, result: ChildResult) -> bool:
        return self._host.free() < NO_ROOM_BYTES or any(words in (result.error or "") for words in NO_ROOM_WORDS)

    def _wait_for_room(self, stage: str, part: tuple[int, int]) -> bool:
        """Wait until somebody made room; False if the job was cancelled meanwhile."""
        jobs, id, recorded = self._host.jobs, self._row.id, False
        while self._host.free() <= RESERVE_BYTES:
            self._host.pause(PAUSE_S)
            with unless_away():
                if not recorded and not jobs.progress(id, stage, part[0] / part[1], NO_ROOM, self._claim):
                    return False
                recorded = True
                if jobs.cancelling(id, self._claim):
                    return False
        return True

    @cached_property
    def _wanted(self) -> dict[str, str]:
        """SHA-256 of what the job reads, by key."""
        host = self._host
        sums = host.patiently(lambda: host.jobs.files(self._row.id, "input"))
        paths = host.patiently(lambda: self._kind.inputs(self._row))
        return {key: sums.get(key, "") for key in map(host.files.key, paths)}

    def _work(self, stage: str, part: tuple[int, int], place: Path, whole: bool) -> ChildResult:
        host, row, key = self._host, self._row, self._host.files.key
        work = _StageWork(host, self._claim, stage, part, self._kind.words(stage), self._process)
        _log.info("stage_started", job=row.id, stage=stage)
        try:
            inputs = self._stored(lambda: host.files.storage.local(self._wanted))
            run = StageRun(row, stage, work.progress, work.should_stop, work.child, place, whole, inputs, key)
            return host.patiently(lambda: self._kind.run(run))
        except HilfitError as error:
            return ChildResult("input", error=str(error))
        except Exception as error:  # whatever it is, the job has to end
            _log.error("stage_broke", job=row.id, stage=stage, exc_info=error)
            return ChildResult("failed", error=Sentence("server.broke_unexpectedly"))

    def _stored(self, do: Callable[[], Value]) -> Value:
        """Return the value of ``do``, repeated while the storage is away; another host's turn when that lasts.

        Raises
        ------
        TakenOver
            After :data:`PATIENCE_S`.
        """
        host, end = self._host, time.monotonic() + PATIENCE_S
        while True:
            try:
                value, host.away = do(), None
                return value
            except StorageAwayError as error:
                host.away = str(error)
                _log.warning("storage_away", job=self._row.id, error=str(error))
                if time.monotonic() > end:
                    host.patiently(lambda: host.claims.give_back(self._claim))
                    self._requeue(self._row)
                    raise TakenOver(named(self._row.id, str(error))) from None
                host.pause(AWAY_S)

    def _outcome(self, stage: str, result: ChildResult) -> dict[str, Any]:
        """Return what the engine records of a stage; an input's error as it is, any other names the stage."""
        error = result.error
        if error is not None:
            # Where the service keeps its files is nobody's business.
            error = self._host.files.without_place(error)
            error = Sentence("server.stage_error", stage=stage, error=error) if result.outcome == "failed" else error
        return {"outcome": result.outcome, "stage": stage, "error": error, "summary": result.summary}

    def finish(self, result: Mapping[str, Any]) -> str:
        """Store the outcome, once, as a step; running it twice changes nothing."""
        return self._host.patiently(lambda: self._store(result))

    def _store(self, result: Mapping[str, Any]) -> str:
        row = self._host.jobs.get(self._row.id)
        if row.state in FINAL:  # killed after it was stored, before the engine knew
            return row.state
        kind, place = self._kind, result.get("place")
        error: str | None = None
        found: Result | None = None
        state: State
        if result["outcome"] == "done":
            state, text = "done", Sentence("server.done")
            try:
                found = kind.result(row, self._directory / (place or ""))
            except JobError as failure:
                state, text, error = "failed", Sentence("server.failed"), str(failure)
        elif result["outcome"] == "stopped":
            state, text = "cancelled", Sentence("server.cancelled")
        else:
            state, text, error = (
                "failed",
                Sentence("server.stage_failed", stage=kind.words(result["stage"])),
                result["error"],
            )
        kind.ended(row, state, error)  # first: whoever sees the end of the job sees what follows from it
        files = result.get("files")
        self._host.jobs.finish(row.id, state, text, error, claim=self._claim, result=found, place=place, files=files)
        return state

    def leave(self) -> None:
        """Let go of the job; if it is over, remove the files that do not count, whoever wrote them."""
        host = self._host
        with suppress(ServiceStopping):  # the claim is released at the next start, or revoked if there is none
            host.patiently(lambda: host.claims.give_back(self._claim))
            row = host.patiently(lambda: host.jobs.get(self._row.id))
            if row.place is not None:
                keep = row.place if host.leads or not host.files.storage.shared else None
                kept = host.patiently(lambda: host.jobs.files(row.id, "result"))
                tidy(host.files, self._directory, keep, set(kept.values()))
