"""What the routes of jobs give."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel

from server.jobs.job_store import Job
from server.platform.database.engine import Page


class JobResource(BaseModel):
    """A job as it is now; ``fraction`` is 0 to 1 over all stages."""

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

    @classmethod
    def of(cls, job: Job) -> JobResource:
        """From the store."""
        values = {key: value for key, value in job.__dict__.items() if key != "place"}
        return cls(**{**values, "stages": list(job.stages)})


class JobList(BaseModel):
    """A page of jobs."""

    items: list[JobResource]
    next: int | None

    @classmethod
    def of(cls, page: Page[Job]) -> JobList:
        """From the store."""
        return cls(items=[JobResource.of(job) for job in page.items], next=page.next)
