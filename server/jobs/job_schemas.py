"""What the routes of jobs give."""

from __future__ import annotations

from server.jobs.job_store import Job
from server.platform.http.bodies import Listed


class JobResource(Job):
    """A job as it is now; ``fraction`` is 0 to 1 over all stages.

    ``expected_end``: when it will probably end, from how long earlier jobs of its kind took, else from its own
    progress; null while it waits, once it is over, and where nothing tells.
    """

    expected_end: str | None = None


class JobList(Listed[JobResource]):
    """A page of jobs."""
