"""Below a path of a reverse proxy: page, interface, streams, links and printed addresses, behind real sockets."""

from __future__ import annotations

import asyncio
import json
import re
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from shutil import which

import httpx2
import pytest
from acquired_machines import named
from service_fakes import API, Fakes, running_service
from websockets.sync.client import connect

from server.platform.errors import StartError
from server.platform.settings import load_settings

BASE = "/hilfit"
#: s that an answer may take on a busy computer.
LONG_S = 120.0
get = partial(httpx2.get, timeout=LONG_S)
post = partial(httpx2.post, timeout=LONG_S)


class Proxy:
    """Passes connections below one path on to a service, as a small reverse proxy does; 404 for all others.

    The head of each connection's first request is rewritten, the rest is passed on in both directions, so it serves
    one request a connection, WebSockets and streams included.
    """

    def __init__(self, port: int, strips: bool) -> None:
        self._to, self._strips = port, strips
        self.port = 0

    async def _one(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        head = (await reader.readuntil(b"\r\n\r\n")).decode("latin-1")
        line, _, headers = head.partition("\r\n")
        method, target, version = line.split(" ")
        refused = "" if target.startswith(BASE) else "404 Not Found\r\n"
        if target == BASE and self._strips:  # who takes the path off says where it begins
            refused = f"308 Permanent Redirect\r\nLocation: {BASE}/\r\n"
        if refused:
            writer.write(f"HTTP/1.1 {refused}Content-Length: 0\r\nConnection: close\r\n\r\n".encode())
            writer.close()
            return
        if self._strips:
            target = target.removeprefix(BASE) or "/"
        if "upgrade:" not in headers.lower():
            headers = re.sub(r"(?im)^connection:.*\r\n", "", headers)
            headers = f"Connection: close\r\n{headers}"
        up_reader, up_writer = await asyncio.open_connection("127.0.0.1", self._to)
        up_writer.write(f"{method} {target} {version}\r\n{headers}".encode("latin-1"))
        await asyncio.gather(_pass(reader, up_writer), _pass(up_reader, writer))

    @contextmanager
    def running(self) -> Iterator[str]:
        """Serve in a thread; the address of the proxied service."""
        loop, up = asyncio.new_event_loop(), threading.Event()

        async def main() -> None:
            server = await asyncio.start_server(self._one, "127.0.0.1", 0)
            self.port = server.sockets[0].getsockname()[1]
            up.set()
            async with server:
                await stopped

        stopped: asyncio.Future[None] = loop.create_future()
        thread = threading.Thread(target=lambda: loop.run_until_complete(main()))
        thread.start()
        assert up.wait(30)
        try:
            yield f"http://127.0.0.1:{self.port}{BASE}"
        finally:
            loop.call_soon_threadsafe(stopped.set_result, None)
            thread.join(30)
            for task in asyncio.all_tasks(loop):
                task.cancel()
            loop.run_until_complete(asyncio.sleep(0.05))
            loop.close()


async def _pass(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    try:
        while data := await reader.read(65536):
            writer.write(data)
            await writer.drain()
    except OSError:
        pass
    finally:
        writer.close()


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, int]]:
    """A process of its own below the path: what its first line says, and its port."""
    data = tmp_path_factory.mktemp("data")
    words = [sys.executable, "-P", "-m", "server.commands.command_line", "serve", "--port", "0", "--json"]
    words += ["--data-dir", str(data), "--base-path", BASE]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        url = json.loads(process.stdout.readline())["url"]
        yield url, int(url.removesuffix(BASE).rpartition(":")[2])
        process.terminate()
        process.wait(60)


@pytest.fixture(scope="module", params=["stripping", "passing on"])
def proxied(service: tuple[str, int], request: pytest.FixtureRequest) -> Iterator[str]:
    """The address behind a proxy that cuts the path off, and behind one that leaves it."""
    with Proxy(service[1], request.param == "stripping").running() as url:
        yield url


@pytest.mark.slow
def test_the_printed_address_is_below_the_path_and_answers(service: tuple[str, int]) -> None:
    url, _ = service
    assert url.endswith(BASE)
    assert get(f"{url}{API}/status").json()["version"]


@pytest.mark.slow
def test_the_page_and_all_its_files_come_from_below(proxied: str) -> None:
    bare = get(proxied)
    assert (bare.status_code, bare.headers["location"]) == (308, f"{BASE}/")
    page = get(f"{proxied}/")
    assert page.status_code == 200
    files = re.findall(r'(?:src|href)="([^"#]+)"', page.text)
    assert any(name.endswith(".js") for name in files)
    for name in files:
        found = httpx2.URL(f"{proxied}/").join(name)
        assert found.path.startswith(f"{BASE}/"), name
        assert get(found).status_code == 200, name
    absent = get(f"{proxied}/deep/in/nowhere")
    assert absent.status_code == 404
    assert set(re.findall(r'href="([^"]+)"', absent.text)) == {f"{BASE}/", f"{BASE}/icon.svg"}


@pytest.mark.slow
def test_links_lead_back_below_the_path(proxied: str) -> None:
    name = f"below-{proxied.rpartition(':')[2].partition('/')[0]}"
    made = post(f"{proxied}{API}/machines", content=named(name))
    assert (made.status_code, made.headers["location"]) == (201, f"{BASE}{API}/machines/{name}")
    assert get(httpx2.URL(proxied).join(made.headers["location"])).json()["name"] == name
    again = get(f"{proxied}{API}/machines/")
    assert httpx2.URL(again.headers["location"]).path == f"{BASE}{API}/machines"
    refused = get(f"{proxied}{API}/machines/nowhere")
    assert (refused.status_code, refused.json()["instance"]) == (404, f"{BASE}{API}/machines/nowhere")
    code = post(f"{proxied}{API}/access/pairing-codes", json={"role": "viewer"}).json()
    assert code["url"].startswith(f"{proxied}/#pair=")
    assert get(f"{proxied}{API}/openapi.json").json()["servers"][0]["url"] == BASE


@pytest.mark.slow
def test_streams_pass_the_proxy(proxied: str) -> None:
    with httpx2.stream("GET", f"{proxied}{API}/events", timeout=LONG_S) as events:
        first = next(line for line in events.iter_lines() if line.startswith("data: "))
    assert "revision" in json.loads(first.removeprefix("data: "))
    place = proxied.replace("http:", "ws:")
    post(f"{proxied}{API}/machines", content=named("streamed"))
    with connect(f"{place}{API}/live/stream?machine=streamed", open_timeout=LONG_S) as socket:
        assert json.loads(socket.recv())["type"] == "snapshot"


@pytest.mark.slow
@pytest.mark.skipif(which("chromium") is None, reason="there is no chromium")
def test_a_browser_shows_the_page_with_what_the_service_says(proxied: str) -> None:
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=15000", "--dump-dom"]
    shown = subprocess.run(
        ["chromium", *options, f"{proxied}/"], capture_output=True, text=True, check=True, timeout=240
    ).stdout
    assert 'href="#' in shown  # the page's own links: it was drawn
    assert "this computer" in shown  # who asks, as the interface below the path says


@pytest.mark.slow
def test_without_a_proxy_nothing_changes(tmp_path: Path) -> None:
    with running_service(tmp_path, Fakes()) as running:
        assert running.client.get(f"{BASE}{API}/status").status_code == 404
        assert running.client.get(f"{API}/openapi.json").json()["servers"][0]["url"] == "/"


@pytest.mark.parametrize("path", ["hilfit", "/hilfit/", "//evil", "/a b", "/a/../b", "/ä", "/x?y"])
def test_what_is_no_path_is_refused_in_one_line(path: str) -> None:
    with pytest.raises(StartError, match="--base-path: "):
        load_settings(base_path=path)
