"""The FastAPI application: routes, problem documents, limits, health."""

from __future__ import annotations

from importlib.metadata import version
from typing import Any

from fastapi import FastAPI, Response
from fastapi.routing import APIRoute

from server import problems
from server.access.guard import require
from server.access.layer import Gate
from server.access.rates import Rate, Rates
from server.access.route import TypedRoute
from server.kept_answers import LISTS, KeptAnswers
from server.limits import BodyLimit, OwnPagesOnly, SafeHeaders
from server.metrics import MEDIA_TYPE, Metrics, RequestTimes
from server.pages import Pages, page_files
from server.resources import Health
from server.routes import ROUTERS
from server.routes.common import problems as problem_responses
from server.service import Service

API = "/api/v1"
UPLOAD = f"{API}/recordings/upload"


_RESPONSES = {str(status): response for status, response in problem_responses(401, 403, 429, 503).items()}


class _Application(FastAPI):
    """Describes problem documents once for all routes."""

    def openapi(self) -> dict[str, Any]:
        """The OpenAPI description."""
        description = super().openapi()
        description["components"]["schemas"].setdefault("Problem", problems.Problem.model_json_schema())
        for path in description["paths"].values():
            for operation in path.values():  # what the layers around all routes answer
                operation["responses"] = {**_RESPONSES, **operation["responses"]}
        for path in LISTS:
            unchanged = {"description": "Not Modified: `If-None-Match` names the `ETag` of this answer"}
            description["paths"][API + path]["get"]["responses"]["304"] = unchanged
        return description


def create_app(service: Service) -> FastAPI:
    """The application in front of ``service``, which whoever calls starts before and stops afterwards."""
    settings = service.settings
    app = _Application(
        title="hilfit",
        summary="Acquisition and fitting for hydraulically driven arms",
        version=version("hilfit"),
        redoc_url=None,
        docs_url=None,  # the page that FastAPI brings loads scripts from elsewhere
        openapi_url=f"{API}/openapi.json",
    )
    app.state.service = service
    app.router.route_class = TypedRoute
    problems.install(app)
    for router in ROUTERS:
        for route in router.routes:
            if isinstance(route, APIRoute) and not isinstance(route, TypedRoute):
                raise TypeError(f"{route.path}: nobody checks what its requests name; give its router TypedRoute")
        app.include_router(router, prefix=API)

    @app.get("/livez", tags=["health"])
    async def livez() -> Health:
        """Whether the process answers: if not, restart it."""
        return Health(status="ok")

    @app.get("/readyz", tags=["health"], responses=problem_responses(503))
    @app.get("/healthz", tags=["health"], responses=problem_responses(503))
    def healthz() -> Health:
        """Whether requests can be served: the store can be read, and the data directory be written."""
        service.check()
        return Health(status="ok")

    metrics = Metrics(service)

    @app.get(
        "/metrics",
        tags=["health"],
        dependencies=[require("read", every_machine=True)],
        response_class=Response,
        responses={200: {"content": {"text/plain": {"schema": {"type": "string"}}}}},
    )
    def read_metrics() -> Response:
        """What is counted, for Prometheus."""
        return Response(metrics.text(), media_type=MEDIA_TYPE)

    # Behind all routes: a mount at / would take what a route answers with 405.
    app.router.default = Pages(page_files(), app.router.not_found)

    def limit(path: str) -> int:
        return settings.maximum_upload_bytes if path == UPLOAD else settings.maximum_request_bytes

    app.add_middleware(KeptAnswers, prefix=API, revisions=service.revisions.current)
    app.add_middleware(BodyLimit, limit=limit)
    rate = Rate(settings.requests_per_second, max(1, round(4 * settings.requests_per_second)))
    app.add_middleware(Gate, access=service.access, audit=service.audit, rate=rate, rates=Rates())
    app.add_middleware(OwnPagesOnly, hosts=settings.public_hosts, addresses=service.access.required)
    app.add_middleware(SafeHeaders)
    app.add_middleware(RequestTimes, metrics=metrics)
    return app
