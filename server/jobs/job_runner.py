"""Jobs as durable workflows (DBOS): each stage is a step that is recorded once it is done.

After a crash, at whatever moment, the next start goes on with the first stage that has no recorded result.
What a person sees of a job is in our own store (:class:`server.jobs.job_store.Jobs`); the engine's tables are its
private business. Inputs and results are kept as JSON, never as pickles.
"""

from __future__ import annotations

import contextvars
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from typing import Any

import structlog
from dbos import DBOS, DBOSPortableJSONSerializer, SetWorkflowID

from daq.messages import named
from daq.whole_files import digest_of
from server.jobs.claims import Claim
from server.jobs.execution import AWAY_S, Execution
from server.jobs.job_host import JobHost
from server.jobs.job_kinds import AT_MACHINES, NUMERICAL, JobKind
from server.jobs.job_store import Job
from server.platform.database.engine import Database
from server.platform.database.patience import Value
from server.platform.errors import ServiceStopping, TakenOver
from server.platform.files import DataDirectory
from server.platform.processes.children import GRACE_S, LOOK_S
from server.platform.processes.errands import Errands
from server.platform.storage import StorageAwayError, input_key

#: Jobs of a queue that one process runs at a time. Numerical work may take all cores but those of acquisition and
#: HTTP; what is done at machines is mostly waiting, and one machine has one at a time.
QUEUES: Mapping[str, int] = {NUMERICAL: 1, AT_MACHINES: 200}
#: Changed when the order or meaning of a workflow's steps changes: only workflows of the same version are
#: resumed.
WORKFLOW_VERSION = "hilfit-jobs-1"
#: The engine resumes what its own executor left behind, so the name has to be the same after a restart. The
#: lock of the data directory sees to it that two servers never share it.
EXECUTOR = "server"
#: s between two looks at a queue, each of which is some transactions: of numerical work, which workers should not wait
#: for, and of any other.
POLL_S, LEISURELY_S = 0.25, 1.0
#: Held by the runner that has started the engine, which keeps its state in its module.
_ENGINE = threading.Lock()
_LOST = "the job broke off unexpectedly; order it again"
_log = structlog.stdlib.get_logger(__name__)


def _register(queue: str, count: int) -> None:
    pause = POLL_S if queue == NUMERICAL else LEISURELY_S
    DBOS.register_queue(queue, worker_concurrency=count, polling_interval_sec=pause, on_conflict="always_update")


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
    host : what its executions share
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
        leads = executor == EXECUTOR
        self.host = JobHost(database, files, executor, leads=leads, stage_timeout_s=stage_timeout_s)
        self._kinds = {kind.name: kind for kind in kinds}
        self._queues = tuple(queues)
        self._workflows: dict[str, Any] = {}
        self._started = False
        self.errands = Errands()

    def start(self) -> None:
        """Start the engine: unfinished jobs go on, waiting ones are taken from the queues."""
        if not _ENGINE.acquire(blocking=False):
            raise RuntimeError("the workflow engine exists once per process, and another service has it")
        self._started = True
        self.host.patiently(lambda: self.host.claims.release(self.host.name))
        DBOS(
            config={
                "name": "hilfit",
                "system_database_url": self._database.url,
                "serializer": DBOSPortableJSONSerializer(),
                "executor_id": self.host.name,
                "application_version": WORKFLOW_VERSION,
                "log_level": "WARNING",
                "enable_otlp": False,
                "sys_db_pool_size": 5,
                # Nobody waits for one, but :meth:`stop` does for a look; unsaid, each second, a hundred times a second.
                "notification_listener_polling_interval_sec": LOOK_S,
                "notification_coalesce_sec": LOOK_S,
            }
        )
        for name in self._kinds:
            self._workflows[name] = self._workflow(name)
        self.errands.register(self._errand)
        DBOS.listen_queues([*self._queues, *self.errands.queues])
        DBOS.launch()
        for queue, count in {**QUEUES, **self.errands.queues}.items():
            self.host.patiently(partial(_register, queue, count))
        if self.host.leads:  # whoever stores jobs also sees to it that they are queued
            for job in self.host.patiently(self.host.jobs.unfinished):
                self.host.patiently(partial(self._take_up, job))

    def _workflow(self, name: str) -> Any:
        def workflow(job: str, stages: list[str]) -> str:
            return self._run(job, stages)

        # A stage cannot take the server down (it is a process of its own), so a job that was resumed
        # often is a victim, not a cause: no limit on attempts.
        return DBOS.workflow(name=name, max_recovery_attempts=None)(workflow)

    def _errand(self, run: Callable[[], Value]) -> Value:
        with self.host.counted():
            if self.host.stopping.is_set():
                raise ServiceStopping
            return self.host.patiently(run)

    def reconcile(self) -> None:
        """Queue jobs that were stored and not queued; end those that the engine gave up. Called now and then."""
        with suppress(StorageAwayError):  # workers wait until it is this store's
            self.host.files.storage.claim(self.host.jobs.store())
        for job in self.host.jobs.unfinished():
            self._take_up(job)

    def _take_up(self, job: Job) -> None:
        """Bring a job that is not over in our store together with its workflow, which a crash may have kept from it."""
        workflow = DBOS.get_workflow_status(job.id)
        if workflow is None:
            self.enqueue(job.id)
        elif workflow.status not in ("ENQUEUED", "PENDING"):
            _log.error("job_lost", job=job.id, workflow=workflow.status)
            self._kinds[job.kind].ended(job, "failed", _LOST)
            self.host.jobs.finish(job.id, "failed", "Failed", error=_LOST)

    def halt(self) -> None:
        """Let no stage begin and running ones end, unrecorded; returns at once."""
        self.host.stopping.set()

    def stop(self) -> None:
        """Stop the engine; a running stage is ended and will run again at the next start."""
        self.halt()
        # Whoever is at work is ending its child now; the engine and the store have to be there until then.
        self.host.close(2 * GRACE_S + LOOK_S)
        if self._started:
            self._started = False
            self.errands.forget()
            DBOS.destroy(destroy_registry=True)
            _ENGINE.release()

    def enqueue(self, job: str) -> None:
        """Queue the workflow of a stored job; does nothing if it is queued, running or over."""
        row = self.host.jobs.get(job)
        try:
            self._share(row)
        except StorageAwayError as error:  # :meth:`reconcile` queues it
            _log.warning("job_not_queued", job=job, error=str(error))
            return
        # In a context of its own: the engine refuses to start a workflow inside a step, which a recalibration does.
        contextvars.Context().run(self._enqueue, row)

    def _share(self, row: Job) -> None:
        """Let workers find what a job reads."""
        storage, key = self.host.files.storage, self.host.files.key
        paths = self._kinds[row.kind].inputs(row) if storage.shared else ()
        if paths:
            storage.claim(self.host.jobs.store())
            sums = {path: digest_of(path) for path in paths}
            for path, sha256 in sums.items():
                storage.put(path, input_key(sha256))
            self.host.jobs.note_inputs(row.id, {key(path): sha256 for path, sha256 in sums.items()})

    def _enqueue(self, job: Job) -> None:
        with SetWorkflowID(job.id):
            DBOS.enqueue_workflow(self._kinds[job.kind].queue, self._workflows[job.kind], job.id, list(job.stages))

    def take_over(self, silent: Callable[[str], bool]) -> tuple[str, ...]:
        """Let others go on with the jobs of executors that are ``silent``; the jobs' ids.

        The engine recovers only what its own executor left behind. One that is silent but lives loses its claims, so
        it stores nothing more about those jobs.
        """
        self.host.claims.revoke(silent)
        taken = []
        for workflow in DBOS.list_workflows(status="PENDING", load_input=False, load_output=False):
            if workflow.executor_id is None or not silent(workflow.executor_id) or workflow.name not in self._kinds:
                continue
            DBOS.resume_workflow(workflow.workflow_id, queue_name=self._kinds[workflow.name].queue)
            _log.warning("job_taken_over", job=workflow.workflow_id, executor=workflow.executor_id)
            taken.append(workflow.workflow_id)
        return tuple(taken)

    def _run(self, job: str, stages: list[str]) -> str:
        """Run the workflow. Its steps depend on nothing but its arguments and the results of earlier steps.

        The claim is no step: every execution takes one of its own.
        """
        with self.host.counted():  # the store has to be there until the job is left
            return self._execute(job, stages)

    def _execute(self, job: str, stages: list[str]) -> str:
        host = self.host
        row = host.patiently(lambda: host.jobs.get(job))
        kind = self._kinds[row.kind]
        self._within_reach(row)
        claim, result = self._claim(job), dict[str, Any](outcome="done")
        with host.process(kind) as process:
            execution = Execution(host, kind, row, claim, process, self._requeue)
            try:
                for index, stage in enumerate(stages):
                    part = index, len(stages)
                    result = DBOS.run_step({"name": stage}, execution.run_stage, stage, part)
                    if result["outcome"] != "done":
                        break
                    execution.begin_after(result)
                return str(DBOS.run_step({"name": "finish"}, execution.finish, result))
            finally:  # whatever it was, TakenOver too: somebody else has it, or it is over
                execution.leave()

    def _within_reach(self, row: Job) -> None:
        """Leave a job to others while its files cannot be reached from here.

        Raises
        ------
        TakenOver
            If it waits for whoever can.
        """
        if not self._kinds[row.kind].inputs(row):
            return
        why = self.host.away = self.host.patiently(self.host.out_of_reach)
        if why is None:
            return
        _log.warning("job_left_to_others", job=row.id, reason=why)
        self.host.pause(AWAY_S)  # in which the others have their turn, and nothing more is taken here
        self._requeue(row)
        raise TakenOver(named(row.id, why))

    def _requeue(self, row: Job) -> None:
        """Let any executor go on with a job, from the last stage that was recorded."""
        resume = partial(DBOS.resume_workflow, row.id, queue_name=self._kinds[row.kind].queue)
        self.host.patiently(lambda: contextvars.Context().run(resume))

    def _claim(self, job: str) -> Claim:
        """Take a job's claim; waits while somebody else, who woke up late, still holds it."""
        host = self.host
        while True:
            claim = host.patiently(lambda: host.claims.take(job, host.name))
            if claim is not None:
                return claim
            host.pause(POLL_S)
