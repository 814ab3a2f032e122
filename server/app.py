"""The FastAPI application: routes, problem documents, limits, health."""

from __future__ import annotations

from importlib.metadata import version
from typing import Any

from fastapi import FastAPI

from server import problems
from server.limits import BodyLimit, OwnPagesOnly, SafeHeaders
from server.resources import Health
from server.routes import ROUTERS
from server.routes.common import problems as problem_responses
from server.service import Service

API = "/api/v1"
UPLOAD = f"{API}/recordings/upload"


class _Application(FastAPI):
    """Describes problem documents once for all routes."""

    def openapi(self) -> dict[str, Any]:
        """The OpenAPI description."""
        description = super().openapi()
        description["components"]["schemas"].setdefault("Problem", problems.Problem.model_json_schema())
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
    problems.install(app)
    for router in ROUTERS:
        app.include_router(router, prefix=API)

    @app.get("/healthz", tags=["health"], responses=problem_responses(503))
    def healthz() -> Health:
        """Whether HTTP and the store work."""
        service.check()
        return Health(status="ok")

    def limit(path: str) -> int:
        return settings.maximum_upload_bytes if path == UPLOAD else settings.maximum_request_bytes

    app.add_middleware(BodyLimit, limit=limit)
    app.add_middleware(OwnPagesOnly)
    app.add_middleware(SafeHeaders)
    return app
