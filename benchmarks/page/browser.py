"""Chromium of the system, slowed down as a tablet is."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from daq.errors import InputError

ARGUMENTS = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking"]


@dataclass(frozen=True)
class Tablet:
    """How slow a device and its network are.

    Attributes
    ----------
    cpu : how many times longer it computes than this computer
    megabits, latency_ms : of its network, each way, and there and back
    width, height : CSS pixels
    """

    cpu: float = 4.0
    megabits: float = 10.0
    latency_ms: float = 40.0
    width: int = 800
    height: int = 1280


@contextmanager
def chromium() -> Iterator[Any]:
    """Start a browser.

    Raises
    ------
    InputError
        If playwright or chromium is not installed.
    """
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        raise InputError("playwright is not installed; pip install -e '.[test]'") from None
    executable = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if executable is None:
        raise InputError("no chromium on this computer; on Debian: apt-get install chromium")
    with sync_playwright() as started:
        browser = started.chromium.launch(executable_path=executable, args=ARGUMENTS)
        try:
            yield browser
        finally:
            browser.close()


@contextmanager
def tab(browser: Any, tablet: Tablet) -> Iterator[Any]:
    """Open a tab with an empty cache, as slow as ``tablet``."""
    context = browser.new_context(viewport={"width": tablet.width, "height": tablet.height})
    context.set_default_timeout(120_000)
    try:
        page = context.new_page()
        session = context.new_cdp_session(page)
        session.send("Network.enable")
        bytes_per_s = tablet.megabits * 1e6 / 8
        session.send(
            "Network.emulateNetworkConditions",
            {
                "offline": False,
                "latency": tablet.latency_ms,
                "downloadThroughput": bytes_per_s,
                "uploadThroughput": bytes_per_s,
            },
        )
        session.send("Emulation.setCPUThrottlingRate", {"rate": tablet.cpu})
        yield page
    finally:
        context.close()
