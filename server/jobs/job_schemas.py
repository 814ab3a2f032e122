"""What the routes of jobs give."""

from __future__ import annotations

from typing import Literal

from server.platform.http.bodies import Listed, Shown


class JobResource(Shown):
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


class JobList(Listed[JobResource]):
    """A page of jobs."""
