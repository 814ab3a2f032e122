"""A browser of the system and a site for it; without either these tests are skipped with the reason."""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

# What serves and what is served is shared with the tests of the server.
sys.path.insert(0, str(Path(__file__).parents[1] / "server"))

from lever_site import Site
from service_fakes import MACHINE

ARGUMENTS = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking"]
#: ms; two busy cores draw slowly, and a test that passes does not wait for it.
PATIENCE_MS = 60_000
LANDSCAPE, PORTRAIT = {"width": 1280, "height": 800}, {"width": 800, "height": 1280}


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Chromium of the system, driven by Playwright."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed (extra 'test')")
    executable = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if executable is None:
        pytest.skip("no chromium on this computer; on Debian: apt-get install chromium")
    # A folder of its own: what Chromium leaves when it is ended on a busy computer is not left by a test.
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as own, playwright.sync_playwright() as started:
        environment = os.environ | {"TMPDIR": own}
        browser = started.chromium.launch(executable_path=executable, args=ARGUMENTS, env=environment)
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory, browser: Any) -> Iterator[Site]:
    """A site with the lever, acquired, open to this computer."""
    site = Site(tmp_path_factory.mktemp("site"))
    try:
        site.start()
        site.ask("POST", "/machines", content=MACHINE)
        site.ask("PUT", "/machines/lever/acquisition", json={"enabled": True})
        yield site
    finally:
        site.kill()


@pytest.fixture
def page(browser: Any, site: Site) -> Iterator[Any]:
    """A tab; whatever it complains about fails the test, unless a part of it is in ``page.forgiven``."""
    context = browser.new_context(viewport=LANDSCAPE)
    context.set_default_timeout(PATIENCE_MS)
    page = context.new_page()
    complaints: list[str] = []
    page.forgiven = []
    page.on("console", lambda said: complaints.append(said.text) if said.type in ("error", "warning") else None)
    page.on("pageerror", lambda error: complaints.append(str(error)))
    yield page
    context.close()
    assert [said for said in complaints if not any(part in said for part in page.forgiven)] == []
