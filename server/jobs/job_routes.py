"""``/jobs``: state, progress by server-sent events, cancel."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator
from functools import partial
from typing import Annotated

from fastapi import APIRouter, Header, Query
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import StreamingResponse

from server.jobs.job_schemas import JobList, JobResource
from server.jobs.job_store import FINAL, Job, Jobs, State
from server.jobs.job_times import JobTimes
from server.platform.authorization.guard import PrincipalDep, require
from server.platform.authorization.typed_route import TypedRoute
from server.platform.http.route_parameters import PageDep, ServiceDep, problems
from server.platform.service import Service

router = APIRouter(prefix="/jobs", tags=["jobs"], route_class=TypedRoute)
#: Seconds after which a comment is sent when nothing happens, so that proxies and clients see a live
#: connection.
KEEP_ALIVE_S = 15.0
#: No job has more events, and every database holds the number.
MOST_EVENTS = 2**53


@router.get("", responses=problems(422), dependencies=[require("read")])
def list_jobs(service: ServiceDep, principal: PrincipalDep, page: PageDep, state: State | None = None) -> JobList:
    """List jobs, newest first; a page may be short where jobs of other machines are left out."""
    # Of which machine a job is only what it makes says.
    found = service[Jobs].list(page["limit"], page["after"], state=state, between=page["between"])
    jobs = JobList.of(found, partial(_resource, service))
    if principal.machines is not None:
        machines = service.ownership.machines_of_jobs(job.id for job in jobs.items)
        jobs.items = [job for job in jobs.items if principal.may_see(machines.get(job.id))]
    return jobs


@router.get("/{id}", responses=problems(404, 422), dependencies=[require("read")])
def get(id: str, service: ServiceDep) -> JobResource:
    """Read a job."""
    return _resource(service, service[Jobs].get(id))


@router.post("/{id}/cancel", status_code=202, responses=problems(404, 422), dependencies=[require("operate")])
def cancel(id: str, service: ServiceDep) -> JobResource:
    """Ask a job to stop; one that has ended is left as it is."""
    return _resource(service, service[Jobs].request_cancel(id))


@router.get(
    "/{id}/events",
    response_class=StreamingResponse,
    responses={200: {"content": {"text/event-stream": {"schema": {"type": "string"}}}}, **problems(404, 422)},
    dependencies=[require("read")],
)
async def events(
    id: str,
    service: ServiceDep,
    after: Annotated[int, Query(ge=0, le=MOST_EVENTS, description="Number of the last event seen")] = 0,
    last_event_id: Annotated[str | None, Header(max_length=20)] = None,
) -> StreamingResponse:
    """Follow a job as server-sent events; the stream ends with the job. Each event's ``id`` is its number."""
    await run_in_threadpool(service[Jobs].get, id)
    if last_event_id is not None and last_event_id.isascii() and last_event_id.isdecimal():
        after = min(int(last_event_id), MOST_EVENTS)
    headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
    return StreamingResponse(_follow(service, id, after), media_type="text/event-stream", headers=headers)


async def _follow(service: Service, id: str, after: int) -> AsyncIterator[bytes]:
    while True:
        seen = service.changes.number
        over = (await run_in_threadpool(service[Jobs].get, id)).state in FINAL
        for event in await run_in_threadpool(service[Jobs].events, id, after):
            yield f"id: {event.number}\nevent: progress\ndata: {json.dumps(event.model_dump())}\n\n".encode()
            after = event.number
            if event.state in FINAL:
                return
        if over or service.changes.closed:  # whoever has seen the last event waits for nothing
            return
        if not await service.changes.wait(seen, KEEP_ALIVE_S):
            yield b": nothing new\n\n"


def _resource(service: Service, job: Job) -> JobResource:
    return JobResource.of(job, expected_end=service[JobTimes].expected_end(job))
