"""What a person does with the page, in a real browser with a real server."""

from __future__ import annotations

import re
from typing import Any

import pytest
from lever_site import Site, wait_until

pytestmark = pytest.mark.slow


def number(page: Any, strip: str) -> float:
    """What the first big number of a strip shows."""
    text = page.get_by_role("region", name=strip).locator(".number .value").first.inner_text()
    return float(re.split(r"\s", text.strip())[0].replace("−", "-"))


def wait_until_it_moves(page: Any, strip: str) -> None:
    shown = page.get_by_role("region", name=strip).locator(".number .value").first
    first = shown.inner_text()
    # Asked for by an element: a function that is polled would be an "eval", which the page forbids.
    shown.filter(has_not_text=re.compile(f"^{re.escape(first)}$")).wait_for()


def test_live_values_move_and_say_that_they_are_fresh(page: Any, site: Site) -> None:
    page.goto(f"{site.url}/")
    region = page.get_by_role("region", name="Joint positions")
    region.get_by_text("fresh").wait_for()
    wait_until_it_moves(page, "Joint positions")
    assert -30 <= number(page, "Joint positions") <= 30
    page.get_by_role("region", name="Forces and torques, measured").get_by_text("N m").first.wait_for()
    wait_until(page, page.locator(".strip canvas").count, 2)
    wait_until(page, page.title, "Live – hilfit")


def test_a_recording_is_started_and_stopped(page: Any, site: Site) -> None:
    page.goto(f"{site.url}/#/live")
    page.get_by_label("Label (optional)").fill("from the page")
    page.get_by_role("button", name="Start recording").click()
    page.get_by_role("button", name="Stop recording").click()
    page.get_by_text("Recording “from the page” is stored.").wait_for()
    newest = site.ask("GET", "/recordings?limit=1")["items"][0]
    assert (newest["label"], newest["state"], newest["role"]) == ("from the page", "sealed", "operation")


def test_a_stale_sensor_is_shown_and_its_alarm_is_acknowledged_shelved_and_raised_again(page: Any, site: Site) -> None:
    steer = site.data_dir / "stale"
    steer.touch()
    try:
        page.goto(f"{site.url}/#/live")
        page.get_by_role("region", name="Forces and torques, measured").get_by_text(re.compile("stale for")).wait_for()
        page.get_by_role("link", name=re.compile("View")).click()  # the banner, on every page but that of the alarms
        waiting = page.get_by_role("region", name=re.compile("To be looked at"))
        waiting.get_by_role("button", name=re.compile("Keep quiet")).click()
        page.get_by_role("button", name="Keep quiet", exact=True).click()
        page.get_by_text("Say why").wait_for()
        page.get_by_label("Why").fill("sensor is being changed")
        page.get_by_role("button", name="Keep quiet", exact=True).click()
        seen = page.get_by_role("region", name=re.compile("Acknowledged or silenced"))
        seen.get_by_text(re.compile("sensor is being changed")).wait_for()
        page.goto(f"{site.url}/#/live")
        page.get_by_role("heading", name="Live").wait_for()
        wait_until(page, page.locator(".alarm-banner").count, 0)
        page.goto(f"{site.url}/#/alarms")
        seen.get_by_role("button", name=re.compile("Let it be heard again")).click()
        waiting.get_by_role("button", name=re.compile("Acknowledge")).click()
        seen.get_by_text(re.compile("seen by local")).wait_for()
    finally:
        steer.unlink()
    page.get_by_text("gone", exact=False).first.wait_for()
    alarm = next(one for one in site.ask("GET", "/alarms")["items"] if one["kind"] == "channel_stale")
    assert alarm["acknowledged"] and alarm["shelved_until"] is None


def test_the_guide_survives_reloads_and_orders_one_identification(page: Any, site: Site) -> None:
    posts: list[str] = []
    page.on("request", lambda request: posts.append(request.url) if request.method == "POST" else None)
    page.goto(f"{site.url}/#/recalibrate")
    page.get_by_role("button", name="Begin").click()
    page.get_by_role("button", name="Continue").click()
    page.reload()
    assert page.get_by_text("rods").count() == 0  # the lever has no cylinder, so there is nothing to unpin
    for step in ("Record the training motion", "Record it once more"):
        page.get_by_role("region", name=re.compile(step)).get_by_role("button", name="Start recording").wait_for()
        page.get_by_label("At most").select_option("0")
        page.get_by_role("button", name="Start recording").click()
        page.get_by_role("button", name="Stop and go on").wait_for()
        page.reload()
        page.get_by_role("button", name="Stop and go on").click()
    page.get_by_role("region", name=re.compile("Record another motion")).wait_for()
    page.get_by_role("button", name="Start recording").click()  # for a minute: the recorder of this site is quick
    page.get_by_role("button", name="Identify").wait_for()
    page.reload()
    page.get_by_role("button", name="Identify").click()
    page.get_by_role("link", name="View the result").wait_for()
    page.reload()
    page.get_by_role("link", name="View the result").wait_for()
    page.get_by_role("button", name="Finish this guide").click()
    page.get_by_role("button", name="Begin").wait_for()
    assert sum(url.endswith("/identifications") for url in posts) == 1
    assert sum(url.endswith("/recordings") for url in posts) == 3
    order = site.ask("GET", "/identifications?limit=1")["items"][0]
    assert sorted(one["role"] for one in order["recordings"]) == ["repeat", "train", "validate"]


def test_a_job_is_followed_and_cancelled(page: Any, site: Site) -> None:
    (site.data_dir / "steer.json").write_text('{"block": "check"}')
    try:
        chosen = []
        for role in ("train", "validate"):
            body = {"machine": "lever", "role": role, "seconds": 1}
            chosen.append(site.ask("POST", "/recordings", json=body)["id"])
            _wait_until_sealed(site, chosen[-1])
        body = {"machine": "lever", "label": "to be cancelled", "recordings": [{"id": id} for id in chosen]}
        site.ask("POST", "/identifications", json=body)
        page.goto(f"{site.url}/#/jobs")
        page.get_by_role("link", name="to be cancelled").click()
        page.get_by_text("Half of check").wait_for()
        page.get_by_role("button", name="Cancel").click()
        page.get_by_role("dialog").get_by_role("button", name="Cancel the job").click()
        page.get_by_text("It was cancelled; nothing was stored.").wait_for()
    finally:
        (site.data_dir / "steer.json").unlink()


def test_a_reading_that_fails_is_told_and_an_unknown_page_too(page: Any, site: Site) -> None:
    page.forgiven.append("404")
    page.goto(f"{site.url}/#/jobs/job-nowhere")
    page.get_by_role("alert").get_by_text(re.compile("job-nowhere")).wait_for()
    page.goto(f"{site.url}/#/nowhere")
    page.get_by_role("heading", name="Not found").wait_for()


def test_the_choice_of_colours_stays(page: Any, site: Site) -> None:
    page.goto(f"{site.url}/#/alarms")
    page.get_by_role("button", name="Dark colours").click()
    page.reload()
    page.get_by_role("button", name="Light colours").wait_for()
    wait_until(page, lambda: page.evaluate("document.documentElement.dataset.theme"), "dark")


def _wait_until_sealed(site: Site, id: str) -> None:
    for _ in range(1000):
        if site.ask("GET", f"/recordings/{id}")["state"] == "sealed":
            return
    raise AssertionError(f"{id} is not sealed")
