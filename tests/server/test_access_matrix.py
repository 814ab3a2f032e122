"""Every route of the application: has a scope, keeps out whoever lacks it, and whoever is bound to another machine."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from access_fakes import Guarded, guarded_service
from fastapi.routing import APIWebSocketRoute
from service_fakes import API, Fakes, recording_bytes
from starlette.websockets import WebSocketDisconnect

from server.access.guard import scope_of
from server.access.principals import LEAST_ROLE, ROLES, Role, Scope
from server.app import create_app
from server.service import Service
from server.settings import Settings

#: All that may be asked without being known. The description of the API is public: it is in the repository.
OPEN = {("GET", "/healthz"), ("POST", f"{API}/access/pair"), ("GET", f"{API}/openapi.json")}
#: Resources that belong to one machine each.
OF_A_MACHINE = (
    "machines",
    "recordings",
    "identifications",
    "calibrations",
    "excitations",
    "schedules",
    "alarms",
    "jobs",
)
#: Streams without an end: that they are refused is tested, and that they run elsewhere.
ENDLESS = (f"{API}/events",)


def walk(routes: Any, prefix: str = "") -> Iterator[tuple[str, str, Any]]:
    """(method, path, route) of all routes, through the routers that are included."""
    for route in routes:
        if isinstance(route, APIWebSocketRoute):
            yield "WEBSOCKET", prefix + route.path, route
        elif hasattr(route, "methods"):
            yield from ((method, prefix + route.path, route) for method in sorted(route.methods - {"HEAD"}))
        elif hasattr(route, "original_router"):
            yield from walk(route.original_router.routes, prefix + route.include_context.prefix)


def every_route() -> list[tuple[str, str, Any]]:
    with tempfile.TemporaryDirectory() as directory:
        service = Service(Settings(data_dir=Path(directory)), Fakes().parts)
        try:
            return list(walk(create_app(service).routes))
        finally:
            service.stop()


ROUTES = every_route()
GUARDED = [entry for entry in ROUTES if entry[:2] not in OPEN]
REQUESTS = [entry for entry in GUARDED if entry[0] != "WEBSOCKET"]


def name(value: object) -> str | None:
    return value if isinstance(value, str) else "" if hasattr(value, "path") else None


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Guarded]:
    with guarded_service(tmp_path_factory.mktemp("data")) as service:
        yield service


def scope_or_fail(method: str, path: str, route: Any) -> Scope:
    scope = scope_of(route)
    assert scope is not None, f"{method} {path} has no scope; add dependencies=[require(...)] to it"
    return scope


def test_the_walk_finds_routes_of_every_kind() -> None:
    paths = {(method, path) for method, path, _ in ROUTES}
    assert paths >= OPEN
    assert ("WEBSOCKET", f"{API}/live/stream") in paths
    assert ("POST", f"{API}/calibrations/{{id}}/approve") in paths
    assert ("GET", "/metrics") in paths
    assert len(paths) > 40


@pytest.mark.parametrize(("method", "path", "route"), GUARDED, ids=name)
def test_every_route_has_a_scope_that_fits_its_method(method: str, path: str, route: Any) -> None:
    scope = scope_or_fail(method, path, route)
    assert method in ("GET", "WEBSOCKET") or scope != "read", "what changes something is not for viewers"


@pytest.mark.slow
@pytest.mark.parametrize(("method", "path", "route"), REQUESTS, ids=name)
def test_roles(guarded: Guarded, method: str, path: str, route: Any) -> None:
    least = LEAST_ROLE[scope_or_fail(method, path, route)]
    place = re.sub(r"\{.*?\}", "nothing", path)

    def status(headers: dict[str, str]) -> int:
        return int(guarded.client.request(method, place, headers=headers).status_code)

    assert status({}) == 401
    assert status({"Authorization": "Bearer hilfit_guessed"}) == 401
    for role in ROLES:
        allowed = ROLES.index(role) >= ROLES.index(least)
        if not allowed:
            assert status(guarded.bearer(role)) == 403, role
        elif path not in ENDLESS:
            assert status(guarded.bearer(role)) not in (401, 403, 500), role


@pytest.mark.parametrize(("method", "path", "route"), REQUESTS, ids=name)
def test_what_is_of_a_foreign_machine_does_not_exist(guarded: Guarded, method: str, path: str, route: Any) -> None:
    headers = guarded.bearer("admin", ("other",))
    resource = path.removeprefix(f"{API}/").partition("/")[0]
    queried = {field.name for field in route.dependant.query_params}
    if "{" in path and resource in OF_A_MACHINE:
        place = re.sub(r"\{.*?\}", "lever", path)
        assert guarded.client.request(method, place, headers=headers).status_code == 404
    elif "machine" in queried:
        answer = guarded.client.request(method, path, params={"machine": "lever"}, headers=headers)
        assert answer.status_code == 404
    elif method == "POST" and resource in OF_A_MACHINE and path not in (f"{API}/machines", f"{API}/machines/check"):
        body = {"machine": "lever", "identification": "idn-of-lever"}
        assert guarded.client.post(path, json=body, headers=headers).status_code == 404
    elif path.startswith((f"{API}/access/", f"{API}/audit", f"{API}/backups", "/metrics")) and not path.endswith("/me"):
        place = re.sub(r"\{.*?\}", "nothing", path)
        assert guarded.client.request(method, place, headers=headers).status_code == 403
    elif path not in ENDLESS:
        place = re.sub(r"\{.*?\}", "payload", path)
        answer = guarded.client.request(method, place, headers=headers)
        assert answer.status_code < 500
        assert "lever" not in answer.text


@pytest.mark.slow
def test_a_bound_principal_has_its_own_machine_and_sees_no_other(guarded: Guarded, tmp_path: Path) -> None:
    content = recording_bytes(tmp_path)
    parameters = {"machine": "lever", "role": "train", "name": "made.csv"}
    place = f"{API}/recordings/upload"
    made = guarded.client.post(
        place, params=parameters, content=content, headers=guarded.bearer("operator", ("lever",))
    )
    assert made.status_code == 201, made.text
    id = made.json()["id"]
    for machines, status, count in ((("lever",), 200, 1), (("other",), 404, 0), (None, 200, 1)):
        headers = guarded.bearer("viewer", machines)
        assert guarded.client.get(f"{API}/recordings/{id}", headers=headers).status_code == status
        assert len(guarded.client.get(f"{API}/recordings", headers=headers).json()["items"]) == count
        names = [row["name"] for row in guarded.client.get(f"{API}/machines", headers=headers).json()["items"]]
        assert names == (["other", "lever"] if machines is None else list(machines))


def test_a_bound_engineer_changes_the_file_of_its_machine_only(guarded: Guarded) -> None:
    file = guarded.client.get(f"{API}/machines/lever/file", headers=guarded.bearer("viewer")).content
    for place in (f"{API}/machines", f"{API}/machines/check"):
        for machine, status in (("other", 404), ("lever", 200)):
            headers = guarded.bearer("engineer", (machine,))
            assert guarded.client.post(place, content=file, headers=headers).status_code == status


@pytest.mark.parametrize(
    ("role", "machines", "allowed"),
    [(None, None, False), ("viewer", ("other",), False), ("viewer", ("lever",), True), ("viewer", None, True)],
)
def test_the_live_stream(guarded: Guarded, role: Role | None, machines: tuple[str, ...] | None, allowed: bool) -> None:
    protocols = ["hilfit.v1"]
    if role is not None:
        protocols.append("bearer." + guarded.bearer(role, machines)["Authorization"].removeprefix("Bearer "))
    place = f"ws://127.0.0.1:8350{API}/live/stream?machine=lever"
    if not allowed:
        with pytest.raises(WebSocketDisconnect), guarded.client.websocket_connect(place, subprotocols=protocols):
            pass
        return
    with guarded.client.websocket_connect(place, subprotocols=protocols) as socket:
        assert socket.accepted_subprotocol == "hilfit.v1"


def test_a_page_from_elsewhere_opens_no_stream(guarded: Guarded) -> None:
    token = guarded.bearer("viewer")["Authorization"].removeprefix("Bearer ")
    place = f"ws://127.0.0.1:8350{API}/live/stream?machine=lever"
    headers = {"Origin": "http://elsewhere.example"}
    protocols = ["hilfit.v1", f"bearer.{token}"]
    with (
        pytest.raises(WebSocketDisconnect),
        guarded.client.websocket_connect(place, subprotocols=protocols, headers=headers),
    ):
        pass
