"""What clients ask under a condition: HEAD, If-None-Match, If-Match with several tags, If-None-Match: *."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from acquired_machines import MACHINES, named
from pydantic import BaseModel
from service_fakes import API, Running


def same_but_for_the_body(running: Running, path: str) -> None:
    whole, head = running.client.get(path), running.client.head(path)
    assert (head.status_code, head.content) == (200, b""), path
    assert head.headers["content-length"] == str(len(whole.content)) == whole.headers["content-length"], path


@pytest.mark.slow
def test_head_of_the_description_is_get_without_a_body(running: Running) -> None:
    same_but_for_the_body(running, f"{API}/openapi.json")  # describing every route takes a second


def test_head_is_get_without_a_body(running: Running) -> None:
    running.client.post(MACHINES, content=named("head"))
    for path in ("/healthz", MACHINES, f"{MACHINES}/head", f"{MACHINES}/head/file"):
        same_but_for_the_body(running, path)
    assert running.client.head(f"{MACHINES}/nowhere").status_code == 404


def test_what_a_client_has_is_not_sent_again(running: Running) -> None:
    running.client.post(MACHINES, content=named("known"))
    for path in (f"{MACHINES}/known", f"{MACHINES}/known/file", MACHINES):
        tag = running.client.get(path).headers["etag"]
        for known in (tag, f'"other", {tag}', "*", tag.removeprefix("W/")):
            again = running.client.get(path, headers={"If-None-Match": known})
            assert (again.status_code, again.content, again.headers["etag"]) == (304, b"", tag), (path, known)
        assert running.client.get(path, headers={"If-None-Match": '"other"'}).status_code == 200
    assert running.client.get(f"{MACHINES}/nowhere", headers={"If-None-Match": "*"}).status_code == 404


def test_several_tags_are_known(running: Running) -> None:
    running.client.post(MACHINES, content=named("several"))
    text = named("several").replace("velocity: 1.0", "velocity: 1.5")
    for tags, status in (('"7", "8"', 412), ('W/"1"', 412), ('"mine"', 412), ('"7", "1"', 201)):
        answer = running.client.post(MACHINES, content=text, headers={"If-Match": tags})
        assert answer.status_code == status, (tags, answer.text)


def test_only_where_there_is_nothing_yet(running: Running) -> None:
    made = running.client.post(MACHINES, content=named("fresh"), headers={"If-None-Match": "*"})
    assert made.status_code == 201
    other = named("fresh").replace("velocity: 1.0", "velocity: 1.5")
    assert running.client.post(MACHINES, content=other, headers={"If-None-Match": "*"}).status_code == 412


def test_the_description_says_how_to_get_in_and_where(running: Running) -> None:
    told = running.client.get(f"{API}/openapi.json").json()
    assert told["components"]["securitySchemes"]["token"]["scheme"] == "bearer"
    assert told["servers"]
    assert {"token": []} in told["paths"][MACHINES]["get"]["security"]
    assert "security" not in told["paths"]["/healthz"]["get"]
    names = [own["operationId"] for path in told["paths"].values() for own in path.values()]
    assert len(set(names)) == len(names)
    assert {"machines.upload", "recordings.upload", "health.readyz"} <= set(names)


def test_every_body_has_an_example_that_is_taken(running: Running) -> None:
    told = running.client.get(f"{API}/openapi.json").json()
    bodies = [
        own["requestBody"]["content"]["application/json"]["schema"]["$ref"].rpartition("/")[2]
        for path in told["paths"].values()
        for own in path.values()
        if "application/json" in own.get("requestBody", {}).get("content", {})
    ]
    models = {model.__name__: model for model in models_of(BaseModel) if model.__module__.startswith("server.")}
    assert len(bodies) > 12
    for name in bodies:
        for example in told["components"]["schemas"][name]["examples"]:
            models[name].model_validate(example)


def models_of(model: type[BaseModel]) -> Iterator[type[BaseModel]]:
    for below in model.__subclasses__():
        yield below
        yield from models_of(below)


def test_a_stream_is_never_unchanged(running: Running) -> None:
    paths = running.client.get(f"{API}/openapi.json").json()["paths"]
    assert "304" not in paths[f"{API}/events"]["get"]["responses"]
    assert "304" in paths[MACHINES]["get"]["responses"]


def test_lists_are_narrowed_by_time_and_label(running: Running) -> None:
    running.client.post(MACHINES, content=named("listed"))
    wish = {"machine": "listed", "cron": "0 0 * * *"}
    made = running.client.post(f"{API}/schedules", json={**wish, "label": "Each 50 % night"}).json()
    for query, found in (
        ({"label": "50 %"}, True),
        ({"label": "each"}, True),
        ({"label": "5_ %"}, False),
        ({"since": made["created"]}, True),
        ({"until": made["created"]}, False),
        ({"since": "2999-01-01T00:00:00+02:00"}, False),
        ({"label": "night", "until": "2999-01-01T00:00:00Z", "machine": "listed"}, True),
    ):
        for path in ("schedules", "jobs", "excitations", "recordings", "identifications", "calibrations"):
            if path == "jobs":
                query = {key: value for key, value in query.items() if key != "machine"}
            answer = running.client.get(f"{API}/{path}", params=query)
            assert answer.status_code == 200, (path, query, answer.text)
            if path == "schedules":
                assert (made["id"] in [own["id"] for own in answer.json()["items"]]) is found, query
    assert running.client.get(f"{API}/jobs", params={"since": "2026-01-01T00:00:00"}).status_code == 422


@pytest.mark.parametrize("method", ["post", "put", "delete"])
def test_other_methods_stay_as_they_are(running: Running, method: str) -> None:
    assert running.client.request(method, f"{API}/effects", headers={"If-None-Match": "*"}).status_code == 405
