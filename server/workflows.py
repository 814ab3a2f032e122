"""Identifications as durable workflows (DBOS): each stage is a step that is recorded once it is done.

After a crash, at whatever moment, the next start goes on with the first stage that has no recorded result.
What a person sees of a job is in our own store (:class:`server.store.Jobs`); the engine's tables are its
private business. Inputs and results are kept as JSON, never as pickles.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Any

import structlog
from dbos import DBOS, DBOSPortableJSONSerializer, SetWorkflowID

from server.children import GRACE_S, LOOK_S, ChildResult, run_child
from server.errors import ServiceStopping
from server.files import DataDirectory
from server.stages import StageProgram, StageRequest, words
from server.store import Database, Identification, Identifications, Job, Jobs, Recordings

QUEUE = "identifications"
#: Changed when the order or meaning of a workflow's steps changes: only workflows of the same version are
#: resumed.
WORKFLOW_VERSION = "hilfit-jobs-1"
#: The engine resumes what its own executor left behind, so the name has to be the same after a restart. The
#: lock of the data directory sees to it that two servers never share it.
EXECUTOR = "server"
POLL_S = 0.25
#: Held by the runner that has started the engine, which keeps its state in its module.
_ENGINE = threading.Lock()
_log = structlog.stdlib.get_logger(__name__)


class JobRunner:
    """Runs identifications one after another, each stage in a process of its own.

    Parameters
    ----------
    program : gives the stages and the command that runs one; called when the first job needs it
    stage_timeout_s : most seconds that a stage may take
    """

    def __init__(
        self,
        database: Database,
        files: DataDirectory,
        program: Callable[[], StageProgram],
        *,
        stage_timeout_s: float,
    ) -> None:
        self._database = database
        self._files = files
        self._make_program = program
        self._stage_timeout_s = stage_timeout_s
        self._jobs = Jobs(database)
        self._identifications = Identifications(database)
        self._recordings = Recordings(database)
        self._stopping = threading.Event()
        self._at_work = threading.Lock()
        self._workflow: Any = None
        self._started = False

    @property
    def stages(self) -> tuple[str, ...]:
        """Stages of an identification, in order."""
        return self._program.stages

    @cached_property
    def _program(self) -> StageProgram:
        return self._make_program()

    def start(self) -> None:
        """Start the engine: unfinished jobs go on, waiting ones are taken from the queue."""
        if not _ENGINE.acquire(blocking=False):
            raise RuntimeError("the workflow engine exists once per process, and another service has it")
        self._started = True
        DBOS(
            config={
                "name": "hilfit",
                "system_database_url": self._database.url,
                "serializer": DBOSPortableJSONSerializer(),
                "executor_id": EXECUTOR,
                "application_version": WORKFLOW_VERSION,
                "log_level": "WARNING",
                "enable_otlp": False,
                "sys_db_pool_size": 5,
            }
        )

        def identification(job: str, stages: list[str]) -> str:
            return self._identify(job, stages)

        # A stage cannot take the server down (it is a process of its own), so a job that was resumed
        # often is a victim, not a cause: no limit on attempts.
        self._workflow = DBOS.workflow(name="identification", max_recovery_attempts=None)(identification)
        DBOS.launch()
        # One at a time: numerical work may take all cores but those of acquisition and HTTP.
        DBOS.register_queue(QUEUE, worker_concurrency=1, polling_interval_sec=POLL_S, on_conflict="always_update")
        for job in self._jobs.unfinished():
            self._take_up(job.id)

    def _take_up(self, job: str) -> None:
        """Bring a job that is not over in our store together with its workflow, which a crash may have kept from it."""
        workflow = DBOS.get_workflow_status(job)
        if workflow is None:
            self.enqueue(job)
        elif workflow.status not in ("ENQUEUED", "PENDING"):
            _log.error("job_lost", job=job, workflow=workflow.status)
            self._jobs.finish(job, "failed", "Failed", error="the job broke off unexpectedly; order it again")

    def stop(self) -> None:
        """Stop the engine; a running stage is ended and will run again at the next start."""
        self._stopping.set()
        # Whoever holds it is ending its child now; the engine and the store have to be there until then.
        if self._at_work.acquire(timeout=2 * GRACE_S + LOOK_S):
            self._at_work.release()
        if self._started:
            self._started = False
            DBOS.destroy(destroy_registry=True)
            _ENGINE.release()

    def enqueue(self, job: str) -> None:
        """Queue the workflow of a stored job; does nothing if it is queued, running or over."""
        stages = list(self._jobs.get(job).stages)
        with SetWorkflowID(job):
            DBOS.enqueue_workflow(QUEUE, self._workflow, job, stages)

    def cancel(self, job: str) -> Job:
        """Ask a job to stop. A running stage is ended within a second; a waiting job never starts."""
        return self._jobs.request_cancel(job)

    def _identify(self, job: str, stages: list[str]) -> str:
        """The workflow. Its steps depend on nothing but its arguments and the results of earlier steps."""
        result: dict[str, Any] = {"outcome": "done"}
        for index, stage in enumerate(stages):
            result = DBOS.run_step({"name": stage}, self._run_stage, job, stage, index, len(stages))
            if result["outcome"] != "done":
                break
        return str(DBOS.run_step({"name": "finish"}, self._finish, job, result))

    def _run_stage(self, job: str, stage: str, index: int, count: int) -> dict[str, Any]:
        """Step: one stage in a process of its own."""
        with self._at_work:
            return self._work(job, stage, index, count)

    def _work(self, job: str, stage: str, index: int, count: int) -> dict[str, Any]:
        if self._stopping.is_set():
            raise ServiceStopping
        if not self._jobs.progress(job, stage, index / count, words(stage)):
            return {"outcome": "stopped", "stage": stage, "error": None}
        identification = self._identifications.get(self._jobs.get(job).subject)
        output = self._files.identifications / identification.id
        request = self._request(identification, output).write()

        def progress(fraction: float, text: str) -> None:
            within = min(1.0, max(0.0, fraction))
            self._jobs.progress(job, stage, (index + within) / count, text or words(stage))

        _log.info("stage_started", job=job, stage=stage)
        try:
            result = run_child(
                [*self._program.command, str(request), stage],
                log=output / f"{stage}.log",
                timeout_s=self._stage_timeout_s,
                progress=progress,
                should_stop=lambda: self._stopping.is_set() or self._jobs.cancelling(job),
            )
        except OSError as error:
            _log.error("stage_not_started", job=job, stage=stage, exc_info=error)
            result = ChildResult("failed", error=f"cannot run ({error.strerror}); the log of the service says more")
        if self._stopping.is_set() and result.outcome != "done":
            raise ServiceStopping
        _log.info("stage_ended", job=job, stage=stage, outcome=result.outcome, error=result.error)
        return self._outcome(stage, result)

    def _outcome(self, stage: str, result: ChildResult) -> dict[str, Any]:
        """What the engine records of a stage; an error of the input stands for itself, any other names the stage."""
        error = result.error
        if error is not None:
            # Where the service keeps its files is nobody's business.
            error = error.replace(f"{self._files.root}/", "")
            error = f"stage {stage}: {error}" if result.outcome == "failed" else error
        return {"outcome": result.outcome, "stage": stage, "error": error, "summary": result.summary}

    def _request(self, identification: Identification, output: Path) -> StageRequest:
        recordings = tuple(
            (role, self._files.recordings / f"{id}.{self._recordings.get(id).format}")
            for id, role in identification.recordings
        )
        return StageRequest(
            machine=self._files.machine_file(identification.machine, identification.machine_version),
            recordings=recordings,
            options=identification.options,
            output=output,
        )

    def _finish(self, job: str, result: dict[str, Any]) -> str:
        """Step: store the outcome; running it twice changes nothing."""
        if result["outcome"] == "done":
            identification = self._jobs.get(job).subject
            try:
                report = json.loads((self._files.identifications / identification / "report.json").read_bytes())
                self._identifications.set_result(identification, report["loop"]["verdict"], report["overall"])
            except (OSError, ValueError, KeyError, TypeError):
                text = "The last stage left no report that can be read"
                self._jobs.finish(job, "failed", "Failed", error=text)
                return "failed"
            self._jobs.finish(job, "done", "Done")
            return "done"
        if result["outcome"] == "stopped":
            self._jobs.finish(job, "cancelled", "Cancelled")
            return "cancelled"
        self._jobs.finish(job, "failed", f"{words(result['stage'])}: failed", error=result["error"])
        return "failed"
