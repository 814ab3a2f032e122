"""What a person does next is on the first screen of every view, on an upright tablet and on a phone."""

from __future__ import annotations

from typing import Any

import pytest
from lever_site import Site

pytestmark = pytest.mark.slow

#: What one does next on each view; those that are only read have a heading.
NEXT = {
    "live": ("button", "Start recording"),
    "pose": ("button", "Front"),
    "recordings": ("button", "Upload"),
    "recalibrate": ("button", "Begin"),
    "results": ("heading", "Results"),
    "valves": ("link", "Choose recordings"),
    "calibrations": ("heading", "Calibrations"),
    "schedules": ("button", "New schedule"),
    "alarms": ("heading", "Alarms"),
    "jobs": ("heading", "Jobs"),
    "machines": ("button", "New machine"),
    "machines/lever": ("button", "Save as version 2"),
    "bus-check": ("button", "Check again"),
    "fleet": ("button", "History"),
    "history": ("heading", "History"),
    "service": ("link", "Webhooks"),
}


@pytest.mark.parametrize(("width", "height"), [(800, 1280), (390, 844)])
def test_what_one_does_next_is_on_the_first_screen(page: Any, site: Site, width: int, height: int) -> None:
    page.set_viewport_size({"width": width, "height": height})
    page.forgiven.append("status of 503")  # a bus check of a machine that has been acquired for less than 2 s
    for view, (role, name) in NEXT.items():
        page.goto(f"{site.url}/#/{view}")
        found = page.get_by_role(role, name=name).first
        found.wait_for()
        box = found.bounding_box()
        assert box is not None and box["y"] >= 0 and box["y"] + box["height"] <= height, f"{view}: {name} at {box}"
        assert box["x"] >= 0 and box["x"] + box["width"] <= width, f"{view}: {name} at {box}"
        assert page.evaluate("document.documentElement.scrollWidth") <= width, f"{view} is wider than the screen"
