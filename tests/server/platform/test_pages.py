"""The page's files: what is served, how long browsers keep it, and that what was built is what the sources say."""

from __future__ import annotations

import hashlib
import json
import re
import tomllib
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest
from service_fakes import API, Fakes, Running
from starlette.testclient import TestClient

from server.composition.app import create_app
from server.composition.declarations import RESOURCES
from server.platform.http.pages import page_files
from server.platform.service import Service
from server.platform.settings import Settings

ROOT = Path(__file__).parents[3]
WEB = ROOT / "server" / "web"
BUILT = page_files()
ASSETS = sorted(name for name in BUILT if name.startswith("assets/"))


def test_the_page_is_at_the_root_and_asked_for_each_time(running: Running) -> None:
    response = running.client.get("/")
    assert response.status_code == 200
    assert response.headers["content-type"] == "text/html; charset=utf-8"
    assert response.headers["cache-control"] == "no-cache"
    assert response.text == running.client.get("/index.html").text
    again = running.client.get("/", headers={"If-None-Match": response.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")
    assert running.client.get("/", headers={"If-None-Match": f'"x", W/{response.headers["etag"]}'}).status_code == 304
    assert running.client.get("/", headers={"If-None-Match": '"x"'}).status_code == 200


def test_the_page_loads_only_files_that_are_there_and_runs_nothing_of_its_own(running: Running) -> None:
    html = running.client.get("/").text
    named = re.findall(r'(?:src|href)="([^"]*)"', html)
    assert len(named) >= 3  # a script, a style sheet, an icon
    for name in named:
        assert name.startswith("./")
        assert running.client.get(name.removeprefix(".")).status_code == 200
    assert re.findall(r"<script(?![^>]*\bsrc=)", html) == []
    assert "<style" not in html and " on" + "click" not in html


def test_files_with_a_hash_in_their_name_are_cached_for_ever(running: Running) -> None:
    assert ASSETS
    for name in ASSETS:
        assert re.search(r"-[\w-]{8}\.\w+$", name)
        response = running.client.get(f"/{name}", headers={"Accept-Encoding": "identity"})
        assert response.headers["cache-control"] == "public, max-age=31536000, immutable"
        assert response.content == BUILT[name].content


def test_texts_have_names_without_a_hash_and_are_asked_for_each_time(running: Running) -> None:
    """So a text that changes renames nothing: what loads it is the same file as before."""
    texts = [name for name in BUILT if name.startswith("texts/")]
    assert texts == ["texts/said_de.js", "texts/words.js"]
    for name in texts:
        response = running.client.get(f"/{name}")
        assert response.headers["cache-control"] == "no-cache"
        assert running.client.get(f"/{name}", headers={"If-None-Match": response.headers["etag"]}).status_code == 304
        assert not re.search(rb"/assets/|-[\w-]{8}\.js", BUILT[name].content), "it depends on no other file"
    loading = [name for name in ASSETS if b"texts/" in BUILT[name].content]
    assert loading


def test_files_are_compressed_for_who_takes_it(running: Running) -> None:
    script = next(name for name in ASSETS if name.endswith(".js"))
    packed = running.client.get(f"/{script}", headers={"Accept-Encoding": "br, gzip;q=0.5"})
    assert packed.headers["content-encoding"] == "gzip"
    assert packed.headers["vary"] == "Accept-Encoding"
    assert int(packed.headers["content-length"]) < len(BUILT[script].content) / 2
    for refused in ("identity", "gzip;q=0", "br"):
        plain = running.client.get(f"/{script}", headers={"Accept-Encoding": refused})
        assert "content-encoding" not in plain.headers
        assert plain.content == packed.content


def test_the_policy_lets_the_page_load_its_own_files_only(running: Running) -> None:
    policy = dict(part.split(" ", 1) for part in running.client.get("/").headers["content-security-policy"].split("; "))
    assert policy["default-src"] == "'none'"
    assert policy["script-src"] == "'self'"
    assert policy["connect-src"] == "'self'"
    assert policy["frame-ancestors"] == "'none'"


@pytest.mark.parametrize("path", ["/nowhere", "/assets/nothing.js", "/404.html", "/assets/", "/live", "/%2e%2e/app.py"])
def test_what_is_not_there_is_told_by_the_page(running: Running, path: str) -> None:
    response = running.client.get(path)
    assert response.status_code == 404
    assert response.headers["content-type"].startswith("text/html")
    assert "There is no such page" in response.text


@pytest.mark.parametrize("path", [f"{API}/nowhere", "/api/", "/metrics/nowhere", "/healthz/nowhere"])
def test_programs_get_a_problem_document(running: Running, path: str) -> None:
    response = running.client.get(path)
    assert response.status_code == 404
    assert response.headers["content-type"] == "application/problem+json"


def test_the_page_is_only_read(running: Running) -> None:
    for method in ("POST", "PUT", "DELETE"):
        response = running.client.request(method, "/")
        assert response.status_code == 405
        assert response.headers["allow"] == "GET, HEAD"
    assert running.client.head("/").status_code == 200
    # The page answers behind the routes, so what they refuse stays theirs.
    assert running.client.patch(f"{API}/machines").status_code == 405


def test_clients_without_a_token_get_the_page_but_nothing_else(tmp_path: Path) -> None:
    service = Service(Settings(data_dir=tmp_path, access="required"), RESOURCES, Fakes().parts)
    try:
        client = TestClient(create_app(service), "http://192.168.7.4:8350")
        assert client.get("/").status_code == 200
        assert client.get(f"/{ASSETS[0]}").status_code == 200
        assert client.get(f"{API}/machines").status_code == 401
    finally:
        service.stop()


def test_the_built_files_are_package_data_and_the_sources_are_not() -> None:
    setuptools = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
    patterns = setuptools["package-data"]["server"]
    packed = {path for pattern in patterns for path in (ROOT / "server").glob(pattern) if path.is_file()}
    assert packed == {WEB / "dist" / name for name in BUILT}
    # Any folder may be a package to setuptools; those of the sources (and of Node) are none.
    assert "server.web*" in setuptools["packages"]["find"]["exclude"]
    assert (files("server") / "web" / "dist" / "index.html").is_file()


def test_the_built_page_is_of_these_sources() -> None:
    hashed = hashlib.sha256()
    for name in _sources():
        hashed.update(name.encode() + b"\0" + (WEB / name).read_bytes() + b"\0")
    assert json.loads(BUILT["sources.json"].content) == {"sha256": hashed.hexdigest()}, (
        "run 'make generated' and commit what it made"
    )


@pytest.mark.slow
def test_the_lock_file_names_no_registry() -> None:
    lock: dict[str, Any] = json.loads((WEB / "package-lock.json").read_text())
    assert not [name for name, entry in lock["packages"].items() if "resolved" in entry]


def _sources() -> list[str]:
    """All that the page is made of, from its folder: what others make for it, too, but for what is made of that."""
    found = [
        path.relative_to(WEB).as_posix()
        for folder in ("src", "public")
        for path in (WEB / folder).rglob("*")
        if path.is_file() and ".test." not in path.name and ".gen." not in path.name
    ]
    named = ("index.html", "package-lock.json", "package.json", "scripts/types.mjs", "tsconfig.json", "vite.config.ts")
    texts = (f"{room}/texts/de.json" for room in ("daq", "fitting", "sim_backends"))
    shared = ("docs/openapi.json", "docs/report.schema.json", *texts)
    return sorted([*found, *named, "../texts/de.json", *(f"../../{name}" for name in shared)])
