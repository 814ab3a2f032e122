"""How soon the page shows live values to a slow tablet, and how many frames it drops while the machine moves."""

from __future__ import annotations

import time
from collections.abc import Callable
from statistics import median
from typing import Any

from benchmarks.page.browser import Tablet, chromium, tab
from benchmarks.page.site import Site, simulated
from benchmarks.targets import Check, Outcome

#: Seconds that a first view may take, and share of frames that may be dropped.
FIRST_VIEW_S, DROPPED = 1.0, 0.05
#: Numbers with the drawing beside them: the view is whole.
_SHOWN = (".number .value", ".strip canvas")
_PAINTED = "performance.getEntriesByName('first-contentful-paint')[0]?.startTime / 1000"


def run(tablet: Tablet, times: int, seconds: float, say: Callable[[str], None]) -> Outcome:
    """Measure both.

    Parameters
    ----------
    times : first views, each with an empty cache; their median counts
    seconds : of looking at the live view at 50 Hz
    """
    with simulated() as site, chromium() as browser:
        views = []
        for number in range(times):
            with tab(browser, tablet) as page:
                views.append(_first_view(page, site))
            say(f"view {number + 1}: painted {views[-1][0]:.2f} s, live values {views[-1][1]:.2f} s")
        with tab(browser, tablet) as page:
            smooth = _smoothness(page, site, seconds)
    device = f"{tablet.cpu:g} times slower than this computer, {tablet.megabits:g} Mbit/s, {tablet.latency_ms:g} ms"
    painted, live = (median(values) for values in zip(*views, strict=True))
    shown, dropped = smooth["frames"], smooth["dropped"]
    share = dropped / max(1.0, shown + dropped)
    words = f"{100 * share:.1f} % ({dropped:.0f} of {shown + dropped:.0f}), longest pause {smooth['longest']:.0f} ms"
    return Outcome(
        (
            Check("first view painted", painted, f"{painted:.2f} s", "at most", FIRST_VIEW_S, f"{FIRST_VIEW_S:g} s"),
            Check("plots and numbers live", live, f"{live:.2f} s"),
            Check(
                "frames dropped at 50 Hz",
                share,
                words,
                "at most",
                DROPPED,
                f"{100 * DROPPED:g} %",
            ),
            Check("plots drawn", smooth["rate"], f"{smooth['rate']:.1f} times a second"),
        ),
        notes=(f"a tablet of {tablet.width} x {tablet.height}, {device}",),
    )


def _first_view(page: Any, site: Site) -> tuple[float, float]:
    """Seconds until something is painted, and until plots and numbers are there, from the request on."""
    start = time.monotonic()
    page.goto(f"{site.url}/", wait_until="commit")
    for part in _SHOWN:
        page.locator(part).first.wait_for(state="attached")
    return float(page.evaluate(_PAINTED)), time.monotonic() - start


def _smoothness(page: Any, site: Site, seconds: float) -> dict[str, float]:
    """What the page's own diagnostics say, the worst of the windows of ten seconds."""
    page.goto(f"{site.url}/#/live")
    for part in _SHOWN:
        page.locator(part).first.wait_for()
    page.get_by_text("How smoothly this device draws").click()
    found: list[dict[str, float]] = []
    until = time.monotonic() + seconds
    while time.monotonic() < until or not found:
        time.sleep(11)  # longer than its window
        place = page.locator("[data-frames]")
        found.append(
            {name: float(place.get_attribute(f"data-{name}")) for name in ("frames", "dropped", "longest", "rate")}
        )
    return max(found, key=lambda one: one["dropped"])
