"""The FastAPI application: routes, problem documents, limits, health, metrics."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterable, Iterator
from importlib.metadata import version
from typing import Any, Literal

from fastapi import FastAPI, Response
from fastapi.routing import APIRoute
from prometheus_client import CollectorRegistry, Histogram
from prometheus_client.core import Metric
from prometheus_client.exposition import generate_latest
from prometheus_client.registry import Collector
from pydantic import BaseModel
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from server.access.access_desk import Access
from server.access.gate import OPEN, Gate
from server.access.rates import Rate, Rates
from server.audit.audit_resource import Audit
from server.live.revisions import Revisions
from server.platform.authorization.guard import TypedRoute, is_about_every_machine, require
from server.platform.http import problems
from server.platform.http.base_path import BasePath
from server.platform.http.kept_answers import Conditional, KeptAnswers
from server.platform.http.pages import CLOSED, Pages, page_files
from server.platform.http.request_limits import BodyLimit, OwnPagesOnly, SafeHeaders
from server.platform.http.route_parameters import TEXT, sends
from server.platform.http.route_parameters import problems as problem_responses
from server.platform.resource import Resource, kept_lists
from server.platform.service import Service

#: Text format 0.0.4, which every Prometheus reads.
MEDIA_TYPE = "text/plain; version=0.0.4; charset=utf-8"
_BUCKETS = (0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)


class _Declared(Collector):
    """Asks the resources when Prometheus asks."""

    def __init__(self, service: Service) -> None:
        self._service = service

    def collect(self) -> Iterator[Metric]:
        """Collect everything that the resources count."""
        for resource in self._service.resources:
            if resource.metrics is not None:
                yield from resource.metrics(self._service)


class Metrics:
    """The registry of one service, which Prometheus reads at ``/metrics``; filled when it is read.

    Names follow Prometheus' conventions: base units, ``_total`` for counters. There is no label with an id in it: every
    machine and every kind is a series, not every recording.
    """

    def __init__(self, service: Service) -> None:
        self._registry = CollectorRegistry()
        self._registry.register(_Declared(service))
        self.requests = Histogram(
            "hilfit_http_request_seconds",
            "Time from a request's first byte to its response's last one.",
            ("method", "route", "status"),
            buckets=_BUCKETS,
            registry=self._registry,
        )

    def text(self) -> bytes:
        """Write everything as Prometheus reads it."""
        return generate_latest(self._registry)


class _RequestTimes:
    """Measures requests by route; streams are not measured.

    A route is named by the path that its router declares: ids make no series.
    """

    def __init__(self, app: ASGIApp, metrics: Metrics, clock: Callable[[], float] = time.perf_counter) -> None:
        self._app = app
        self._metrics = metrics
        self._clock = clock

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on and time it."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        began = self._clock()
        status, stream = 500, False

        async def sending(message: Message) -> None:
            nonlocal status, stream
            if message["type"] == "http.response.start":
                status = message["status"]
                stream = any(value.startswith(b"text/event-stream") for _, value in message["headers"])
            await send(message)

        try:
            await self._app(scope, receive, sending)
        finally:
            if not stream:
                route = getattr(scope.get("route"), "path", "none")
                method = scope["method"] if route != "none" else "none"
                self._metrics.requests.labels(method, route, str(status)).observe(self._clock() - began)


class Health(BaseModel):
    """Answered when all is well."""

    status: Literal["ok"]


API = "/api/v1"

_RESPONSES = {str(status): response for status, response in problem_responses(401, 403, 429, 503).items()}
_NO_SUCH = {str(status): response for status, response in problem_responses(404).items()}
_TOKEN = {"type": "http", "scheme": "bearer", "description": "Of a paired device, or an API key; `docs/access.md`"}
_UNCHANGED = {"description": "Not Modified: `If-None-Match` names the `ETag` of this answer"}


class _Application(FastAPI):
    """Describes problem documents once for all routes."""

    def openapi(self) -> dict[str, Any]:
        """Build the OpenAPI description."""
        description = super().openapi()
        schema = problems.Problem.model_json_schema(ref_template="#/components/schemas/{model}")
        own = {**schema.pop("$defs", {}), "Problem": schema}
        description["components"]["schemas"] = own | description["components"]["schemas"]
        base = self.state.service.settings.base_path
        about = "The service that this description was read from"
        description["servers"] = [{"url": base or "/", "description": about}]
        description["components"]["securitySchemes"] = {"token": _TOKEN}
        for path, operations in description["paths"].items():
            for method, operation in operations.items():  # what the layers around all routes answer
                operation["responses"] = {**_RESPONSES, **operation["responses"]}
                if any(own["name"] == "machine" for own in operation.get("parameters", ())):
                    operation["responses"] |= _NO_SUCH  # to whoever is bound to others (TypedRoute)
                if path.startswith(CLOSED) and path not in OPEN:
                    operation["security"] = [{"token": []}, {}]  # without one where access control is off
                if method == "get" and "text/event-stream" not in operation["responses"]["200"].get("content", {}):
                    operation["responses"]["304"] = _UNCHANGED
        return description


def _operation_name(route: APIRoute) -> str:
    """Return ``recordings.upload``: the route's resource, and its function's name."""
    resource = route.endpoint.__module__.split(".")[1]
    return f"{'health' if resource == 'composition' else resource}.{route.name}"


def create_app(service: Service) -> FastAPI:
    """Create the application in front of ``service``, which the caller starts before and stops afterwards."""
    app = _Application(
        title="hilfit",
        summary="Acquisition and fitting for hydraulically driven arms",
        version=version("hilfit"),
        redoc_url=None,
        docs_url=None,  # the page that FastAPI brings loads scripts from elsewhere
        openapi_url=f"{API}/openapi.json",
        generate_unique_id_function=_operation_name,
    )
    app.state.service = service
    app.router.route_class = TypedRoute
    problems.install(app)
    for resource in service.resources:
        check_declaration(resource, service.ownership.collections)
        for router in resource.routers:
            app.include_router(router, prefix=API)
    metrics = Metrics(service)
    _add_health(app, service, metrics)
    # Behind all routes: a mount at / would take what a route answers with 405.
    app.router.default = Pages(page_files(service.settings.base_path), app.router.not_found)
    _add_layers(app, service, metrics)
    return app


def check_declaration(resource: Resource, collections: Collection[str]) -> None:
    """Look whether a resource forgot something of its routes.

    Parameters
    ----------
    collections : those whose things belong to machines

    Raises
    ------
    TypeError
        If a route has another class than :class:`TypedRoute`, no resource names to which machine the things in its path
        belong, or a list is declared that no route answers.
    """
    routes = [route for router in resource.routers for route in router.routes if isinstance(route, APIRoute)]
    for route in routes:
        if not isinstance(route, TypedRoute):
            raise TypeError(f"{route.path}: nobody checks what its requests name; give its router TypedRoute")
        collection = route.path.strip("/").split("/")[0]
        known = collection in collections or collection in resource.of_no_machine or is_about_every_machine(route)
        if "{" in route.path and not known:
            raise TypeError(
                f"{route.path}: nobody knows of which machine '{collection}' are; add them to of_a_machine or "
                f"of_no_machine of resource '{resource.name}'"
            )
    for paths, method in ((resource.kept, "GET"), (resource.large_uploads, "POST")):
        unknown = set(paths) - {route.path for route in routes if method in (route.methods or ())}
        if unknown:
            raise TypeError(f"resource '{resource.name}' declares {sorted(unknown)}, which no {method} route answers")


def _add_health(app: FastAPI, service: Service, metrics: Metrics) -> None:
    """Add what those ask who see to it that the service runs."""

    @app.get("/livez", tags=["health"])
    async def livez() -> Health:
        """Check that the process answers: if not, restart it."""
        return Health(status="ok")

    @app.get("/readyz", tags=["health"], operation_id="health.readyz", responses=problem_responses(503))
    @app.get("/healthz", tags=["health"], responses=problem_responses(503))
    def healthz() -> Health:
        """Check that requests can be served: the store is readable, the data directory writable."""
        service.check()
        return Health(status="ok")

    @app.get(
        "/metrics", **sends({"text/plain": TEXT}), tags=["health"], dependencies=[require("read", every_machine=True)]
    )
    def read_metrics() -> Response:
        """Return what is counted, for Prometheus."""
        return Response(metrics.text(), media_type=MEDIA_TYPE)


def _actions_of(resources: Iterable[Resource]) -> dict[Any, str]:
    """Return the audit log's name of each endpoint's call: ``recordings.start``."""
    return {
        route.endpoint: f"{resource.name}.{route.endpoint.__name__}"
        for resource in resources
        for router in resource.routers
        for route in router.routes
        if isinstance(route, APIRoute)
    }


def _add_layers(app: FastAPI, service: Service, metrics: Metrics) -> None:
    """Add what a request passes before it comes to a route; the last one is the outermost."""
    settings, access = service.settings, service[Access]

    large = frozenset(API + path for resource in service.resources for path in resource.large_uploads)

    def limit(path: str) -> int:
        return settings.maximum_upload_bytes if path in large else settings.maximum_request_bytes

    lists = {API + path: names for path, names in kept_lists(service.resources).items()}
    app.add_middleware(KeptAnswers, lists=lists, revisions=service[Revisions].current)
    app.add_middleware(BodyLimit, limit=limit)
    actions = _actions_of(service.resources)
    rate = Rate(settings.requests_per_second, max(1, round(4 * settings.requests_per_second)))
    app.add_middleware(Gate, access=access, audit=service[Audit], actions=actions, rate=rate, rates=Rates())
    app.add_middleware(OwnPagesOnly, hosts=settings.public_names, addresses=access.required)
    app.add_middleware(Conditional)
    app.add_middleware(SafeHeaders)
    app.add_middleware(_RequestTimes, metrics=metrics)
    app.add_middleware(BasePath, base=settings.base_path)
