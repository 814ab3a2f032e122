"""What all routes share: the service behind them, pages, error responses in the OpenAPI description."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import Depends, Header, Query, Request

from server.platform.authorization.named_things import Names
from server.platform.http.problems import MEDIA_TYPE, status_phrase
from server.platform.service import Service


async def _service(request: Request) -> Service:  # a coroutine: a plain function would run in a thread
    service = request.app.state.service
    assert isinstance(service, Service)
    return service


ServiceDep = Annotated[Service, Depends(_service)]
#: Of a request that makes something: sent again with the same key it makes nothing more.
Idempotency = Annotated[str | None, Header(alias="idempotency-key", min_length=1, max_length=200)]
OneMachine = Annotated[str, Names("machines"), Query(max_length=80)]
MachineQuery = Annotated[Annotated[str, Names("machines")] | None, Query(max_length=80)]
Limit = Annotated[int, Query(ge=1, le=500, description="Most items of a page")]
Cursor = Annotated[int, Query(ge=0, le=2**53, description="`next` of the page before; 0 starts at the newest")]


def problems(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """The error responses of a route, for its ``responses``; the schema is added by the application."""
    content = {MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}}}
    return {status: {"description": status_phrase(status), "content": content} for status in statuses}
