"""Jobs as durable workflows (DBOS): each stage is a step that is recorded once it is done.

After a crash, at whatever moment, the next start goes on with the first stage that has no recorded result.
What a person sees of a job is in our own store (:class:`server.jobs.job_store.Jobs`); the engine's tables are its
private business. Inputs and results are kept as JSON, never as pickles.
"""

from __future__ import annotations

import contextvars
import errno
import os
import shutil
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, suppress
from functools import partial
from pathlib import Path
from typing import Any

import structlog
from dbos import DBOS, DBOSPortableJSONSerializer, SetWorkflowID
from sqlalchemy.exc import DBAPIError

from daq.errors import HilfitError
from server.jobs.claims import Claim, Claims
from server.jobs.job_kinds import AT_MACHINES, NUMERICAL, JobError, JobKind, StageRun
from server.jobs.job_places import begin, place_name, tidy
from server.jobs.job_store import FINAL, Job, Jobs, Result, State
from server.jobs.stage_work import ATTEMPTS, NO_ROOM_BYTES, StageWork
from server.platform.database.engine import Database
from server.platform.database.patience import PAUSE_S, Value, away, patiently
from server.platform.disk import RESERVE_BYTES
from server.platform.errors import ServiceStopping, TakenOver
from server.platform.files import DataDirectory, sync_tree
from server.platform.processes.children import GRACE_S, LOOK_S, Child, ChildResult
from server.platform.processes.errands import Errands
from server.platform.storage import StorageAwayError, digest, input_key

#: Jobs of a queue that one process runs at a time. Numerical work may take all cores but those of acquisition and
#: HTTP; what is done at machines is mostly waiting, and one machine has one at a time.
QUEUES: Mapping[str, int] = {NUMERICAL: 1, AT_MACHINES: 200}
#: Changed when the order or meaning of a workflow's steps changes: only workflows of the same version are
#: resumed.
WORKFLOW_VERSION = "hilfit-jobs-1"
#: The engine resumes what its own executor left behind, so the name has to be the same after a restart. The
#: lock of the data directory sees to it that two servers never share it.
EXECUTOR = "server"
POLL_S = 0.25
#: Seconds that the process of a numerical job stays for the next one: to load its libraries takes two, and what it
#: keeps of its recordings is memory.
WARM_S = 5.0
#: What a stage may say that failed for want of room.
NO_ROOM_WORDS = (os.strerror(errno.ENOSPC), os.strerror(errno.EDQUOT), "disk is full")
#: Held by the runner that has started the engine, which keeps its state in its module.
_ENGINE = threading.Lock()
#: s between two looks at a storage that is away, and until a job that was begun is left to another host.
AWAY_S, PATIENCE_S = 1.0, 300.0
#: Place of the stage before, and SHA-256 of its files by name.
Before = tuple[str | None, Mapping[str, str]]
NO_ROOM = "Waiting for room on the disk"
_LOST = "the job broke off unexpectedly; order it again"
_log = structlog.stdlib.get_logger(__name__)


def _register(queue: str, count: int) -> None:
    DBOS.register_queue(queue, worker_concurrency=count, polling_interval_sec=POLL_S, on_conflict="always_update")


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
        """A job is over: end the process after a while, unless it is at work then, or another job was over since."""
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


class JobRunner:
    """Runs jobs: numerical ones one after another, each in a process of its own.

    Parameters
    ----------
    kinds : what jobs there are
    stage_timeout_s : most seconds that a stage's process may take
    executor : name of this process among those that share the store; the same after a restart
    queues : from which it takes jobs; it may put jobs into all of them

    Attributes
    ----------
    errands : small durable work beside jobs
    away : why the storage could not be reached when it was last asked for something
    """

    def __init__(
        self,
        database: Database,
        files: DataDirectory,
        kinds: Sequence[JobKind],
        *,
        stage_timeout_s: float,
        executor: str = EXECUTOR,
        queues: Sequence[str] = tuple(QUEUES),
    ) -> None:
        self._database = database
        self._files = files
        self._kinds = {kind.name: kind for kind in kinds}
        self._stage_timeout_s = stage_timeout_s
        self._executor = executor
        self._queues = tuple(queues)
        self._jobs = Jobs(database)
        self._claims = Claims(database)
        self._stopping = threading.Event()
        self._one_at_a_time = threading.Lock()
        self._warm = WarmChild(self._one_at_a_time)
        self._idle = threading.Condition()
        self._at_work = 0
        self._workflows: dict[str, Any] = {}
        self._started = False
        self.errands = Errands()
        self.away: str | None = None

    def start(self) -> None:
        """Start the engine: unfinished jobs go on, waiting ones are taken from the queues."""
        if not _ENGINE.acquire(blocking=False):
            raise RuntimeError("the workflow engine exists once per process, and another service has it")
        self._started = True
        self._patiently(lambda: self._claims.release(self._executor))
        DBOS(
            config={
                "name": "hilfit",
                "system_database_url": self._database.url,
                "serializer": DBOSPortableJSONSerializer(),
                "executor_id": self._executor,
                "application_version": WORKFLOW_VERSION,
                "log_level": "WARNING",
                "enable_otlp": False,
                "sys_db_pool_size": 5,
            }
        )
        for name in self._kinds:
            self._workflows[name] = self._workflow(name)
        self.errands.register(self._errand)
        DBOS.listen_queues([*self._queues, *self.errands.queues])
        DBOS.launch()
        for queue, count in {**QUEUES, **self.errands.queues}.items():
            self._patiently(partial(_register, queue, count))
        if self._executor == EXECUTOR:  # whoever stores jobs also sees to it that they are queued
            for job in self._patiently(self._jobs.unfinished):
                self._patiently(partial(self._take_up, job))

    def _workflow(self, name: str) -> Any:
        def workflow(job: str, stages: list[str]) -> str:
            return self._run(job, stages)

        # A stage cannot take the server down (it is a process of its own), so a job that was resumed
        # often is a victim, not a cause: no limit on attempts.
        return DBOS.workflow(name=name, max_recovery_attempts=None)(workflow)

    def _errand(self, run: Callable[[], Value]) -> Value:
        with self._counted():
            if self._stopping.is_set():
                raise ServiceStopping
            return self._patiently(run)

    def reconcile(self) -> None:
        """Queue jobs that were stored and not queued; end those that the engine gave up. Called now and then."""
        with suppress(StorageAwayError):  # workers wait until it is this store's
            self._files.storage.claim(self._jobs.store())
        for job in self._jobs.unfinished():
            self._take_up(job)

    def _take_up(self, job: Job) -> None:
        """Bring a job that is not over in our store together with its workflow, which a crash may have kept from it."""
        workflow = DBOS.get_workflow_status(job.id)
        if workflow is None:
            self.enqueue(job.id)
        elif workflow.status not in ("ENQUEUED", "PENDING"):
            _log.error("job_lost", job=job.id, workflow=workflow.status)
            self._kinds[job.kind].ended(job, "failed", _LOST)
            self._jobs.finish(job.id, "failed", "Failed", error=_LOST)

    def halt(self) -> None:
        """Let no stage begin and running ones end, unrecorded; returns at once."""
        self._stopping.set()

    def stop(self) -> None:
        """Stop the engine; a running stage is ended and will run again at the next start."""
        self.halt()
        # Whoever is at work is ending its child now; the engine and the store have to be there until then.
        with self._idle:
            self._idle.wait_for(lambda: self._at_work == 0, timeout=2 * GRACE_S + LOOK_S)
        self._warm.close()
        if self._started:
            self._started = False
            self.errands.forget()
            DBOS.destroy(destroy_registry=True)
            _ENGINE.release()

    def enqueue(self, job: str) -> None:
        """Queue the workflow of a stored job; does nothing if it is queued, running or over."""
        row = self._jobs.get(job)
        try:
            self._share(row)
        except StorageAwayError as error:  # :meth:`reconcile` queues it
            _log.warning("job_not_queued", job=job, error=str(error))
            return
        # In a context of its own: the engine refuses to start a workflow inside a step, which a recalibration does.
        contextvars.Context().run(self._enqueue, row)

    def _share(self, row: Job) -> None:
        """Let workers find what a job reads."""
        storage, key = self._files.storage, self._files.key
        paths = self._kinds[row.kind].inputs(row) if storage.shared else ()
        if paths:
            storage.claim(self._jobs.store())
            sums = {path: digest(path) for path in paths}
            for path, sha256 in sums.items():
                storage.put(path, input_key(sha256))
            self._jobs.note_inputs(row.id, {key(path): sha256 for path, sha256 in sums.items()})

    def _enqueue(self, job: Job) -> None:
        with SetWorkflowID(job.id):
            DBOS.enqueue_workflow(self._kinds[job.kind].queue, self._workflows[job.kind], job.id, list(job.stages))

    def cancel(self, job: str) -> Job:
        """Ask a job to stop. A running stage is ended within a second; a waiting job never starts."""
        return self._jobs.request_cancel(job)

    def take_over(self, silent: Callable[[str], bool]) -> tuple[str, ...]:
        """Let others go on with the jobs of executors that are ``silent``; the jobs' ids.

        The engine recovers only what its own executor left behind. One that is silent but lives loses its claims, so
        it stores nothing more about those jobs.
        """
        self._claims.revoke(silent)
        taken = []
        for workflow in DBOS.list_workflows(status="PENDING", load_input=False, load_output=False):
            if workflow.executor_id is None or not silent(workflow.executor_id) or workflow.name not in self._kinds:
                continue
            DBOS.resume_workflow(workflow.workflow_id, queue_name=self._kinds[workflow.name].queue)
            _log.warning("job_taken_over", job=workflow.workflow_id, executor=workflow.executor_id)
            taken.append(workflow.workflow_id)
        return tuple(taken)

    def _run(self, job: str, stages: list[str]) -> str:
        """The workflow. Its steps depend on nothing but its arguments and the results of earlier steps.

        The claim is no step: every execution takes one of its own.
        """
        self._within_reach(job)
        claim = self._claim(job)
        result: dict[str, Any] = {"outcome": "done"}
        try:
            with self._process(job) as process:
                for index, stage in enumerate(stages):
                    part, before = (index, len(stages)), (result.get("place"), result.get("files", {}))
                    result = DBOS.run_step({"name": stage}, self._run_stage, claim, stage, part, before, process)
                    if result["outcome"] != "done":
                        break
            state = str(DBOS.run_step({"name": "finish"}, self._finish, claim, result))
        except (Exception, TakenOver):  # somebody else has it: the engine knows it, or the store
            self._leave(claim)
            raise
        self._leave(claim)
        return state

    @contextmanager
    def _process(self, job: str) -> Iterator[Child]:
        """For the stages of a job; that of numerical ones stays for a while, for the next job."""
        row = self._patiently(lambda: self._jobs.get(job))
        if self._kinds[row.kind].queue != NUMERICAL:
            with Child() as process:
                yield process
            return
        try:
            yield self._warm.child
        finally:
            self._warm.cool()

    def _leave(self, claim: Claim) -> None:
        """Let go of a job; if it is over, remove the files that do not count, whoever wrote them."""
        with suppress(ServiceStopping):  # the claim is released at the next start, or revoked if there is none
            self._patiently(lambda: self._claims.give_back(claim))
            row = self._patiently(lambda: self._jobs.get(claim.job))
            if row.place is not None:
                keep = row.place if self._executor == EXECUTOR or not self._files.storage.shared else None
                kept = self._patiently(lambda: self._jobs.files(row.id, "result"))
                tidy(self._files, self._kinds[row.kind].directory(row), keep, set(kept.values()))

    def _within_reach(self, job: str) -> None:
        """Leave a job to others while its files cannot be reached from here.

        Raises
        ------
        TakenOver
            If it waits for whoever can.
        """
        row = self._patiently(lambda: self._jobs.get(job))
        if not self._kinds[row.kind].inputs(row):
            return
        why = self.away = self._patiently(self.out_of_reach)
        if why is None:
            return
        _log.warning("job_left_to_others", job=job, reason=why)
        self._pause(AWAY_S)  # in which the others have their turn, and nothing more is taken here
        self._requeue(row)
        raise TakenOver(f"{job}: {why}")

    def out_of_reach(self) -> str | None:
        """Why no job can be done here now; None if the storage is there, and that of this store."""
        return self._files.storage.check(self._jobs.store())

    def _requeue(self, row: Job) -> None:
        """Let any executor go on with a job, from the last stage that was recorded."""
        resume = partial(DBOS.resume_workflow, row.id, queue_name=self._kinds[row.kind].queue)
        self._patiently(lambda: contextvars.Context().run(resume))

    def _stored(self, row: Job, claim: Claim, do: Callable[[], Value]) -> Value:
        """The value of ``do``, done again while the storage is away; another host's turn when that lasts.

        Raises
        ------
        TakenOver
            After :data:`PATIENCE_S`.
        """
        end = time.monotonic() + PATIENCE_S
        while True:
            try:
                value, self.away = do(), None
                return value
            except StorageAwayError as error:
                self.away = str(error)
                _log.warning("storage_away", job=row.id, error=str(error))
                if time.monotonic() > end:
                    self._patiently(lambda: self._claims.give_back(claim))
                    self._requeue(row)
                    raise TakenOver(f"{row.id}: {error}") from None
                self._pause(AWAY_S)

    def _claim(self, job: str) -> Claim:
        """Take a job's claim; waits while somebody else, who woke up late, still holds it."""
        while True:
            claim = self._patiently(lambda: self._claims.take(job, self._executor))
            if claim is not None:
                return claim
            self._pause(POLL_S)

    def _pause(self, seconds: float) -> None:
        if self._stopping.wait(seconds):
            raise ServiceStopping

    def _patiently(self, do: Callable[[], Value]) -> Value:
        return patiently(do, self._pause)

    @contextmanager
    def _working(self, kind: JobKind) -> Iterator[None]:
        with self._counted(), self._one_at_a_time if kind.queue == NUMERICAL else nullcontext():
            yield  # a resumed job may come beside the queue

    @contextmanager
    def _counted(self) -> Iterator[None]:
        """Work that is waited for before the engine stops."""
        with self._idle:
            self._at_work += 1
        try:
            yield
        finally:
            with self._idle:
                self._at_work -= 1
                self._idle.notify_all()

    def _run_stage(
        self, claim: Claim, stage: str, part: tuple[int, int], before: Before, process: Child
    ) -> dict[str, Any]:
        """Step: one stage, after another.

        Parameters
        ----------
        part : which of how many
        before : the place in which that left its files, and their SHA-256
        process : of the stage before, if it stayed
        """
        row = self._patiently(lambda: self._jobs.get(claim.job))
        kind = self._kinds[row.kind]
        directory, name = kind.directory(row), place_name(claim, stage)
        with self._working(kind):
            if self._stopping.is_set():
                raise ServiceStopping
            said = kind.words(stage)
            if not self._patiently(lambda: self._jobs.progress(row.id, stage, part[0] / part[1], said, claim)):
                return {"outcome": "stopped", "stage": stage, "error": None, "place": before[0], "files": before[1]}
            for attempt in range(1, ATTEMPTS + 1):
                result = self._kept(row, claim, kind, stage, part, directory / name, before, process)
                if result.outcome != "failed" or attempt == ATTEMPTS or not self._lacked_room(result):
                    break
                _log.warning("stage_without_room", job=row.id, stage=stage, error=result.error)
                if not self._wait_for_room(row, claim, stage, part):
                    return {"outcome": "stopped", "stage": stage, "error": None, "place": before[0], "files": before[1]}
                shutil.rmtree(directory / name, ignore_errors=True)
            keep = partial(self._files.storage.keep, directory / name, self._files.key(directory))
            files = self._stored(row, claim, keep)
        _log.info("stage_ended", job=row.id, stage=stage, outcome=result.outcome, error=result.error)
        return self._outcome(stage, result) | {"place": name, "files": files}

    def _kept(
        self,
        row: Job,
        claim: Claim,
        kind: JobKind,
        stage: str,
        part: tuple[int, int],
        place: Path,
        before: Before,
        process: Child,
    ) -> ChildResult:
        """Do a stage in its ``place``, and see to it that its files survive a power cut."""
        try:
            whole = self._stored(row, claim, lambda: begin(self._files, place.parent, place.name, *before))
            result = self._work(row, claim, kind, stage, part, place, whole, process)
            sync_tree(place)  # before it is recorded
        except OSError as error:
            reason = f"its files cannot be kept ({error.strerror or error}); free some space and order it again"
            result = ChildResult("failed", error=reason)
        if self._stopping.is_set() and result.outcome != "done":
            raise ServiceStopping
        return result

    def _free(self) -> int:
        return shutil.disk_usage(self._files.root).free

    def _lacked_room(self, result: ChildResult) -> bool:
        return self._free() < NO_ROOM_BYTES or any(words in (result.error or "") for words in NO_ROOM_WORDS)

    def _wait_for_room(self, job: Job, claim: Claim, stage: str, part: tuple[int, int]) -> bool:
        """Wait until somebody made room; False if the job was cancelled meanwhile."""
        told = False
        while self._free() <= RESERVE_BYTES:
            self._pause(PAUSE_S)
            try:
                if not told and not self._jobs.progress(job.id, stage, part[0] / part[1], NO_ROOM, claim):
                    return False
                told = True
                if self._jobs.cancelling(job.id, claim):
                    return False
            except DBAPIError as error:
                if not away(error):
                    raise
        return True

    def _work(
        self,
        job: Job,
        claim: Claim,
        kind: JobKind,
        stage: str,
        part: tuple[int, int],
        place: Path,
        whole: bool,
        process: Child,
    ) -> ChildResult:
        work = StageWork(
            self._jobs,
            claim,
            stage,
            part,
            kind.words(stage),
            self._free,
            self._stopping.is_set,
            process,
            self._stage_timeout_s,
        )
        _log.info("stage_started", job=job.id, stage=stage)
        key = self._files.key
        try:
            sums = self._patiently(lambda: self._jobs.files(job.id, "input"))
            wanted = {key(path): sums.get(key(path), "") for path in self._patiently(lambda: kind.inputs(job))}
            inputs = self._stored(job, claim, lambda: self._files.storage.local(wanted))
            run = StageRun(job, stage, work.progress, work.should_stop, work.child, place, whole, inputs, key)
            return self._patiently(lambda: kind.run(run))
        except HilfitError as error:
            return ChildResult("input", error=str(error))
        except Exception as error:  # whatever it is, the job has to end
            _log.error("stage_broke", job=job.id, stage=stage, exc_info=error)
            return ChildResult("failed", error="broke unexpectedly; the log of the service says why")

    def _outcome(self, stage: str, result: ChildResult) -> dict[str, Any]:
        """What the engine records of a stage; an error of the input stands for itself, any other names the stage."""
        error = result.error
        if error is not None:
            # Where the service keeps its files is nobody's business.
            error = self._files.without_place(error)
            error = f"stage {stage}: {error}" if result.outcome == "failed" else error
        return {"outcome": result.outcome, "stage": stage, "error": error, "summary": result.summary}

    def _finish(self, claim: Claim, result: dict[str, Any]) -> str:
        """Step: store the outcome, once; running it twice changes nothing."""
        return self._patiently(lambda: self._store(claim, result))

    def _store(self, claim: Claim, result: dict[str, Any]) -> str:
        row = self._jobs.get(claim.job)
        if row.state in FINAL:  # killed after it was stored, before the engine knew
            return row.state
        kind, place = self._kinds[row.kind], result.get("place")
        error: str | None = None
        found: Result | None = None
        state: State
        if result["outcome"] == "done":
            state, text = "done", "Done"
            try:
                found = kind.result(row, kind.directory(row) / (place or ""))
            except JobError as failure:
                state, text, error = "failed", "Failed", str(failure)
        elif result["outcome"] == "stopped":
            state, text = "cancelled", "Cancelled"
        else:
            state, text, error = "failed", f"{kind.words(result['stage'])}: failed", result["error"]
        kind.ended(row, state, error)  # first: whoever sees the end of the job sees what follows from it
        self._jobs.finish(row.id, state, text, error, claim=claim, result=found, place=place, files=result.get("files"))
        return state
