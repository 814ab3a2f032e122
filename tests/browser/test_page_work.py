"""From a result to a calibration in use, and the files and times that belong to it, in a real browser."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from lever_site import Site, wait_until
from service_fakes import MACHINE, recording_bytes

pytestmark = pytest.mark.slow

#: What a real identification of the demonstration's arm found, with fewer joints and points.
REPORT = Path(__file__).parents[2] / "server" / "web" / "src" / "views" / "results" / "report.fixture.json"


def upload(site: Site, path: Path, role: str, label: str) -> str:
    parameters = {"machine": "lever", "role": role, "name": f"{label}.csv"}
    return str(site.ask("POST", "/recordings/upload", params=parameters, content=recording_bytes(path))["id"])


def identified(page: Any, site: Site, path: Path, label: str) -> str:
    """The id of an identification that is done, with a report as a real one has it."""
    chosen = [{"id": upload(site, path, role, f"{label} {role}")} for role in ("train", "validate")]
    order = {"machine": "lever", "label": label, "recordings": chosen}
    made = site.ask("POST", "/identifications", json=order)
    page.goto(f"{site.url}/#/jobs/{made['job']}")
    page.get_by_role("link", name="View the result").wait_for()
    report = json.loads(REPORT.read_text(encoding="utf-8")) | {"machine": "lever"}
    (place,) = (site.data_dir / "identifications" / made["id"]).glob("*/report.json")
    place.write_text(json.dumps(report), encoding="utf-8")
    return str(made["id"])


def test_a_result_is_read_proposed_approved_used_compared_and_rolled_back(
    page: Any, site: Site, tmp_path: Path
) -> None:
    for label in ("Spring", "Summer"):
        id = identified(page, site, tmp_path, label)
        page.goto(f"{site.url}/#/results/{id}")
        page.get_by_text(re.compile("^The model lacked friction that depends on the piston position")).wait_for()
        page.get_by_role("img", name=re.compile("^joint2: before 5.30, after 1.86")).first.wait_for()
        wait_until(page, page.locator(".plot canvas").count, 4)  # before, after, and the friction of two cylinders
        page.get_by_text(re.compile("rejected, with reasons")).click()
        page.get_by_role("region", name="Rejected causes, with reasons").wait_for()
        page.get_by_role("button", name="Propose as calibration").click()
        page.get_by_text("waits for somebody to approve").wait_for()
        page.get_by_role("link", name="Calibrations", exact=True).last.click()
        page.get_by_role("button", name=f"Approve {label}").click()
        page.get_by_label("Note (optional)").fill("looked at the residual")
        page.get_by_role("button", name="Approve it").click()
        page.get_by_role("button", name=f"Use {label}").click()
        page.get_by_role("button", name="Use it from now on").click()
        page.get_by_role("button", name=f"Use {label}").wait_for(state="detached")
    in_use = page.get_by_role("region", name="In use")
    in_use.get_by_role("heading", name="Summer").wait_for()
    page.get_by_role("button", name="Compare").click()
    page.get_by_role("heading", name="A: Spring").wait_for()
    page.get_by_text("No parameter differs by more than three standard deviations.").wait_for()
    page.go_back()
    page.get_by_role("button", name="Roll back").click()
    page.get_by_role("dialog").get_by_role("button", name="Roll back").click()
    in_use.get_by_role("heading", name="Spring").wait_for()
    states = {one["label"]: one["state"] for one in site.ask("GET", "/calibrations")["items"]}
    assert states == {"Spring": "active", "Summer": "retired"}
    with page.expect_download() as download:
        in_use.get_by_text("Errors, parameters, files").click()
        in_use.get_by_role("button", name="Download Model (JSON)").click()
    assert json.loads(Path(download.value.path()).read_text())["state"] == "active"


def test_a_machine_file_that_changed_meanwhile_is_not_overwritten(page: Any, site: Site) -> None:
    text = MACHINE.replace("name: lever", "name: edited")
    site.ask("POST", "/machines", content=text)
    page.goto(f"{site.url}/#/machines/edited")
    editor = page.get_by_label("Machine file of edited")
    page.forgiven.append("422")  # the browser says so of every refusal
    editor.fill(text.replace("a: 1.0", "a: far"))
    page.get_by_role("button", name="Check").click()
    page.get_by_text("Line 8:").wait_for()
    selected = "getSelection().toString().trim().startsWith('dh: {a: far')"
    wait_until(page, lambda: page.evaluate(selected), True)
    mine, theirs = text.replace("velocity: 1.0", "velocity: 1.5"), text + "# theirs\n"
    editor.fill(mine)
    page.reload()
    wait_until(page, editor.input_value, mine)
    site.ask("POST", "/machines", content=theirs)
    page.get_by_text("Somebody saved version 2 while you were changing version 1").wait_for()
    between = page.get_by_role("region", name="Version 2 against yours")
    between.get_by_text("# theirs").wait_for()
    wait_until(page, editor.input_value, mine)
    editor.fill(mine + "# theirs\n")
    page.get_by_role("button", name="Save mine over version 2").click()
    page.get_by_text("Saved as version 3.").wait_for()
    assert site.ask("GET", "/machines/edited")["versions"] == [3, 2, 1]
    page.get_by_role("region", name="From version 2 to the current one").wait_for()


def test_a_schedule_is_made_switched_changed_and_deleted(page: Any, site: Site) -> None:
    page.goto(f"{site.url}/#/schedules")
    page.get_by_role("button", name="New schedule").click()
    page.get_by_label("Name (optional)").fill("Nightly")
    page.get_by_label("How often").select_option("day")
    page.get_by_label("Time zone").select_option("Europe/Vienna")
    page.get_by_label("Time of day").fill("02:30")
    times = page.locator(".next-times li")
    times.nth(4).wait_for()
    page.get_by_role("button", name="Create schedule").click()
    page.get_by_text("Every day at 02:30").wait_for()
    made = site.ask("GET", "/schedules")["items"][0]
    assert (made["cron"], made["timezone"], made["activate"]) == ("30 2 * * *", "Europe/Vienna", "never")
    page.get_by_role("button", name="Switch off").click()
    page.get_by_role("button", name="Switch on").wait_for()
    page.get_by_role("button", name="Change").click()
    page.get_by_label("For how many minutes").fill("10")
    page.get_by_role("button", name="Save").click()
    page.get_by_text("recorded for 10 min").wait_for()
    now = site.ask("GET", f"/schedules/{made['id']}")
    assert (now["enabled"], now["duration_s"]) == (False, 600)
    page.get_by_role("button", name="Delete", exact=True).click()
    page.get_by_role("button", name="Delete it").click()
    page.get_by_text("Nothing is scheduled.").wait_for()
    assert times.count() == 0
    assert site.ask("GET", "/schedules")["items"] == []


def test_recordings_are_uploaded_refused_identified_from_and_deleted(page: Any, site: Site, tmp_path: Path) -> None:
    page.goto(f"{site.url}/#/recordings")
    page.forgiven.append("422")  # the browser says so of every refusal
    files = page.get_by_label("Files")
    files.set_input_files({"name": "wrong.csv", "mimeType": "text/csv", "buffer": b"time,nothing\n0,1\n"})
    page.get_by_role("button", name="Upload").click()
    page.get_by_role("alert").filter(has_text="wrong.csv").wait_for()
    content = recording_bytes(tmp_path)
    for name in ("by hand.csv", "to judge by.csv", "too many.csv"):
        files.set_input_files({"name": name, "mimeType": "text/csv", "buffer": content})
        page.get_by_role("button", name="Upload").click()
        page.get_by_text(f"“{name}” is stored.").wait_for()
    page.get_by_role("button", name="View too many.csv").click()
    panel = page.get_by_role("region", name="too many.csv")
    panel.get_by_text(re.compile("no gaps")).wait_for()
    for title, suffix in (("Parquet", ".parquet"), ("CSV", ".csv"), ("MDF4", ".mf4"), ("MCAP", ".mcap")):
        with page.expect_download() as download:
            panel.get_by_role("button", name=f"Download {title}").click()
        assert download.value.suggested_filename.endswith(suffix)
        assert Path(download.value.path()).stat().st_size > 100
    panel.get_by_role("button", name="Delete").click()
    page.get_by_role("button", name="Delete it").click()
    page.get_by_role("button", name="View too many.csv").wait_for(state="detached")
    page.get_by_label("Use by hand.csv for an identification").check()
    wait_until(page, page.get_by_role("button", name="Identify").is_disabled, True)
    page.get_by_label("Use to judge by.csv for an identification").check()
    page.get_by_label("Use to judge by.csv as").select_option("validate")
    page.get_by_role("button", name="Identify").click()
    page.get_by_role("link", name="View the result").wait_for()
    newest = site.ask("GET", "/identifications?limit=1")["items"][0]
    assert [one["role"] for one in newest["recordings"]] == ["validate", "train"]
    # What a result was made of stays.
    page.forgiven.append("409")  # the browser says so of every refusal
    page.goto(f"{site.url}/#/recordings")
    page.get_by_role("button", name="View by hand.csv").click()
    page.get_by_role("button", name="Delete", exact=True).click()
    page.get_by_role("button", name="Delete it").click()
    page.get_by_role("alert").filter(has_text="identif").wait_for()
