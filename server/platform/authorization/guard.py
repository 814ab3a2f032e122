"""Declarations of routes: the scope that they need, and the principal of a request.

::

    @router.post("/{id}/stop", dependencies=[require("operate")])
    def stop(id: str, service: ServiceDep, principal: PrincipalDep) -> ...

Whatever a request names (a machine, or something of a machine) does not exist (404) for a principal that is bound to
other machines: :class:`TypedRoute` sees to that. Routes that list narrow their lists by
``principal.machines``.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import wraps
from typing import Annotated, Any

from fastapi import Depends, Request, WebSocketException
from fastapi.concurrency import run_in_threadpool
from fastapi.routing import APIRoute
from starlette.requests import HTTPConnection

from server.platform.authorization.named_things import Thing, names_in, things_of_path
from server.platform.authorization.principals import LEAST_ROLE, Principal, Scope
from server.platform.errors import ForbiddenError, ServiceError, UnauthenticatedError
from server.platform.service import Service

__all__ = ["Principal", "PrincipalDep", "require", "scope_of"]
#: Close code of a WebSocket that is refused (RFC 6455 section 7.4.1: policy).
POLICY = 1008


def _current_principal(connection: HTTPConnection) -> Principal:
    """Return who asks.

    Raises
    ------
    UnauthenticatedError
        If the request brought no token, or one that is not (or no longer) known.
    """
    principal = connection.scope.get("hilfit.principal")
    if not isinstance(principal, Principal):
        raise UnauthenticatedError("server.pair_device_first_send")
    return principal


async def _principal(connection: HTTPConnection) -> Principal:
    """Return who asks, as a dependency; a coroutine: for a plain function FastAPI takes a costly thread."""
    return _current_principal(connection)


PrincipalDep = Annotated[Principal, Depends(_principal)]


def require(scope: Scope, *, every_machine: bool = False) -> Any:
    """Build a dependency that lets only principals with ``scope`` through.

    Parameters
    ----------
    scope : what the route does
    every_machine : the route says or does something about all machines at once; refused (403) to bound principals
    """

    async def guard(connection: HTTPConnection) -> None:
        try:
            principal = _current_principal(connection)
            if not principal.may(scope):
                raise ForbiddenError(
                    "server.needs_role", least_role=LEAST_ROLE[scope], principal=principal.name, role=principal.role
                )
            if principal.machines is not None:
                if every_machine:
                    raise ForbiddenError("server.about_all_machines_bound", principal=principal.name)
                await _only_its_machines(connection, principal)
        except ServiceError as error:
            if connection.scope["type"] == "websocket":
                raise WebSocketException(POLICY, str(error)) from None
            raise

    guard.hilfit_scope = scope  # type: ignore[attr-defined]
    guard.hilfit_every_machine = every_machine  # type: ignore[attr-defined]
    return Depends(guard)


def scope_of(route: Any) -> Scope | None:
    """Return the scope that a route declares; None without one."""
    scope: Scope | None = _declared(route, "hilfit_scope")
    return scope


def is_about_every_machine(route: Any) -> bool:
    """Test whether a route refuses bound principals."""
    return bool(_declared(route, "hilfit_every_machine"))


def _declared(route: Any, what: str) -> Any:
    """Return what the guard of a route declares; None without one."""
    found = (getattr(dependency.call, what, None) for dependency in route.dependant.dependencies)
    return next((value for value in found if value is not None), None)


async def _only_its_machines(connection: HTTPConnection, principal: Principal) -> None:
    service = connection.app.state.service
    assert isinstance(service, Service)
    things = things_of_path(str(connection.scope["path"]), connection.path_params, service.ownership.collections)
    if connection.scope["type"] == "websocket":  # a request's query is checked once it is parsed
        things |= {("machines", name) for name in connection.query_params.getlist("machine")}
    if things:
        await run_in_threadpool(service.ownership.refuse_foreign, principal, things)


_REQUEST = "hilfit_request"


class TypedRoute(APIRoute):
    """A route that answers 404 where a request names what does not exist for whoever asks.

    A body may be spelt in many ways (``Application/JSON``, ``application/x+json``), and whoever looks at it beforehand
    has to know all of them. Here nothing is looked at beforehand: the endpoint is called with typed values, and just
    before that every value whose type names something (:data:`server.platform.authorization.named_things`) is checked
    against what exists for the principal. (What the path names, which has one spelling, is checked by the guard, so
    that it is 404 whatever the body is.) All routers use this class; :func:`server.composition.app.create_app` refuses
    a route of another.
    """

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
