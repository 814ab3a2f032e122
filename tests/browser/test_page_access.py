"""Everybody can use the page: sizes for a gloved hand, names for a screen reader, a keyboard, contrast."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import pytest
from lever_site import Site, wait_until

pytestmark = pytest.mark.slow
VIEWS = (
    "live",
    "alarms",
    "recalibrate",
    "recordings",
    "jobs",
    "results",
    "calibrations",
    "schedules",
    "calibrations/compare/a/b",
    "machines/lever",
    "pose",
    "history",
    "fleet",
    "machines",
    "service/audit",
    "service/log",
    "pair",
)
SHAPES = {"landscape-light-en": (1280, 800, "light", "en-GB"), "portrait-dark-de": (800, 1280, "dark", "de-AT")}
#: What the live view shows once values come, and what each view shows while it waits.
FRESH = {"en": ("Joint positions", "fresh"), "de": ("Gelenkstellungen", "aktuell")}
READING = re.compile("Reading …|Wird gelesen …")
#: CSS px on a side; what a finger hits in a label counts as the label.
LEAST = 44
_TARGETS = """() => [...document.querySelectorAll("a[href], button, input, select, textarea, summary")]
  .filter((element) => element.checkVisibility() && !element.classList.contains("skip"))
  .map((element) => {
    const label = element.matches("[type=checkbox], [type=radio]") ? element.closest("label") : null;
    const box = (label ?? element).getBoundingClientRect();
    const name = (element.ariaLabel ?? element.textContent ?? "").trim().slice(0, 40) || element.outerHTML.slice(0, 80);
    return { name, width: box.width, height: box.height };
  })
  .filter((box) => box.width > 0 && (box.width < LEAST - 0.5 || box.height < LEAST - 0.5))
""".replace("LEAST", str(LEAST))


@pytest.fixture(scope="module", params=SHAPES)
def tablet(browser: Any, site: Site, request: pytest.FixtureRequest) -> Iterator[Any]:
    """A tab of each shape and colour scheme."""
    width, height, scheme, locale = SHAPES[request.param]
    context = browser.new_context(
        viewport={"width": width, "height": height}, color_scheme=scheme, locale=locale, reduced_motion="reduce"
    )
    context.set_default_timeout(60_000)
    page = context.new_page()
    page.goto(f"{site.url}/")
    region, fresh = FRESH[locale[:2]]
    page.get_by_role("region", name=region).get_by_text(fresh).wait_for()
    yield page
    context.close()


def show(page: Any, site: Site, view: str) -> None:
    page.goto(f"{site.url}/#/{view}")
    page.locator("main h1").first.wait_for()
    page.get_by_text(READING).wait_for(state="detached")


@pytest.mark.parametrize("view", VIEWS)
def test_a_view_has_no_serious_fault_of_access_and_large_enough_targets(tablet: Any, site: Site, view: str) -> None:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe is not installed (extra 'test')")
    show(tablet, site, view)
    small = tablet.evaluate(_TARGETS)
    assert small == []
    assert tablet.evaluate(_WIDER) == []
    found = axe.Axe().run(tablet).response["violations"]
    grave = [
        (fault["id"], [node["html"][:200] for node in fault["nodes"]])
        for fault in found
        if fault["impact"] in ("serious", "critical")
    ]
    assert grave == []


#: What sticks out of the page sideways, if the page scrolls sideways.
_WIDER = """() => document.documentElement.scrollWidth <= innerWidth ? [] : [...document.querySelectorAll("*")]
  .filter((element) => element.getBoundingClientRect().right > innerWidth)
  .map((element) => element.outerHTML.slice(0, 120))
"""
#: Names of machines, channels and effects are a site's own: every text ends in a word longer than the screen is wide.
_LENGTHEN = """() => {
  const walker = document.createTreeWalker(document.querySelector("main"), NodeFilter.SHOW_TEXT);
  const fixed = "svg, option, .value, .look, .u-legend";
  const texts = [];
  while (walker.nextNode()) texts.push(walker.currentNode);
  for (const text of texts)
    if (text.data.trim() !== "" && text.parentElement.closest(fixed) === null) text.data += "x".repeat(160);
  const choices = document.querySelectorAll("main option, .machine-choice option");
  for (const option of choices) option.textContent += "x".repeat(160);
}"""


@pytest.mark.parametrize("view", VIEWS)
def test_nothing_scrolls_sideways_however_long_names_are(tablet: Any, site: Site, view: str) -> None:
    tablet.goto("about:blank")  # what is lengthened goes with it
    show(tablet, site, view)
    tablet.evaluate(_LENGTHEN)
    assert tablet.evaluate(_WIDER) == []


_REFUSED = """addEventListener("securitypolicyviolation", (event) => {
  (globalThis.refused ??= []).push(`${event.effectiveDirective} ${event.sourceFile}:${event.lineNumber}`);
});"""


def test_no_view_does_what_the_policy_refuses(browser: Any, site: Site) -> None:
    with browser.new_context() as context:
        context.set_default_timeout(60_000)
        context.add_init_script(_REFUSED)
        page = context.new_page()
        policy = page.goto(f"{site.url}/").headers["content-security-policy"]
        assert "unsafe" not in policy
        page.locator(".strip canvas").first.wait_for()
        for view in VIEWS:
            show(page, site, view)
        assert page.evaluate("globalThis.refused ?? []") == []
        # A style in markup is refused, and is seen here.
        page.evaluate("document.body.insertAdjacentHTML('beforeend', '<p style=\"color: red\">no</p>')")
        seen = "(globalThis.refused ?? []).map((each) => each.split(' ')[0])"
        wait_until(page, lambda: page.evaluate(seen), ["style-src-attr"])


def test_the_keyboard_is_enough(page: Any, site: Site) -> None:
    page.goto(f"{site.url}/#/live")
    page.get_by_role("region", name="Joint positions").get_by_text("fresh").wait_for()
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.textContent").strip() == "Skip to the content"
    page.keyboard.press("Enter")
    wait_until(page, lambda: page.evaluate("document.activeElement.id"), "content")
    for _ in range(60):  # the plots' controls, then motion, label and the button
        page.keyboard.press("Tab")
        assert page.evaluate("document.activeElement.matches(':focus-visible')")
        if page.evaluate("document.activeElement.textContent").strip() == "Start recording":
            break
    assert page.evaluate("document.activeElement.textContent").strip() == "Start recording"
    page.keyboard.press("Enter")
    stop = page.get_by_role("button", name="Stop recording")
    stop.wait_for()
    stop.focus()
    page.keyboard.press("Space")
    page.get_by_role("button", name="Start recording").wait_for()
    page.goto(f"{site.url}/#/jobs")
    page.get_by_role("heading", name="Jobs").wait_for()
    # Who reads by ear is told of the new page.
    wait_until(page, lambda: page.evaluate("document.activeElement.id"), "content")


def test_a_question_holds_the_focus_and_escape_says_no(page: Any, site: Site) -> None:
    page.goto(f"{site.url}/#/recalibrate")
    page.get_by_role("button", name="Begin").click()
    end = page.get_by_role("button", name="End this guide")
    end.click()
    dialog = page.get_by_role("dialog", name="End this guide?")
    dialog.wait_for()
    inside = "document.querySelector('dialog').contains(document.activeElement)"
    wait_until(page, lambda: page.evaluate(inside), True)
    page.keyboard.press("Escape")
    dialog.wait_for(state="detached")
    page.locator(":focus", has_text="End this guide").wait_for()
    end.click()
    page.get_by_role("button", name="End it").click()
    page.get_by_role("button", name="Begin").wait_for()


def test_the_language_is_the_browsers_until_somebody_chooses_and_is_kept(browser: Any, site: Site) -> None:
    context = browser.new_context(locale="de-DE")
    context.set_default_timeout(60_000)
    page = context.new_page()
    page.goto(f"{site.url}/#/alarms")
    page.get_by_role("heading", name="Alarme").wait_for()
    wait_until(page, lambda: page.evaluate("document.documentElement.lang"), "de")
    page.get_by_label("Sprache").select_option("en")
    page.get_by_role("heading", name="Alarms").wait_for()
    wait_until(page, lambda: page.evaluate("document.documentElement.lang"), "en")
    page.reload()
    page.get_by_role("heading", name="Alarms").wait_for()
    context.close()


#: Views that show what the service says of the machine as it is, with what is there when they are whole.
SAID = {"live": ".strip canvas", "fleet": "table", "machines": "table", "jobs": ".panel", "service/log": ".panel"}
#: Words of no German text; names of machines, channels and devices have none of them.
ENGLISH = re.compile(r"\b(the|and|is|of|not|with|that|has|no|to|from|node|unit)\b", re.IGNORECASE)


@pytest.mark.parametrize("view", SAID)
def test_no_english_is_left_on_a_german_page(browser: Any, site: Site, view: str) -> None:
    context = browser.new_context(locale="de-DE")
    context.set_default_timeout(60_000)
    page = context.new_page()
    page.goto(f"{site.url}/#/{view}")
    page.locator(SAID[view]).first.wait_for()
    page.wait_for_timeout(1000)  # what comes late comes

    def english() -> list[str]:
        page.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = true; })")
        lines = page.evaluate("document.querySelector('main').innerText").splitlines()
        # The log's own lines are for who looks after the service: they are English as in its file.
        return [line for line in lines if ENGLISH.search(line) and not re.match(r"\d\d:\d\d|.*=", line)]

    wait_until(page, english, [])  # the service's own sentences come before the table that has their German
    context.close()
