"""Errors of the service.

::

    HilfitError                     (daq.errors) anything raised on purpose
    └── ServiceError                a refusal for a client of the service, with its HTTP status
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
from typing import Any, ClassVar, Self

from daq.errors import HilfitError, InputError
from daq.messages import Sentence, is_code


class ServiceError(HilfitError):
    """A request that the service refuses; the text may be shown to whoever asked.

    Attributes
    ----------
    code : what a program knows it by; unless :meth:`about` says another one, that of its kind
    values : what it is about, by name
    """

    status: ClassVar[int] = 500
    slug: ClassVar[str] = "internal"
    title: ClassVar[str] = "Internal error"
    headers: ClassVar[Mapping[str, str]] = MappingProxyType({})

    def __init_subclass__(cls, **declared: Any) -> None:
        """Take what a kind declares of itself, in the place of what the kind above it does."""
        for name, value in declared.items():
            setattr(cls, name, value)

    def __init__(self, text: str = "", /, **values: Any) -> None:
        super().__init__(text, **values)
        self.code = self.slug.replace("-", "_")
        self.values: dict[str, str | int] = {}

    def about(self, code: str | None = None, **values: str | int) -> Self:
        """Return it with another ``code``, if one is given, and with what it is about."""
        self.code, self.values = code or self.code, values
        return self


# RFC 9110 section 11.6.1
class UnauthenticatedError(
    ServiceError,
    status=401,
    slug="unauthenticated",
    title="Unauthenticated",
    headers={"WWW-Authenticate": 'Bearer realm="hilfit"'},
):
    """The request comes from nobody that is known."""


class ForbiddenError(ServiceError, status=403, slug="forbidden", title="Forbidden"):
    """Whoever asks may not do this."""


class NotFoundError(ServiceError, status=404, slug="not-found", title="Not found"):
    """There is no such resource."""


class ConflictError(ServiceError, status=409, slug="conflict", title="Conflict"):
    """The state of the resource forbids what was asked."""


class PreconditionError(ServiceError, status=412, slug="precondition-failed", title="Changed meanwhile"):
    """The resource was changed since the client read it (``If-Match``)."""


class InvalidError(ServiceError, status=422, slug="invalid", title="Invalid content"):
    """The content of the request cannot be used."""


class TooLargeError(ServiceError, status=413, slug="too-large", title="Too large"):
    """The request has more bytes than the service takes."""


class UnsupportedFormatError(ServiceError, status=415, slug="unsupported-format", title="Unsupported format"):
    """The service does not read this kind of file."""


class TooManyError(ServiceError, status=429, slug="too-many", title="Too many", headers={"Retry-After": "5"}):
    """Too many requests, or too many of something at once."""


class UnavailableError(ServiceError, status=503, slug="unavailable", title="Unavailable", headers={"Retry-After": "5"}):
    """A part of the service is not there at the moment."""


class BusyError(UnavailableError, slug="busy", title="Busy"):
    """There is more heavy work than the service takes at once."""


class StartError(InputError):
    """The service cannot start with these options; the command line ends with exit code 2."""


class TakenOver(BaseException):
    """Raised in a process whose job another one has taken over; like ServiceStopping, it records no outcome."""


class ServiceStopping(BaseException):
    """Raised inside a job's step when the service stops.

    It is no ``Exception`` on purpose: the workflow engine records exceptions as the outcome of a step. This
    one passes through unrecorded, so the step is still pending at the next start and runs again.
    """


def none_of(noun: str, id: str) -> Sentence:
    """Word that there is no such thing, of those that ``noun`` names; each has an article of its own in German."""
    code = f"server.none_{noun.replace(' ', '_')}"
    return Sentence(code, id=id) if is_code(code) else Sentence("server.no_such", kind=noun, id=id)
