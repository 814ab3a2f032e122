"""Errors of the service.

::

    HilfitError                     (daq.errors) anything raised on purpose
    └── ServiceError                what a client of the service is told, with its HTTP status
        ├── UnauthenticatedError  401 nobody known asks
        ├── ForbiddenError  403 whoever asks may not do this
        ├── NotFoundError  404 no such resource
        ├── ConflictError  409 the resource is in a state that forbids it
        ├── PreconditionError  412 the resource was changed since the client read it
        ├── InvalidError  422 the content of the request cannot be used
        ├── TooLargeError  413 more bytes than the service takes
        ├── UnsupportedFormatError  415 a kind of file that the service does not read
        ├── TooManyError  429 too many at once
        └── UnavailableError  503 a part of the service is not there at the moment
            └── BusyError  503 all places for heavy work are taken

The text of every one of them is one line that says what to do; it becomes ``detail`` of a problem document.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import ClassVar

from daq.errors import HilfitError, InputError


class ServiceError(HilfitError):
    """A request that the service refuses; the text may be shown to whoever asked."""

    status: ClassVar[int] = 500
    slug: ClassVar[str] = "internal"
    title: ClassVar[str] = "Internal error"
    headers: ClassVar[Mapping[str, str]] = MappingProxyType({})


class UnauthenticatedError(ServiceError):
    """The request comes from nobody that is known."""

    status = 401
    slug = "unauthenticated"
    title = "Unauthenticated"
    headers = MappingProxyType({"WWW-Authenticate": 'Bearer realm="hilfit"'})  # RFC 9110 section 11.6.1


class ForbiddenError(ServiceError):
    """Whoever asks may not do this."""

    status = 403
    slug = "forbidden"
    title = "Forbidden"


class NotFoundError(ServiceError):
    """There is no such resource."""

    status = 404
    slug = "not-found"
    title = "Not found"


class ConflictError(ServiceError):
    """The state of the resource forbids what was asked."""

    status = 409
    slug = "conflict"
    title = "Conflict"


class PreconditionError(ServiceError):
    """The resource was changed since the client read it (``If-Match``)."""

    status = 412
    slug = "precondition-failed"
    title = "Changed meanwhile"


class InvalidError(ServiceError):
    """The content of the request cannot be used."""

    status = 422
    slug = "invalid"
    title = "Invalid content"


class TooLargeError(ServiceError):
    """The request has more bytes than the service takes."""

    status = 413
    slug = "too-large"
    title = "Too large"


class UnsupportedFormatError(ServiceError):
    """The service does not read this kind of file."""

    status = 415
    slug = "unsupported-format"
    title = "Unsupported format"


class TooManyError(ServiceError):
    """Too many requests, or too many of something at once."""

    status = 429
    slug = "too-many"
    title = "Too many"
    headers = MappingProxyType({"Retry-After": "5"})


class UnavailableError(ServiceError):
    """A part of the service is not there at the moment."""

    status = 503
    slug = "unavailable"
    title = "Unavailable"
    headers = MappingProxyType({"Retry-After": "5"})


class BusyError(UnavailableError):
    """There is more heavy work than the service takes at once."""

    slug = "busy"
    title = "Busy"


class StartError(InputError):
    """The service cannot start with these options; the command line ends with exit code 2."""


class TakenOver(BaseException):
    """Raised in a process whose job another one has taken over; like ServiceStopping, it records no outcome."""


class ServiceStopping(BaseException):
    """Raised inside a job's step when the service stops.

    It is no ``Exception`` on purpose: the workflow engine records exceptions as the outcome of a step. This
    one passes through unrecorded, so the step is still pending at the next start and runs again.
    """
