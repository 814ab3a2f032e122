"""Errors are problem documents (RFC 9457) on every path, and say nothing that belongs in the log."""

from __future__ import annotations

from typing import Any

import pytest
from service_fakes import API, Running

from daq.messages import message_from_json
from server.jobs.job_store import Jobs
from server.platform.http.problems import status_phrase


def test_names_of_statuses_are_those_of_the_interface_whichever_python_runs() -> None:
    """Python 3.13 renamed some with RFC 9110; types of problems and the OpenAPI file are made of them."""
    released = {
        404: "Not Found",
        413: "Request Entity Too Large",
        414: "Request-URI Too Long",
        416: "Requested Range Not Satisfiable",
        422: "Unprocessable Entity",
    }
    assert {status: status_phrase(status) for status in released} == released


def problem(response: Any, status: int) -> dict[str, Any]:
    assert response.status_code == status, response.text
    assert response.headers["content-type"] == "application/problem+json"
    document = dict(response.json())
    assert document["status"] == status
    assert document["type"].startswith("urn:hilfit:problem:")
    assert document["title"]
    assert "\n" not in document["detail"]
    return document


@pytest.mark.parametrize(
    ("method", "path", "status"),
    [
        ("GET", f"{API}/nothing", 404),
        ("GET", f"{API}/machines/absent", 404),
        ("GET", f"{API}/machines/absent/file", 404),
        ("GET", f"{API}/recordings/absent", 404),
        ("GET", f"{API}/recordings/absent/data", 404),
        ("POST", f"{API}/recordings/absent/stop", 404),
        ("DELETE", f"{API}/recordings/absent", 404),
        ("GET", f"{API}/identifications/absent", 404),
        ("GET", f"{API}/identifications/absent/report.json", 404),
        ("GET", f"{API}/jobs/absent", 404),
        ("GET", f"{API}/jobs/absent/events", 404),
        ("POST", f"{API}/jobs/absent/cancel", 404),
        ("GET", f"{API}/live?machine=absent", 404),
        ("GET", f"{API}/live?machine=%0D%0A", 404),
        ("DELETE", f"{API}/machines", 405),
        ("PATCH", f"{API}/jobs", 405),
        ("GET", f"{API}/jobs?limit=0", 422),
        ("GET", f"{API}/jobs?state=bored", 422),
        ("GET", f"{API}/machines?cursor=-1", 422),
        ("POST", f"{API}/identifications", 422),
        ("POST", f"{API}/recordings/upload", 422),
    ],
)
def test_every_error_is_a_problem_document(running: Running, method: str, path: str, status: int) -> None:
    document = problem(running.client.request(method, path), status)
    assert document["instance"] == path.partition("?")[0]


def test_programs_are_told_by_code_and_values(running: Running) -> None:
    """Sentences may be worded anew; a program reads these."""
    absent = problem(running.client.get(f"{API}/jobs/absent"), 404)
    assert (absent["code"], absent["values"]) == ("not_found", {"job": "absent"})
    machine = problem(running.client.get(f"{API}/machines/absent"), 404)
    assert (machine["code"], machine["values"]) == ("not_found", {"machine": "absent"})
    nowhere = problem(running.client.get(f"{API}/nothing"), 404)
    assert (nowhere["code"], nowhere["values"]) == ("not_found", {})
    wrong = problem(running.client.get(f"{API}/jobs?limit=0"), 422)
    assert (wrong["code"], wrong["errors"][0]["code"]) == ("invalid", "greater_than_equal")


def test_a_body_that_is_no_json_names_the_place(running: Running) -> None:
    response = running.client.post(f"{API}/identifications", content="{", headers={"content-type": "application/json"})
    assert problem(response, 422)["errors"]


def test_an_unknown_key_is_named(running: Running) -> None:
    response = running.client.post(f"{API}/recordings", json={"machine": "a", "role": "train", "secs": 3})
    assert "secs" in problem(response, 422)["detail"]


def test_a_request_that_says_it_is_too_large_is_refused_unread(running: Running) -> None:
    response = running.client.post(f"{API}/machines", content=b" " * (2**20 + 1))
    assert "1048576 bytes" in problem(response, 413)["detail"]


def test_a_request_that_does_not_say_its_size_is_stopped_at_the_limit(running: Running) -> None:
    pieces = (b" " * 2**18 for _ in range(5))  # chunked: no Content-Length
    problem(running.client.post(f"{API}/machines", content=pieces), 413)


def test_an_unexpected_error_says_nothing_about_the_inside(running: Running, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise RuntimeError("/secret/path")

    monkeypatch.setattr(running.service[Jobs], "list", fail)
    document = problem(running.client.get(f"{API}/jobs"), 500)
    assert "secret" not in str(document)


def test_a_store_that_is_gone_is_503(running: Running, monkeypatch: pytest.MonkeyPatch) -> None:
    import sqlalchemy as sa

    def fail() -> None:
        raise sa.exc.OperationalError("SELECT", {}, Exception("disk I/O error"))

    monkeypatch.setattr(running.service.database, "check", fail)
    problem(running.client.get("/healthz"), 503)


def test_a_database_that_is_read_only_is_503_whatever_the_driver_calls_it(
    running: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    import sqlalchemy as sa

    def fail(*_: object, **__: object) -> None:
        # psycopg has ReadOnlySqlTransaction below InternalError.
        raise sa.exc.InternalError("INSERT", {}, Exception("read-only"), connection_invalidated=True)

    monkeypatch.setattr(running.service[Jobs], "list", fail)
    answer = running.client.get(f"{API}/jobs")
    assert "read-only" in str(problem(answer, 503))
    assert answer.headers["retry-after"] == "5"


def test_health_and_headers(running: Running) -> None:
    response = running.client.get("/healthz")
    assert response.json() == {"status": "ok"}
    assert response.headers["x-content-type-options"] == "nosniff"


@pytest.mark.slow
def test_openapi_tells_of_problem_documents(running: Running) -> None:
    paths = running.client.get(f"{API}/openapi.json").json()["paths"]
    for path, methods in paths.items():
        for method, operation in methods.items():
            for status, response in operation["responses"].items():
                if status >= "400":
                    assert list(response["content"]) == ["application/problem+json"], (path, method, status)


@pytest.mark.parametrize(
    "headers",
    [
        {"origin": "https://elsewhere.example"},
        {"origin": "http://127.0.0.1:9999"},
        {"origin": "null"},
        {"host": "elsewhere.example"},
        {"host": "127.0.0.1.elsewhere.example"},
    ],
)
def test_pages_from_elsewhere_are_refused(running: Running, headers: dict[str, str]) -> None:
    problem(running.client.get(f"{API}/machines", headers=headers), 403)


@pytest.mark.slow
@pytest.mark.parametrize(
    "headers",
    [{"origin": "http://127.0.0.1:8350"}, {"host": "localhost:80"}, {"host": "[::1]:8350"}, {"host": "127.0.0.1"}],
)
def test_requests_of_the_own_page_and_of_programs_are_answered(running: Running, headers: dict[str, str]) -> None:
    assert running.client.get(f"{API}/machines", headers=headers).status_code == 200


@pytest.mark.parametrize(
    "headers",
    [
        {"origin": "https://127.0.0.1:8350"},  # another origin than that of a service on http
        {"origin": "127.0.0.1:8350"},
        {"sec-fetch-site": "cross-site"},
        {"sec-fetch-site": "same-site"},
    ],
)
def test_a_change_that_a_page_from_elsewhere_asks_for_is_refused(running: Running, headers: dict[str, str]) -> None:
    problem(running.client.post(f"{API}/recordings", json={}, headers=headers), 403)


def test_a_link_from_elsewhere_to_our_page_works(running: Running) -> None:
    headers = {"sec-fetch-site": "cross-site", "sec-fetch-mode": "navigate"}
    assert running.client.get(f"{API}/machines", headers=headers).status_code == 200
    own = {"origin": "http://127.0.0.1:8350", "sec-fetch-site": "same-origin"}
    assert running.client.post(f"{API}/recordings", json={}, headers=own).status_code == 422


@pytest.mark.parametrize(
    "text", ["a\u0000b", "a\u202eb", "a\u200bb", "a\u2066b", "line\nbreak", "\ufeffa", "\u009b31m"]
)
def test_words_that_read_otherwise_than_they_are_written_are_refused(running: Running, text: str) -> None:
    wish = {"machine": "x", "role": "train", "label": text}
    document = problem(running.client.post(f"{API}/recordings", json=wish), 422)
    assert document["detail"].startswith("body.label")
    assert running.client.post(f"{API}/recordings", json={**wish, "label": "Käfig 3, öl/über 40 °C"}).status_code == 404


def test_what_a_text_was_made_of_stands_beside_it(running: Running) -> None:
    absent = problem(running.client.get(f"{API}/jobs/absent"), 404)
    assert absent["message"] == {"code": "server.none_job", "values": {"id": "absent"}}
    assert message_from_json(absent["message"]).worded("de") == "Es gibt keinen Auftrag „absent“"
    wrong = problem(running.client.get(f"{API}/jobs?limit=0"), 422)
    (entry,) = wrong["errors"]
    assert entry["message"] == {"code": "daq.value_greater_than_equal", "values": {"ge": 1}}
    assert message_from_json(wrong["message"]) == wrong["detail"] == f"{entry['place']}: {entry['text']}"
    file = problem(running.client.post(f"{API}/machines/check", content="schema: [}"), 422)  # worded in a child
    assert message_from_json(file["message"]) == file["detail"]
