"""A server that goes and comes, a tablet that sleeps, a slow link, a stranger."""

from __future__ import annotations

import os
import re
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from lever_site import Site, wait_until
from service_fakes import MACHINE

pytestmark = pytest.mark.slow
LIVE = "Joint positions"
_COMMANDS = ("POST", "PUT", "DELETE", "PATCH")


@pytest.fixture
def own_site(tmp_path: Path, browser: Any) -> Iterator[Site]:
    """A site that this test may kill."""
    site = Site(tmp_path / "site")
    try:
        site.start()
        site.ask("POST", "/machines", content=MACHINE)
        site.ask("PUT", "/machines/lever/acquisition", json={"enabled": True})
        yield site
    finally:
        site.kill()


def commands_of(page: Any) -> list[str]:
    """What the page sends from now on that changes something."""
    sent: list[str] = []
    page.on("request", lambda request: sent.append(request.url) if request.method in _COMMANDS else None)
    return sent


def live_again(page: Any) -> None:
    page.locator(".live-title").get_by_text("Live", exact=True).last.wait_for()
    page.get_by_role("region", name=LIVE).get_by_text("fresh").wait_for()


def test_the_page_recovers_by_itself_from_a_restart_and_sends_nothing_again(page: Any, own_site: Site) -> None:
    page.forgiven += ["WebSocket connection", "ERR_CONNECTION", "ERR_INCOMPLETE", "ERR_EMPTY"]  # it cannot be helped
    page.goto(f"{own_site.url}/")
    live_again(page)
    page.get_by_role("button", name="Start recording").click()
    page.get_by_role("button", name="Stop recording").wait_for()
    sent = commands_of(page)
    own_site.kill()
    page.get_by_text(re.compile("No connection to the service")).wait_for()
    page.get_by_role("region", name=LIVE).get_by_text(re.compile("stale for")).wait_for()
    wait_until(page, page.get_by_role("button", name="Stop recording").is_disabled, True)
    own_site.start()
    live_again(page)
    page.get_by_text(re.compile("No connection to the service")).wait_for(state="detached")
    # The recording died with the server; the page says what is, not what it was about to do.
    page.get_by_role("button", name="Start recording").wait_for()
    assert sent == []


def test_a_command_whose_answer_is_lost_is_not_sent_again(page: Any, site: Site) -> None:
    page.goto(f"{site.url}/")
    live_again(page)
    page.forgiven.append("CONNECTION_RESET")
    sent = commands_of(page)
    before = len(site.ask("GET", "/recordings?limit=500")["items"])

    def lose_the_answer(route: Any) -> None:
        route.fetch()  # the service does it
        route.abort("connectionreset")

    page.route("**/api/v1/recordings", lose_the_answer, times=1)
    page.get_by_role("button", name="Start recording").click()
    page.get_by_text(re.compile("Unknown whether this was done")).wait_for()
    page.get_by_role("button", name="Stop recording").click()  # what is shown is read from the service
    page.get_by_role("button", name="Start recording").wait_for()
    assert [url.rpartition("/")[2] for url in sent] == ["recordings", "stop"]
    assert len(site.ask("GET", "/recordings?limit=500")["items"]) == before + 1


def test_a_tablet_that_slept_is_live_again(page: Any, browser: Any, site: Site) -> None:
    page.goto(f"{site.url}/")
    live_again(page)
    sent = commands_of(page)
    sockets: list[Any] = []
    page.on("websocket", lambda socket: sockets.append(socket))
    session = browser.new_browser_cdp_session()
    processes = session.send("SystemInfo.getProcessInfo")["processInfo"]
    pages = [process["id"] for process in processes if process["type"] == "renderer"]
    for pid in pages:
        os.kill(pid, signal.SIGSTOP)
    try:
        time.sleep(9)  # sleep itself is what is tested: the page has to find that its clock jumped
    finally:
        for pid in pages:
            os.kill(pid, signal.SIGCONT)
    if not sockets:
        page.wait_for_event("websocket")  # what the old one still held is of no use: a snapshot comes first
    live_again(page)
    assert sent == []


def test_a_slow_link_is_enough(page: Any, site: Site) -> None:
    session = page.context.new_cdp_session(page)
    session.send("Network.enable")
    slow = {"offline": False, "latency": 400, "downloadThroughput": 40_000, "uploadThroughput": 20_000}
    session.send("Network.emulateNetworkConditions", slow)
    page.goto(f"{site.url}/")
    live_again(page)
    page.get_by_role("button", name="Start recording").dblclick()  # impatience sends nothing twice
    page.get_by_role("button", name="Stop recording").click()
    page.get_by_role("button", name="Start recording").wait_for()
    assert site.ask("GET", "/recordings?state=recording")["items"] == []


def test_an_unknown_device_is_paired_by_the_address_of_the_code(browser: Any, tmp_path: Path) -> None:
    site = Site(tmp_path / "site", access="required")
    context = browser.new_context(viewport={"width": 800, "height": 1280})
    context.set_default_timeout(60_000)
    try:
        site.start()
        page = context.new_page()
        page.goto(f"{site.url}/")
        page.get_by_role("heading", name="Pair this device").wait_for()
        page.goto("about:blank")
        page.goto(f"{site.url}/#pair={site.first_code()}")
        assert not page.evaluate("isSecureContext && location.protocol === 'https:'")
        page.get_by_role("button", name="Pair").click()
        page.get_by_text(re.compile("Give the device a name")).wait_for()
        page.get_by_label("Name of this device").fill("tablet of the tests")
        page.get_by_role("button", name="Pair").click()
        page.get_by_role("heading", name="Live").wait_for()
        wait_until(page, lambda: "pair" in page.url, False)
        page.reload()  # the token stays on the device
        page.get_by_role("link", name=re.compile("Signed in as tablet of the tests, admin")).click()
        page.get_by_label("It may").select_option("viewer")
        page.get_by_role("button", name="Make a code").click()
        code = page.locator(".digits").inner_text().replace(" ", "")
        drawn = page.get_by_role("img", name=re.compile("QR code"))
        wait_until(page, lambda: drawn.evaluate("image => image.naturalWidth") > 50, True)

        other = browser.new_context()
        other.set_default_timeout(60_000)
        viewer = other.new_page()
        viewer.goto(f"{site.url}/#pair={code}")
        viewer.get_by_label("Name of this device").fill("viewer")
        viewer.get_by_role("button", name="Pair").click()
        viewer.get_by_role("link", name=re.compile("Signed in as viewer, viewer")).wait_for()

        page.get_by_role("button", name="End the session of viewer").click()
        page.get_by_role("dialog").get_by_role("button", name="End it").click()
        page.get_by_role("button", name="End the session of viewer").wait_for(state="detached")
        viewer.reload()
        viewer.get_by_role("heading", name="Pair this device").wait_for()
        other.close()

        # The last admin stays: nobody could let another device in.
        page.get_by_role("button", name=re.compile("Forget the service")).click()
        page.get_by_role("button", name="Forget it").click()
        page.get_by_text(re.compile("is the last admin")).wait_for()
        assert page.evaluate("localStorage.getItem('hilfit.token')") is not None
    finally:
        context.close()
        site.kill()


@pytest.mark.parametrize(
    ("language", "said", "offer"),
    [
        ("en", "The service was upgraded while this page was open", "Load the page again"),
        ("de", "Der Dienst wurde aktualisiert, während diese Seite offen war", "Seite neu laden"),
    ],
)
def test_a_view_of_the_old_version_after_an_upgrade(
    page: Any, site: Site, language: str, said: str, offer: str
) -> None:
    page.forgiven += ["404", "Failed to load resource"]
    page.add_init_script(f"localStorage.setItem('hilfit.language', '{language}')")
    page.route("**/assets/history-*.js", lambda route: route.fulfill(status=404, body="gone"))
    page.goto(f"{site.url}/")
    page.locator(".strip canvas").first.wait_for()
    page.route("**/index.html", lambda route: route.fulfill(body='<script src="./assets/page-n3wv3rsn.js"></script>'))
    page.evaluate("location.hash = '#/history'")
    page.get_by_role("alert").get_by_text(said).wait_for()
    page.unroute_all()
    page.get_by_role("button", name=offer).click()
    page.locator(".timeline, .empty").first.wait_for()
