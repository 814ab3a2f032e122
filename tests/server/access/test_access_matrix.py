"""Every route of the application: has a scope, keeps out whoever lacks it, and whoever is bound to another machine."""

from __future__ import annotations

import inspect
import json
import re
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin

import pytest
from access_fakes import Guarded, guarded_service
from fastapi import APIRouter
from fastapi.routing import APIWebSocketRoute
from pydantic import BaseModel, ValidationError
from service_fakes import API, Fakes, recording_bytes
from starlette.websockets import WebSocketDisconnect

from server.composition.app import create_app
from server.composition.declarations import RESOURCES
from server.platform.authorization.guard import scope_of
from server.platform.authorization.named_things import Names, can_name
from server.platform.authorization.principals import LEAST_ROLE, ROLES, Role, Scope
from server.platform.http.bodies import PLAIN
from server.platform.resource import Resource
from server.platform.service import Service
from server.platform.settings import Settings

#: All that may be asked without being known. The description of the API is public: it is in the repository.
OPEN = {
    *(("GET", f"/{name}") for name in ("healthz", "livez", "readyz")),
    ("POST", f"{API}/access/pair"),
    ("GET", f"{API}/openapi.json"),
}
#: Ends the session of whoever asks, which everybody may; tried in test_access_sessions.py.
OWN = ("DELETE", f"{API}/access/me")
#: Resources that belong to one machine each.
OF_A_MACHINE = {"machines", "jobs", *(name for resource in RESOURCES for name in resource.of_a_machine)}
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
        service = Service(Settings(data_dir=Path(directory)), RESOURCES, Fakes().parts)
        try:
            return list(walk(create_app(service).routes))
        finally:
            service.stop()


ROUTES = every_route()
GUARDED = [entry for entry in ROUTES if entry[:2] not in OPEN]
REQUESTS = [entry for entry in GUARDED if entry[0] != "WEBSOCKET" and entry[:2] != OWN]


#: Of another machine; whatever else a route needs is in order.
FOREIGN_QUERY = {"machine": "lever", "role": "train", "name": "made.csv"}


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
    if (method, path) != OWN:
        assert method in ("GET", "WEBSOCKET") or scope != "read", "what changes something is not for viewers"


@pytest.mark.slow
@pytest.mark.parametrize(("method", "path", "route"), REQUESTS, ids=name)
def test_a_route_is_open_from_its_least_role_on(guarded: Guarded, method: str, path: str, route: Any) -> None:
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
        answer = guarded.client.request(method, path, params=FOREIGN_QUERY, headers=headers)
        assert answer.status_code == 404
    elif path.startswith(
        (f"{API}/access/", f"{API}/audit", f"{API}/backups", f"{API}/webhooks", "/metrics")
    ) and not path.endswith("/me"):
        place = re.sub(r"\{.*?\}", "nothing", path)
        assert guarded.client.request(method, place, headers=headers).status_code == 403
    elif path not in ENDLESS:
        place = re.sub(r"\{.*?\}", "payload", path)
        answer = guarded.client.request(method, place, headers=headers)
        assert answer.status_code < 500
        assert "lever" not in answer.text


#: Texts that a body needs and that have a grammar, by the name of the field.
SOUND = {"cron": "0 0 * * *"}


def foreign_bodies(model: type[BaseModel]) -> list[dict[str, Any]]:
    """Bodies that a model takes, of the machine ``other`` but for a thing of ``lever``, each that it names in turn."""
    places = [place for place, said in text_fields(model, "") if names(said)]
    return [body for place in places for body in _bodies(model, place) if _taken(model, body)]


def _bodies(model: type[BaseModel], foreign: str) -> Iterator[dict[str, Any]]:
    """What is required and what leads to the foreign place; then with each way that a choice can be made."""
    needed = {
        name: _value(_kept(field), f".{name}", foreign)
        for name, field in model.model_fields.items()
        if field.is_required() or f"{foreign}.".startswith(f".{name}.")
    }
    yield needed
    for name, field in model.model_fields.items():
        others = (choice for choice in get_args(field.annotation) if isinstance(choice, str))
        yield from (needed | {name: choice} for choice in others if choice not in (field.default, needed.get(name)))


def _value(annotation: Any, place: str, foreign: str) -> Any:
    origin, parts = get_origin(annotation), get_args(annotation)
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        fields = annotation.model_fields.items()
        return {name: _value(_kept(field), f"{place}.{name}", foreign) for name, field in fields if field.is_required()}
    if origin is Annotated:
        for extra in parts[1:]:
            if isinstance(extra, Names):
                machine = "lever" if place == foreign else "other"
                return machine if extra.collection == "machines" else f"of-{machine}"
        return _value(parts[0], place, foreign)
    if origin in (list, tuple):
        return [_value(parts[0], place, foreign)]
    if origin is Literal:
        return parts[0]
    return SOUND.get(last(place), "some words") if annotation is str else _value(parts[0], place, foreign)


def _kept(field: Any) -> Any:
    """The type of a model's field, with what pydantic has taken out of it."""
    return Annotated[field.annotation, *field.metadata] if field.metadata else field.annotation


def _taken(model: type[BaseModel], body: dict[str, Any]) -> bool:
    try:
        model.model_validate(body)
    except ValidationError:
        return False
    return True


#: Ways to say that a body is JSON, and ways that are none: those are refused before anything is looked up.
SPELLINGS = (
    "application/json",
    "Application/JSON",
    "APPLICATION/JSON; charset=utf-8",
    "application/json;charset=utf-8",
    " application/json",
    "application/x+json",
    "application/vnd.hilfit+JSON",
    "application/problem+json",
)
NO_JSON = ("text/plain", "application/yaml", "application/octet-stream", "text/json", "x/y", "")


def body_model(route: Any) -> Any:
    """The model of a route's JSON body; None without one."""
    fields = route.dependant.body_params
    return fields[0].field_info.annotation if fields else None


def text_fields(annotation: Any, place: str) -> Iterator[tuple[str, tuple[Any, ...]]]:
    """(place, what its type says of it) of everything in a type that can be any text."""
    origin, parts = get_origin(annotation), get_args(annotation)
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        for name, field in annotation.model_fields.items():
            yield from text_fields(_kept(field), f"{place}.{name}")
    elif annotation is str:
        yield place, ()
    elif origin is Annotated and parts[0] is str:
        yield place, parts[1:]
    elif origin is not Literal:
        for part in parts[:1] if origin is Annotated else parts:
            yield from text_fields(part, place)


def names(said: tuple[Any, ...]) -> bool:
    """Whether a text's type says that it names something of a machine."""
    return any(isinstance(extra, Names) for extra in said)


def is_plain(said: tuple[Any, ...]) -> bool:
    """Whether a text's type says that it is a person's words, as ``Label`` does."""
    own = (rule for extra in said for rule in (extra, *getattr(extra, "metadata", ())))
    return any(getattr(rule, "pattern", None) == PLAIN for rule in own)


def last(place: str) -> str:
    return place.rpartition(".")[2]


def unsaid(path: str, route: Any) -> Iterator[str]:
    """Places of texts in a request whose type does not say what they are."""
    for parameter, entry in inspect.signature(route.endpoint).parameters.items():
        if parameter in ("id", "name") and f"{{{parameter}}}" in path:
            continue  # the path says what they are
        for place, said in text_fields(entry.annotation, parameter):
            if not names(said) and (not is_plain(said) or f"{last(place)}s" in OF_A_MACHINE):
                yield place


#: Fields of text that name nothing which belongs to a machine, and whose type does not say so.
NAMES_NOTHING = {
    "action", "bus", "channel", "columns", "containing", "cron", "estimator", "faults", "idempotency_key", "joints",
    "last_event_id", "machines", "name", "note", "search", "tags", "timezone",
}  # fmt: skip


@pytest.mark.parametrize(("method", "path", "route"), REQUESTS, ids=name)
def test_every_text_in_a_request_says_whether_it_names_something_of_a_machine(
    method: str, path: str, route: Any
) -> None:
    for place in unsaid(path, route):
        assert last(place) in NAMES_NOTHING, (
            f"{method} {path}: give {place} a type of server.platform.authorization.named_things if it names something "
            "of a machine, or Label if it is a person's words; what is neither is listed in NAMES_NOTHING"
        )


def test_what_is_listed_as_naming_nothing_is_asked_for() -> None:
    assert {last(place) for _, path, route in REQUESTS for place in unsaid(path, route)} >= NAMES_NOTHING


@pytest.mark.parametrize(("method", "path", "route"), REQUESTS, ids=name)
def test_no_spelling_of_a_body_gets_past_the_binding(guarded: Guarded, method: str, path: str, route: Any) -> None:
    model = body_model(route)
    if model is None or not can_name(model):
        return
    headers = guarded.bearer("admin", ("other",))
    place = re.sub(r"\{.*?\}", "payload", path)
    for body in foreign_bodies(model):
        content = json.dumps(body)

        def ask(spelling: str, content: str = content) -> Any:
            return guarded.client.request(method, place, content=content, headers=headers | {"Content-Type": spelling})

        for spelling in SPELLINGS:
            answer = guarded.client.request(
                method, place, content=content, headers={**headers, "Content-Type": spelling}
            )
            assert answer.status_code == 404, (spelling, answer.text)
            assert "for 'a admin'" in answer.json()["detail"]
        for spelling in NO_JSON:
            answer = guarded.client.request(
                method, place, content=content, headers={**headers, "Content-Type": spelling}
            )
            assert answer.status_code in (404, 422), (spelling, answer.text)
        answer = guarded.client.request(method, place, content=content, headers=headers)
        assert answer.status_code in (404, 422)


def test_bodies_name_each_thing_of_another_machine_once() -> None:
    models = {model for _, _, route in REQUESTS if (model := body_model(route)) is not None and can_name(model)}
    bodies = {model.__name__: foreign_bodies(model) for model in models}
    none = [model for model, own in bodies.items() if not own]
    assert none == [], "a text that each of these needs has a grammar; put one that fits into SOUND"
    for body in (
        {"machine": "lever", "recordings": [{"id": "of-other"}]},
        {"machine": "other", "recordings": [{"id": "of-lever"}]},
    ):
        assert body in bodies["IdentificationOrder"] and body in bodies["ValveOrder"]
    assert bodies["Proposal"] == [{"identification": "of-lever"}, {"valves": "of-lever"}]
    wishes = bodies["ScheduleWish"]
    assert {"machine": "lever", "cron": "0 0 * * *"} in wishes
    assert {"machine": "other", "cron": "0 0 * * *", "motion": "standard", "excitations": ["of-lever"]} in wishes


def test_a_route_of_another_class_is_refused(tmp_path: Path) -> None:
    plain = APIRouter(prefix="/plain")
    plain.add_api_route("", lambda: None)
    service = Service(Settings(data_dir=tmp_path), (*RESOURCES, Resource("plain", (plain,))), Fakes().parts)
    try:
        with pytest.raises(TypeError, match="/plain"):
            create_app(service)
    finally:
        service.stop()


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
def test_roles_that_may_open_the_live_stream(
    guarded: Guarded, role: Role | None, machines: tuple[str, ...] | None, allowed: bool
) -> None:
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
