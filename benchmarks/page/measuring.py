"""Time until the page shows live values to a slow tablet, frames that it drops, and pictures of every view."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any

import yaml

from benchmarks.page.site import START_S, Site, Tablet, chromium, furnish, simulated, tab
from benchmarks.targets import Check, Outcome, Show, fact, figure
from daq.errors import InputError

#: Seconds that a first view may take, and share of frames that may be dropped.
FIRST_VIEW_S, DROPPED = 1.0, 0.05
#: Numbers with the drawing beside them: the view is whole.
_SHOWN = (".number .value", ".strip canvas")
#: Seconds between two questions whether it is.
_ASKED_S = 0.05
#: Seconds of each floor.
_FLOOR_S = 8.0
#: What notes when the page is painted first, and a page without us.
_FIRST_VIEW, _EMPTY = (Path(__file__).with_name(f"{name}.js") for name in ("first_view", "empty"))


def run(tablet: Tablet, times: int, seconds: float, show: Show) -> Outcome:
    """Measure both."""
    with simulated() as site, chromium() as browser:
        views = []
        for number in range(times):
            with tab(browser, tablet) as page:
                views.append(_first_view(page, site))
            show(f"view {number + 1}: painted {views[-1][0]:.2f} s, live values {views[-1][1]:.2f} s")
        floors = []
        for drawn in (False, True):
            with tab(browser, tablet) as page:
                floors.append(_floor(page, drawn))
        with tab(browser, tablet) as page:
            smooth = _smoothness(page, site, seconds)
    device = f"{tablet.cpu:g} times slower than this computer, {tablet.megabits:g} Mbit/s, {tablet.latency_ms:g} ms"
    painted, live = (median(values) for values in zip(*views, strict=True))
    shown, dropped = smooth["frames"], smooth["dropped"]
    share = dropped / max(1.0, shown + dropped)
    words = f"{100 * share:.1f} % ({dropped:.0f} of {shown + dropped:.0f}), longest pause {smooth['longest']:.0f} ms"
    return Outcome(
        (
            figure("first view painted", painted, "{:.2f} s", most=FIRST_VIEW_S),
            figure("plots and numbers live", live, "{:.2f} s"),
            Check("frames dropped at 50 Hz", share, words, "at most", DROPPED, f"{100 * DROPPED:g} %"),
            figure("plots drawn", smooth["rate"], "{:.1f} times a second"),
        ),
        notes=(
            f"a tablet of {tablet.width} x {tablet.height}, {device}",
            "the service goes before it on this computer, where that is allowed",
            f"beside it an empty page dropped {100 * floors[0]:.1f} % of its frames, one with a single canvas "
            f"{100 * floors[1]:.1f} %; load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores",
        ),
    )


def _first_view(page: Any, site: Site) -> tuple[float, float]:
    """Time until the page with its header is painted, and until plots and numbers are there, s from the request.

    It is asked over the devtools protocol: a locator of playwright puts a script of 330 kB into the page first, which
    took a tenth of a second of the slowed-down processor.
    """
    page.add_init_script(path=_FIRST_VIEW)
    session = page.context.new_cdp_session(page)
    shown = " && ".join(f"document.querySelector({json.dumps(part)}) !== null" for part in _SHOWN)
    asked = {"expression": f"[window.firstView ?? null, {shown}]", "returnByValue": True}
    start = time.monotonic()
    page.goto(f"{site.url}/", wait_until="commit")
    while True:
        painted, live = session.send("Runtime.evaluate", asked)["result"]["value"]
        now = time.monotonic() - start
        if live and painted is not None:
            return float(painted), now
        if now > START_S:
            raise InputError(f"{site.url} shows no live values after {START_S:g} s; try again on a less busy computer")
        time.sleep(_ASKED_S)


def _floor(page: Any, drawn: bool) -> float:
    """Measure the share of frames that a page without us drops: nothing in it could be better."""
    page.goto("about:blank")
    page.evaluate(_EMPTY.read_text(encoding="utf-8"), drawn)
    time.sleep(_FLOOR_S)
    times = page.evaluate("window.times")[5:]
    gaps = [later - earlier for earlier, later in pairwise(times)]
    dropped = sum(max(0, round(gap * 60 / 1000) - 1) for gap in gaps)
    return float(dropped / max(1, dropped + len(gaps)))


def _smoothness(page: Any, site: Site, seconds: float) -> dict[str, float]:
    """Read the page's own diagnostics, the worst of the windows of ten seconds."""
    page.goto(f"{site.url}/#/live")
    for part in _SHOWN:
        page.locator(part).first.wait_for()
    page.get_by_text("How smoothly this device draws").click()
    found: list[dict[str, float]] = []
    until = time.monotonic() + seconds
    while time.monotonic() < until or not found:
        time.sleep(11)  # longer than its window
        place = page.locator("[data-frames]")
        names = ("frames", "dropped", "longest", "rate")
        found.append({name: float(place.get_attribute(f"data-{name}")) for name in names})
    return max(found, key=lambda one: one["dropped"])


SIZES = ((800, 1280), (1280, 800), (1440, 900))
SCHEMES = ("light", "dark")
LANGUAGES = ("en", "de")


@dataclass(frozen=True)
class _View:
    """A view: its address with what it is of, what is there when it is whole, what is pressed first, by language."""

    address: str
    whole: str
    pressed: Mapping[str, str] | None = None


#: Views by name, in the order of the pictures.
VIEWS = {
    name: _View(**own)
    for name, own in yaml.safe_load(Path(__file__).with_name("views.yaml").read_text(encoding="utf-8")).items()
}
#: What sticks out of the page sideways.
_WIDER = "document.documentElement.scrollWidth - document.documentElement.clientWidth"


def pictures(target: Path, only: str | None, show: Show, language: str = "en") -> Outcome:
    """Make them in a directory, in a language of the page; each check is that a view fits its screen."""
    suffix = "" if language == "en" else f"-{language}"
    target.mkdir(parents=True, exist_ok=True)
    checks: list[Check] = []
    with simulated() as site, chromium() as browser:
        ids = furnish(site)
        for scheme in SCHEMES:
            for width, height in SIZES:
                size = {"width": width, "height": height}
                context = browser.new_context(viewport=size, color_scheme=scheme, locale=language)
                context.set_default_timeout(60_000)
                page = context.new_page()
                for name, view in VIEWS.items():
                    if only is not None and name != only:
                        continue
                    there, pressed = view.whole, view.pressed
                    path = target / f"{name}-{width}x{height}-{scheme}{suffix}.png"
                    page.goto(f"{site.url}/#/{view.address.format(**ids)}")
                    if pressed is not None and not page.locator(there).first.is_visible():
                        page.get_by_role("button", name=pressed[language]).click()
                    checks.append(_picture(page, there, path))
                    show(path.name)
                context.close()
    return Outcome(tuple(checks))


def _picture(page: Any, there: str, path: Path) -> Check:
    whole = page.locator(there).first
    whole.wait_for(state="attached")
    if not whole.is_visible():  # what is out of sight is not drawn
        whole.evaluate("(element) => element.scrollIntoView({ block: 'nearest' })")
        whole.wait_for()
    page.wait_for_timeout(700)  # drawings follow what they draw
    wider = int(page.evaluate(_WIDER))
    page.screenshot(path=str(path), full_page=False)
    return fact(path.stem, wider <= 0, "fits" if wider <= 0 else f"{wider} px too wide")
