"""Errors as problem documents (RFC 9457, ``application/problem+json``) on every path."""

from __future__ import annotations

import errno
from collections.abc import Awaitable, Callable, Mapping
from http import HTTPStatus
from typing import Any

import structlog
from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import BaseModel
from sqlalchemy.exc import DBAPIError
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect
from starlette.routing import Match

from daq.errors import AcquisitionError, HilfitError, InputError
from daq.messages import Sentence, first_of, message_of, named, one_line
from daq.validation_words import in_words
from server.platform.database.patience import away
from server.platform.errors import InvalidError, ServiceError, UnavailableError
from server.platform.http.base_path import below
from server.platform.http.bodies import Message

#: Names of statuses that Python 3.13 renamed with RFC 9110; types of problems are made of them and stay what they were.
_PHRASES = {
    413: "Request Entity Too Large",
    414: "Request-URI Too Long",
    416: "Requested Range Not Satisfiable",
    422: "Unprocessable Entity",
}
MEDIA_TYPE = "application/problem+json"
_log = structlog.stdlib.get_logger(__name__)


class Problem(BaseModel):
    """A problem document: what went wrong with one request, and what to do.

    ``code`` tells a program what it was, ``values`` what that is about; ``detail`` says both to a person, and
    ``message`` is what it was made of, to word it in another language.
    """

    type: str
    title: str
    status: int
    detail: str
    instance: str
    code: str
    values: dict[str, str | int] = {}
    message: Message | None = None
    errors: list[dict[str, Any]] | None = None


def status_phrase(status: int) -> str:
    """Name a status as in problems and in the OpenAPI description, whichever Python runs."""
    return _PHRASES.get(status) or HTTPStatus(status).phrase


def problem(
    request: Request,
    status: int,
    detail: str,
    *,
    slug: str | None = None,
    title: str | None = None,
    code: str | None = None,
    values: dict[str, str | int] | None = None,
    errors: list[dict[str, Any]] | None = None,
    headers: dict[str, str] | None = None,
) -> JSONResponse:
    """Build the response with ``detail``; ``type`` is ``urn:hilfit:problem:<slug>``, RFC 9457 section 3.1.

    ``code`` is the slug where nothing more is known.
    """
    phrase = title or status_phrase(status)
    slug, made = slug or phrase.lower().replace(" ", "-"), message_of(detail)
    document = Problem(
        type=f"urn:hilfit:problem:{slug}",
        title=phrase,
        status=status,
        detail=one_line(detail),  # one line, whatever the request named
        instance=below(request.scope, request.url.path),
        code=code or slug.replace("-", "_"),
        values=values or {},
        message=None if made is None else Message(**made),
        errors=errors,
    )
    return JSONResponse(
        document.model_dump(exclude_none=True), status_code=status, headers=headers, media_type=MEDIA_TYPE
    )


def _methods_of(request: Request) -> list[str]:
    """List all methods for a request's path, whichever route takes them (RFC 9110 section 10.2.1)."""
    found: set[str] = set()
    for method in ("GET", "HEAD", "POST", "PUT", "PATCH", "DELETE"):
        scope = dict(request.scope, method=method)
        if any(route.matches(scope)[0] is Match.FULL for route in request.app.router.routes):
            found.add(method)
    return sorted(found)


def install(app: FastAPI) -> None:
    """Make ``app`` answer every error with a problem document."""
    for kind, answer in _ANSWERS.items():
        app.add_exception_handler(kind, answer)


def refused(request: Request, error: ServiceError, headers: Mapping[str, str] | None = None) -> JSONResponse:
    """Build the response to a service's error; ``headers`` replace those of its kind."""
    return problem(
        request,
        error.status,
        str(error),
        slug=error.slug,
        title=error.title,
        code=error.code,
        values=error.values,
        headers=dict(headers or error.headers),
    )


def _as_ours(request: Request, error: Exception) -> ServiceError:
    """Convert another error to one of the service."""
    match error:
        case ServiceError():
            return error
        case InputError():
            return InvalidError(str(error))
        case AcquisitionError():
            return UnavailableError(str(error))
        case HTTPException(status_code=400):  # nested without end, or not in UTF-8
            return InvalidError("server.body_no_json_can")
        case UnicodeEncodeError():
            # JSON may hold half of a surrogate pair (RFC 8259 section 8.2), which no encoding of text can write.
            return InvalidError("server.text_request_not_unicode")
        case DBAPIError() if away(error):  # also in a layer around the routes
            _log.error("store_unavailable", path=request.url.path, exc_info=error)
            return UnavailableError("server.store_busy_full_read")
    # The text of an unexpected error may hold paths and values; it belongs in the log only.
    _log.error("request_failed", path=request.url.path, exc_info=error)
    return ServiceError("server.service_failed_request")


async def _refused(request: Request, error: Exception) -> JSONResponse:
    return refused(request, _as_ours(request, error))


async def _other_error(request: Request, error: Exception) -> JSONResponse:
    return problem(request, 500, str(error))


async def _http_error(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, HTTPException)
    if error.status_code == 400:
        return await _refused(request, error)
    headers = dict(error.headers or {})
    if error.status_code == 405:
        headers["Allow"] = ", ".join(_methods_of(request))
    detail = {
        404: Sentence("server.nothing_there", url=request.url.path),
        405: Sentence("server.not_possible_here", scope=request.method),
    }.get(error.status_code, str(error.detail))
    return problem(request, error.status_code, detail, headers=headers)


async def _validation_error(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, RequestValidationError)
    errors = [
        {"place": ".".join(str(part) for part in entry["loc"]), "text": text, "message": message_of(text)}
        | {"code": entry["type"]}
        for entry in error.errors()
        for text in [in_words(entry)]
    ]
    line = first_of([named(own["place"], own["text"]) for own in errors])
    shown = line.encode("utf-8", "backslashreplace").decode()  # it may quote what is not Unicode
    detail = line if shown == line else shown
    return problem(request, 422, detail, slug=InvalidError.slug, title=InvalidError.title, errors=errors)


async def _storage_failed(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, OSError)
    _log.error("storage_failed", path=request.url.path, exc_info=error)
    full = error.errno in (errno.ENOSPC, errno.EDQUOT)
    why = UnavailableError("server.disk_full" if full else "server.data_directory_cannot_used_log")
    return refused(request, why, {"Retry-After": "30"})


async def _cut(request: Request, error: Exception) -> JSONResponse:
    _log.warning("request_cut", path=request.url.path)  # its client has gone, and hears nothing of this
    return problem(request, 400, Sentence("server.request_cut_off"))


_ANSWERS: dict[type[Exception], Callable[[Request, Exception], Awaitable[JSONResponse]]] = {
    ServiceError: _refused,
    InputError: _refused,
    AcquisitionError: _refused,
    HilfitError: _other_error,
    HTTPException: _http_error,
    RequestValidationError: _validation_error,
    DBAPIError: _refused,
    OSError: _storage_failed,
    UnicodeEncodeError: _refused,
    ClientDisconnect: _cut,
    Exception: _refused,
}
