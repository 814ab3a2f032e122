"""Pictures of every view, upright and wide, dark and light."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from benchmarks.page.site import chromium, furnish, simulated
from benchmarks.targets import Check, Outcome, Show, fact

SIZES = ((800, 1280), (1280, 800), (1440, 900))
SCHEMES = ("light", "dark")
#: Views by name, the address of each with what it is of, and what is there when it is whole.
VIEWS = {
    "live": ("live", ".strip canvas"),
    "alarms": ("alarms", ".alarm"),
    "recalibrate": ("recalibrate", ".panel"),
    "guide": ("recalibrate", ".guide-steps"),
    "results": ("results", "table"),
    "result": ("results/{result}", ".plot canvas"),
    "pose": ("pose", ".pose .link"),
    "recordings": ("recordings", "table"),
    "recording": ("recordings", ".time-chart canvas"),
    "jobs": ("jobs", "table"),
    "job": ("jobs/{job}", ".steps"),
    "calibrations": ("calibrations", ".calibration"),
    "history": ("history", ".timeline svg"),
    "schedules": ("schedules", ".panel"),
    "machines": ("machines", "table"),
    "machine": ("machines/{machine}", ".editor"),
    "fleet": ("fleet", "table"),
    "audit": ("service/audit", "table"),
    "log": ("service/log", ".panel"),
    "pair": ("pair", ".panel"),
}
#: What is pressed first, by language and view.
PRESSED = {
    "en": {"recording": "View train before the seals", "guide": "Begin"},
    "de": {"recording": "train before the seals ansehen", "guide": "Beginnen"},
}
#: What sticks out of the page sideways.
_WIDER = "document.documentElement.scrollWidth - document.documentElement.clientWidth"


def run(target: Path, only: str | None, show: Show, language: str = "en") -> Outcome:
    """Make them in a directory, in a language of the page; each check is that a view fits its screen."""
    pressed = PRESSED[language]
    suffix = "" if language == "en" else f"-{language}"
    target.mkdir(parents=True, exist_ok=True)
    checks: list[Check] = []
    with simulated() as site, chromium() as browser:
        ids = furnish(site)
        for scheme in SCHEMES:
            for width, height in SIZES:
                context = browser.new_context(
                    viewport={"width": width, "height": height}, color_scheme=scheme, locale=language
                )
                context.set_default_timeout(60_000)
                page = context.new_page()
                for name, (address, there) in VIEWS.items():
                    if only is not None and name != only:
                        continue
                    path = target / f"{name}-{width}x{height}-{scheme}{suffix}.png"
                    page.goto(f"{site.url}/#/{address.format(**ids)}")
                    if name in pressed and not page.locator(there).first.is_visible():
                        page.get_by_role("button", name=pressed[name]).click()
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
