"""Common parameters of all routes: the service behind them, pages, error responses in the OpenAPI description."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any, TypedDict

from fastapi import Depends, Header, Query, Request, Response

from server.platform.authorization.guard import PrincipalDep
from server.platform.authorization.named_things import Names
from server.platform.database.engine import as_stored
from server.platform.database.repository import Between
from server.platform.errors import InvalidError
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


def _known_tags(
    if_match: Annotated[
        str | None, Header(max_length=400, description="`ETag` of the thing as it was read, or several")
    ] = None,
    if_none_match: Annotated[
        str | None, Header(max_length=400, description="`*`: only if there is no such thing yet")
    ] = None,
) -> Tags:
    if if_none_match is not None and if_none_match.strip() == "*":
        return frozenset({NONE_YET})
    if if_match is None or if_match.strip() == "*":
        return None
    # Compared strongly: a weak tag fits nothing.
    return frozenset(tag.strip().strip('"') for tag in if_match.split(","))


Moment = Annotated[datetime | None, Query(description="ISO 8601 with a time zone, as `created` has it")]


async def _between(
    since: Moment = None,
    until: Moment = None,
    label: Annotated[str, Query(max_length=200, description="A part of the label, in whatever case")] = "",
) -> Between:
    for moment in (since, until):
        try:
            if moment is not None and (moment.tzinfo is None or not as_stored(moment)):
                raise InvalidError("server.no_time_zone", moment=moment.isoformat())
        except OverflowError:
            raise InvalidError("server.since_until_moments_utc") from None
    return Between(since, until, label)


class Page(TypedDict):
    """Part of a list that somebody asks for, and of which machines it may be: the first arguments of a list."""

    limit: int
    after: int
    machines: tuple[str, ...] | None
    between: Between


async def _page(
    principal: PrincipalDep,
    between: Annotated[Between, Depends(_between)],
    limit: Limit = 50,
    cursor: Cursor = 0,
) -> Page:
    return Page(limit=limit, after=cursor, machines=principal.machines, between=between)


PageDep = Annotated[Page, Depends(_page)]
#: Tags of a thing's states that whoever changes it knows (RFC 9110 section 13.1); None: whatever there is.
Tags = frozenset[str] | None
#: The tag of what is not there.
NONE_YET = "0"
KnownTags = Annotated[Tags, Depends(_known_tags)]


def problems(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """Return a route's error responses, for its ``responses``; the application adds the schema."""
    content = {MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}}}
    return {status: {"description": status_phrase(status), "content": content} for status in statuses}


#: Content that is a text, and content that is a file's bytes.
TEXT: dict[str, Any] = {"schema": {"type": "string"}}
BYTES: dict[str, Any] = {"schema": {"type": "string", "format": "binary"}}


class Sending(TypedDict):
    """Arguments of a route that answers with content of its own, not with a body."""

    response_class: type[Response]
    responses: dict[int | str, dict[str, Any]]


def sends(content: dict[str, Any], *statuses: int) -> Sending:
    """Describe the answer of a route by its content, by media type, and its error responses."""
    return {"response_class": Response, "responses": {200: {"content": content}, **problems(*statuses)}}


def takes(content: dict[str, Any], description: str) -> dict[str, Any]:
    """Describe the request of a route that is sent a file by its content, by media type; for its ``openapi_extra``."""
    return {"requestBody": {"required": True, "description": description, "content": content}}
