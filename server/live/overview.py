"""The service at a glance."""

from __future__ import annotations

import asyncio
from importlib.metadata import version
from typing import Any

from fastapi.concurrency import run_in_threadpool
from pydantic import BaseModel

from server.jobs.job_store import Jobs
from server.live.revisions import Revisions
from server.machines.acquisition import Acquisition


class Status(BaseModel):
    """The service at a glance; a list need not be read again until its number in ``revisions`` moves."""

    version: str
    started: str
    revisions: dict[str, int]
    jobs: dict[str, int]
    acquisition: dict[str, dict[str, Any]]


class Overview:
    """What ``/status`` says; jobs are counted anew only when one has changed.

    Parameters
    ----------
    started : when the service did
    """

    def __init__(self, revisions: Revisions, jobs: Jobs, acquisition: Acquisition, started: str) -> None:
        self._revisions = revisions
        self._jobs = jobs
        self._acquisition = acquisition
        self._started = started
        self._version = version("hilfit")
        self._counting = asyncio.Lock()
        self._counted: tuple[int, dict[str, int]] = 0, {}

    async def status(self) -> Status:
        """Return the service's present state."""
        revisions = await self._revisions.current()
        number = revisions.get("jobs", 0)  # 0: there never was one
        if self._counted[0] < number:
            async with self._counting:  # one of those who ask counts for all who asked before it began
                if self._counted[0] < number:
                    newest = (await self._revisions.current()).get("jobs", 0)
                    self._counted = newest, await run_in_threadpool(self._jobs.counts)
        acquisition = self._acquisition
        return Status(
            version=self._version,
            started=self._started,
            revisions=dict(revisions),
            jobs=self._counted[1],
            acquisition={name: acquisition.statistics(name) for name in acquisition.names()},
        )
