"""What all routes share: the service behind them, pages, error responses in the OpenAPI description."""

from __future__ import annotations

from http import HTTPStatus
from typing import Annotated, Any

from fastapi import Depends, Query, Request

from server.problems import MEDIA_TYPE
from server.service import Service


def _service(request: Request) -> Service:
    service = request.app.state.service
    assert isinstance(service, Service)
    return service


ServiceDep = Annotated[Service, Depends(_service)]
Limit = Annotated[int, Query(ge=1, le=500, description="Most items of a page")]
Cursor = Annotated[int, Query(ge=0, le=2**53, description="`next` of the page before; 0 starts at the newest")]


def problems(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """The error responses of a route, for its ``responses``; the schema is added by the application."""
    content = {MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}}}
    return {status: {"description": HTTPStatus(status).phrase, "content": content} for status in statuses}
