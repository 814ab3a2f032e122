"""What the routes of jobs give."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

from pydantic import BaseModel

from server.jobs.job_store import Job
from server.platform.database.engine import Page


class JobResource(BaseModel):
    """A job as it is now; ``fraction`` is 0 to 1 over all stages.

    ``expected_end``: when it will probably end, from how long earlier jobs of its kind took, else from its own
    progress; null while it waits, once it is over, and where nothing tells.
    """

    id: str
    kind: str
    label: str
    subject: str
    stages: list[str]
    state: Literal["queued", "running", "done", "failed", "cancelled"]
    stage: str | None
    fraction: float
    text: str
    error: str | None
    cancel_requested: bool
    created: str
    started: str | None
    ended: str | None
    expected_end: str | None = None

    @classmethod
    def of(cls, job: Job, expected_end: str | None = None) -> JobResource:
        """From the store."""
        values = {key: value for key, value in job.__dict__.items() if key != "place"}
        return cls(**{**values, "stages": list(job.stages), "expected_end": expected_end})


class JobList(BaseModel):
    """A page of jobs."""

    items: list[JobResource]
    next: int | None

    @classmethod
    def of(cls, page: Page[Job], expected_end: Callable[[Job], str | None]) -> JobList:
        """From the store; ``expected_end`` is asked of each job."""
        return cls(items=[JobResource.of(job, expected_end(job)) for job in page.items], next=page.next)
