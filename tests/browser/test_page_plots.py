"""Plots in a real browser: the past is there when the page opens, pause, zoom, and a part of a recording."""

from __future__ import annotations

import re
from typing import Any

import pytest
from lever_site import Site
from service_fakes import recording_bytes

pytestmark = pytest.mark.slow
STRIP = "Joint positions"


def test_the_past_is_asked_for_and_a_range_that_was_dragged_is_held_until_live_is_wanted(page: Any, site: Site) -> None:
    with page.expect_response(re.compile(r"/machines/lever/signals\?.*channel=joint1\.angle")) as past:
        page.goto(f"{site.url}/#/live")
    assert past.value.status == 200
    strip = page.get_by_role("region", name=STRIP)
    strip.locator(".number .value").first.wait_for()
    fold = page.viewport_size["height"]
    for canvas in page.locator(".strip canvas").all():
        box = canvas.bounding_box()
        assert box["y"] + box["height"] <= fold, "plots are seen without scrolling"
    plot = strip.locator(".u-over").bounding_box()
    with page.expect_response(re.compile(r"/signals\?.*end=")) as closer:
        page.mouse.move(plot["x"] + 0.5 * plot["width"], plot["y"] + 30)
        page.mouse.down()
        page.mouse.move(plot["x"] + 0.9 * plot["width"], plot["y"] + 30, steps=4)
        page.mouse.up()
    asked = float(re.search(r"seconds=([\d.]+)", closer.value.url)[1])  # type: ignore[index]
    assert 10 < asked < 14, "four tenths of half a minute"
    page.get_by_text(re.compile("^Held:")).wait_for()
    page.get_by_role("button", name="Live").click()
    page.get_by_role("button", name="Pause").wait_for()


def test_a_recording_is_looked_at_and_a_part_of_it_is_kept(page: Any, site: Site, tmp_path: Any) -> None:
    content = recording_bytes(tmp_path, "train", ".parquet", 20)
    site.ask("POST", "/recordings/upload?machine=lever&role=train&name=whole.parquet", content=content)
    page.goto(f"{site.url}/#/recordings")
    page.get_by_role("button", name="View whole.parquet").click()
    page.get_by_role("button", name="Closer").click()
    page.get_by_role("button", name=re.compile("^Store 5.0 s to 15.0 s")).click()
    page.get_by_text("Stored as “whole.parquet, 5.0 s to 15.0 s”").wait_for()
    kept = site.ask("GET", "/recordings?limit=1")["items"][0]
    assert kept["statistics"]["rows"] in (500, 501)
    page.get_by_text("What the checks find").wait_for()
