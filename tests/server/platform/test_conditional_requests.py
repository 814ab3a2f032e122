"""What clients ask under a condition: HEAD, If-None-Match, If-Match with several tags, If-None-Match: *."""

from __future__ import annotations

import pytest
from acquired_machines import MACHINES, named
from service_fakes import API, Running


def test_head_is_get_without_a_body(running: Running) -> None:
    running.client.post(MACHINES, content=named("head"))
    for path in ("/healthz", MACHINES, f"{MACHINES}/head", f"{MACHINES}/head/file", f"{API}/openapi.json"):
        whole, head = running.client.get(path), running.client.head(path)
        assert (head.status_code, head.content) == (200, b""), path
        assert head.headers["content-length"] == str(len(whole.content)) == whole.headers["content-length"], path
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


@pytest.mark.parametrize("method", ["post", "put", "delete"])
def test_other_methods_stay_as_they_are(running: Running, method: str) -> None:
    assert running.client.request(method, f"{API}/effects", headers={"If-None-Match": "*"}).status_code == 405
