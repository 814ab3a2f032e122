"""Routes whose requests are authorised once they are parsed: what they name, as the route itself will see it.

A body may be spelt in many ways (``Application/JSON``, ``application/x+json``), and whoever looks at it beforehand has
to know all of them. Here nothing is looked at beforehand: the endpoint is called with typed values, and just before
that every value that says it names something (:data:`server.platform.authorization.named_things`) is checked against
what exists for the principal. (What the path names, which has one spelling, is checked by the guard, so that it is 404
whatever the body is.) All routers use :class:`TypedRoute`; :func:`server.composition.app.create_app` refuses a route of
another class.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import wraps
from typing import Any

from fastapi import Request
from fastapi.concurrency import run_in_threadpool
from fastapi.routing import APIRoute

from server.platform.authorization.named_things import Thing, names_in
from server.platform.authorization.principals import Principal
from server.platform.service import Service

_REQUEST = "hilfit_request"


class TypedRoute(APIRoute):
    """A route that answers 404 where a request names what does not exist for whoever asks."""

    def __init__(self, path: str, endpoint: Callable[..., Any], **options: Any) -> None:
        super().__init__(path, endpoint if hasattr(endpoint, "hilfit_typed") else _typed(endpoint), **options)


def _typed(endpoint: Callable[..., Any]) -> Callable[..., Any]:
    """Wrap ``endpoint``: called only if everything that its arguments name exists for the principal."""
    signature = inspect.signature(endpoint, eval_str=True)
    own = next((name for name, value in signature.parameters.items() if value.annotation is Request), None)
    find = names_in(signature)

    def foreign(values: dict[str, Any]) -> tuple[Service, Principal, set[Thing]] | None:
        """Return what to look up in the store before the endpoint may be called; None if nothing is."""
        asked: Request = values.pop(_REQUEST) if own is None else values[own]
        principal = asked.scope.get("hilfit.principal")
        if not isinstance(principal, Principal) or principal.machines is None:
            return None  # nobody known: the route is open to all; or all machines exist for it
        things = find(values)
        return (asked.app.state.service, principal, things) if things else None

    if inspect.iscoroutinefunction(endpoint):

        @wraps(endpoint)
        async def call(**values: Any) -> Any:
            check = foreign(values)
            if check is not None:
                service, principal, things = check
                await run_in_threadpool(service.ownership.refuse_foreign, principal, things)
            return await endpoint(**values)
    else:

        @wraps(endpoint)
        def call(**values: Any) -> Any:
            check = foreign(values)
            if check is not None:
                service, principal, things = check
                service.ownership.refuse_foreign(principal, things)
            return endpoint(**values)

    more = [] if own else [inspect.Parameter(_REQUEST, inspect.Parameter.KEYWORD_ONLY, annotation=Request)]
    parameters = [*signature.parameters.values(), *more]
    call.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    call.hilfit_typed = True  # type: ignore[attr-defined]
    return call
