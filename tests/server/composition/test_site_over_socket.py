"""A site's whole use over a real socket: design, record, identify, approve by a second person, activate, export, and a
schedule that fires twice. The machine is the demo's with three joints, simulated; every request is one that a tablet or
a program sends.

What the whole loop says of such recordings through REST is in `test_demo.py`.
"""

from __future__ import annotations

import io
import json
import os
import re
import select
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import httpx2
import pytest
from mcap.reader import make_reader
from service_fakes import API

from benchmarks.service.start import children

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1500)]
MACHINE = "folding-arm"
#: Machine time of each motion, s.
SECONDS = 9.0
#: The loop is tested elsewhere; without it the fits are short.
OPTIONS = {"loop": False, "bootstrap": 0}


def wait_until(what: str, condition: Callable[[], Any], seconds: float = 600) -> Any:
    """The first true value of ``condition()``; over a socket there is no event of the store to wait for."""
    deadline = time.monotonic() + seconds
    while not (value := condition()):
        assert time.monotonic() < deadline, f"waited {seconds:g} s until {what}"
        time.sleep(0.1)
    return value


class Client:
    """One principal over HTTP."""

    def __init__(self, url: str, token: str | None = None) -> None:
        headers = {} if token is None else {"Authorization": f"Bearer {token}"}
        self.http = httpx2.Client(base_url=url, headers=headers, timeout=600)

    def ask(self, method: str, path: str, status: int = 200, **options: Any) -> httpx2.Response:
        response = self.http.request(method, f"{API}{path}", **options)
        assert response.status_code == status, (method, path, response.text)
        return response

    def get(self, path: str, **query: Any) -> Any:
        return self.ask("GET", path, params=query).json()

    def post(self, path: str, status: int, content: Any = None, **headers: str) -> Any:
        return self.ask("POST", path, status, json=content, headers=headers).json()

    def done(self, job: str) -> dict[str, Any]:
        """Wait for a job, whose events end with it; it has to be done."""
        with self.http.stream("GET", f"{API}/jobs/{job}/events") as stream:
            stream.read()
        found = self.get(f"/jobs/{job}")
        assert found["state"] == "done", found
        return dict(found)


class SiteOfTest:
    """A running service, its clock, and its people."""

    def __init__(self, url: str, place: Path, code: str) -> None:
        self.place = place
        self.url = url
        self.nobody = Client(url)
        self.admin = self.pair(code, "the first tablet")
        key = self.admin.post("/access/keys", 201, {"name": "line computer", "role": "engineer"})["key"]
        self.engineer = Client(url, key)
        code = self.admin.post("/access/pairing-codes", 201, {"role": "engineer", "machines": [MACHINE]})["code"]
        self.second = self.pair(code, "shift lead's tablet")

    def pair(self, code: str, name: str) -> Client:
        return Client(self.url, self.nobody.post("/access/pair", 201, {"code": code, "name": name})["token"])

    def later(self, hours: float) -> None:
        """Set the schedules' clock."""
        set_clock(self.place, hours)


def set_clock(place: Path, hours: float) -> None:
    (place / "hours.new").write_text(str(hours))
    (place / "hours.new").replace(place / "hours")


@contextmanager
def site(place: Path) -> Iterator[SiteOfTest]:
    set_clock(place, 0.0)
    log = place / "server.log"
    command = [sys.executable, str(Path(__file__).parents[1] / "serve_with_set_clock.py"), str(place)]
    with log.open("wb") as errors, subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors) as process:
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            assert line, log.read_text()
            code = wait_until("the pairing code is told", lambda: re.search(r"admin with (\d{10})", log.read_text()))
            made = SiteOfTest(json.loads(line)["url"], place, code[1])
            try:
                yield made
            finally:
                for client in (made.nobody, made.admin, made.engineer, made.second):
                    client.http.close()
            ended = {pid: os.pidfd_open(pid) for pid in children(process.pid)}
            assert ended, "the simulated machine and acquisition are processes of their own"
            process.terminate()
            assert process.wait(60) == 0, log.read_text()
            for descriptor in ended.values():
                assert select.select([descriptor], [], [], 10)[0], "every child has to end with the server"
                os.close(descriptor)
        finally:
            process.kill()


def nearly_all_fresh(channel: str, counts: Mapping[str, int]) -> None:
    """A busy computer may make a value late, never lose one of a hundred; ``bench service`` counts them."""
    assert counts["fresh"] > 0.99 * sum(counts.values()), (channel, counts)


def acquired_all_along(who: Client) -> None:
    """Nearly no cycle was skipped since acquisition began, and nearly no value is old."""

    def counted() -> Any:
        found = who.get("/status")["acquisition"][MACHINE].get("counts", {"cycles": 0})
        return found["cycles"] >= 100 and found

    counts = wait_until("a hundred cycles are counted", counted)
    assert counts["skipped"] <= 0.01 * counts["cycles"]
    for channel, of_channel in counts["quality"].items():
        nearly_all_fresh(channel, of_channel)


@contextmanager
def at_rest(who: Client) -> Iterator[None]:
    """No acquisition: no time passes for a simulated machine then, so that fits need not share the cores with it."""
    acquired_all_along(who)
    who.ask("PUT", f"/machines/{MACHINE}/acquisition", json={"enabled": False})
    yield
    who.ask("PUT", f"/machines/{MACHINE}/acquisition", json={"enabled": True})
    wait_until("frames come again", lambda: who.get("/live").get(MACHINE))


def fitted_at_rest(who: Client, job: str) -> dict[str, Any]:
    """Wait for a recalibration, with acquisition only as long as it records."""

    def past_the_recording() -> bool:
        row = who.get(f"/jobs/{job}")
        return row["state"] in ("done", "failed", "cancelled") or row["stage"] not in (None, "record")

    wait_until(f"{job} has recorded", past_the_recording)
    with at_rest(who):
        return who.done(job)


def design(who: Client, label: str, **options: Any) -> str:
    """Design a motion; the excitation's id."""
    order = {"machine": MACHINE, "label": label, "duration_s": SECONDS, "starts": 1, **options}
    first = who.ask("POST", "/excitations", 202, json=order, headers={"Idempotency-Key": label})
    again = who.ask("POST", "/excitations", 202, json=order, headers={"Idempotency-Key": label})
    assert again.json()["id"] == first.json()["id"]
    who.done(first.json()["job"])
    id = str(first.json()["id"])
    found = who.get(f"/excitations/{id}")
    assert found["condition_number"] > 1
    assert found["seconds"] >= SECONDS
    assert all(limit["used"] <= 1 + 1e-6 for limit in found["limits"]), found["limits"]
    return id


def record(site: SiteOfTest, role: str, excitation: str) -> str:
    """Let the simulated controller follow a motion, and record it."""
    who = site.engineer
    motion = who.get(f"/excitations/{excitation}")
    sent = who.post(f"/excitations/{excitation}/send", 202)["name"]
    status = site.place / "data" / "simulation" / "controller.json"
    wait_until(f"{role} is followed", lambda: sent in json.loads(status.read_text())["followed"])
    order = {"machine": MACHINE, "role": role, "label": role, "seconds": motion["seconds"] - 2.0}
    id = who.post("/recordings", 201, order)["id"]
    if role == "train":
        refused = who.post("/recordings", 409, order)
        assert id in refused["detail"], "one recording at a time"
    row = wait_until(f"{id} is sealed", lambda: (r := who.get(f"/recordings/{id}"))["state"] != "recording" and r)
    assert row["state"] == "sealed", row
    statistics = row["statistics"]
    assert statistics["missed_cycles"] <= 0.01 * statistics["rows"]
    assert statistics["rows"] == round((motion["seconds"] - 2.0) * 50)
    for channel, others in statistics["quality"].items():
        nearly_all_fresh(channel, {"fresh": statistics["rows"] - sum(others.values()), **others})
    wait_until(f"{role} is over", lambda: json.loads(status.read_text())["followed"][sent][1] is not None)
    return str(id)


def test_a_site_from_design_to_recalibration(tmp_path: Path) -> None:
    with site(tmp_path) as place:
        who = place.engineer
        place.nobody.ask("GET", "/machines", 401)
        live = wait_until("frames come", lambda: who.get("/live").get(MACHINE))
        assert live["channels"]["joint1.head_pressure"]["quality"] == "fresh"
        with at_rest(who):
            designs = {
                "free cylinders": design(who, "free cylinders", rods="unpinned"),
                "train": design(who, "train", seed=1),
                "validate": design(who, "validate", seed=2),
            }
        motion = who.ask("GET", f"/excitations/{designs['train']}/motion.csv").text
        assert len([line for line in motion.splitlines() if line and line[0].isdigit()]) >= SECONDS * 50

        plan = [("unloaded", "free cylinders"), ("train", "train"), ("repeat", "train"), ("validate", "validate")]
        recorded = [record(place, role, designs[name]) for role, name in plan]
        listed = who.get("/recordings", machine=MACHINE)["items"]
        assert [row["id"] for row in listed] == recorded[::-1]
        with at_rest(who), ThreadPoolExecutor(1) as beside:
            exported = beside.submit(exports, who, recorded[1])
            first = recalibrate_by_hand(place, recorded)
            exported.result()
        schedule_fires_twice(place, [designs["train"], designs["validate"]], first)
        a_days_work_is_compared(place, [designs["train"], designs["validate"]], first)
        assert place.admin.get("/audit/verification")["intact"]
        acquired_all_along(who)


def recalibrate_by_hand(place: SiteOfTest, recorded: list[str]) -> str:
    """Identify, propose, have it approved by somebody else, activate; the calibration's id."""
    who = place.engineer
    order = {"machine": MACHINE, "recordings": [{"id": id} for id in recorded], "options": OPTIONS, "label": "by hand"}
    ordered = who.post("/identifications", 202, order)
    who.done(ordered["job"])
    identification = f"/identifications/{ordered['id']}"
    report = who.get(f"{identification}/report.json")
    assert report["schema"] == "hilfit/report/1"
    assert report["reduction"] == {"standard_parameters": 39, "base_parameters": 9}
    rows = {row["role"]: row["statistics"]["rows"] for row in (who.get(f"/recordings/{id}") for id in recorded)}
    assert {entry["role"]: entry["samples"] for entry in report["data"]} == rows
    assert rows.keys() == {"unloaded", "train", "repeat", "validate"}
    assert "<html" in who.ask("GET", f"{identification}/report.html").text
    who.ask("DELETE", f"/recordings/{recorded[1]}", 409)

    calibration = who.post("/calibrations", 201, {"identification": ordered["id"], "label": "first"})
    path = f"/calibrations/{calibration['id']}"
    assert (calibration["state"], calibration["proposed_by"]) == ("proposed", "line computer")
    tag = who.ask("GET", path).headers["etag"]
    refused = who.post(f"{path}/approve", 409, {"note": "looks good"})
    assert "propose" in refused["detail"], "who proposed may not approve"
    who.post(f"{path}/activate", 409)
    approved = place.second.post(f"{path}/approve", 200, {"note": "errors are small"}, **{"If-Match": tag})
    assert approved["approved_by"] == "shift lead's tablet"
    place.second.post(f"{path}/approve", 412, {"note": "again"}, **{"If-Match": tag})
    assert who.post(f"{path}/activate", 200)["state"] == "active"
    model = who.ask("GET", f"{path}/model.json")
    assert model.json()["calibration"] == calibration["id"]
    assert "attachment" in model.headers["content-disposition"]
    return str(calibration["id"])


def exports(who: Client, recording: str) -> None:
    """All four forms of a recording."""
    starts = {"parquet": b"PAR1", "csv": b"#", "mdf4": b"MDF     4.", "mcap": b"\x89MCAP0\r\n"}
    contents = {
        form: who.ask("GET", f"/recordings/{recording}/data", params={"format": form}).content for form in starts
    }
    rows = who.get(f"/recordings/{recording}/statistics")["rows"]
    assert sum(1 for _ in make_reader(io.BytesIO(contents["mcap"])).iter_messages()) == rows
    for form, start in starts.items():
        if form != "csv":
            assert contents[form].startswith(start), form
    assert b"joint1.head_pressure" in contents["csv"]


def schedule_fires_twice(place: SiteOfTest, excitations: list[str], active: str) -> None:
    """Hours pass by the schedules' clock; each slot runs the standard motion, fits, compares and proposes."""
    who = place.engineer
    wish = {
        "machine": MACHINE,
        "label": "every hour",
        "cron": "0 * * * *",
        "timezone": "Europe/Vienna",
        "motion": "standard",
        "excitations": excitations,
        "options": OPTIONS,
    }
    schedule = who.post("/schedules", 201, wish)
    path = f"/schedules/{schedule['id']}"

    def had_turn(number: int) -> list[dict[str, Any]]:
        slots = who.get(f"{path}/slots")["items"]
        return slots if len(slots) == number else []

    for number in (1, 2):
        place.later(float(number))
        seen = wait_until(f"slot {number} has its turn", partial(had_turn, number))
        job = fitted_at_rest(who, seen[0]["job"])
        found = who.get(f"/recalibrations/{job['subject']}")
        assert (found["schedule"], found["calibration"]) == (
            schedule["id"],
            who.get(f"{path}/slots")["items"][0]["calibration"],
        )
        assert found["comparison"]["active"] == active
        joints = found["comparison"]["joints"]
        assert joints.keys() == {f"joint{number}" for number in range(1, 4)}
        assert all(0 < table["after"] < 10 * table["before"] for table in joints.values()), joints
    seen = who.get(f"{path}/slots")["items"]
    assert [slot["state"] for slot in seen] == ["done", "done"]
    assert seen[0]["slot"] > seen[1]["slot"]
    proposed = {slot["calibration"] for slot in seen}
    assert len(proposed) == 2
    for id in proposed:
        calibration = who.get(f"/calibrations/{id}")
        assert calibration["state"] == "proposed", "nothing is activated alone"
        compared = who.get("/calibrations/compare", a=active, b=id)
        assert compared["parameters"]
    assert [row["id"] for row in who.get("/calibrations", machine=MACHINE, state="active")["items"]] == [active]
    assert not [a for a in who.get("/alarms", state="active")["items"] if a["kind"] == "recalibration_failed"]
    who.ask("DELETE", path, 204)


def a_days_work_is_compared(place: SiteOfTest, work: list[str], active: str) -> None:
    """A schedule that records normal operation: nobody tells the machine to move, and the slot waits for nobody.

    The machine has work of its own: its controller got motions from elsewhere, longer than what is recorded.
    """
    who = place.engineer
    wish = {
        "machine": MACHINE,
        "label": "by day",
        "cron": "30 * * * *",
        "motion": "operation",
        "duration_s": 30.0,
        "options": OPTIONS,
    }
    path = f"/schedules/{who.post('/schedules', 201, wish)['id']}"
    for excitation in 4 * work:
        who.post(f"/excitations/{excitation}/send", 202)
    place.later(3.0)
    slot = wait_until("the slot has its turn", lambda: who.get(f"{path}/slots")["items"])[0]
    job = fitted_at_rest(who, slot["job"])
    found = who.get(f"/recalibrations/{job['subject']}")
    rows = {role: who.get(f"/recordings/{id}/statistics")["rows"] for role, id in found["recordings"].items()}
    assert rows.keys() == {"operation", "validate"}
    assert rows["operation"] == pytest.approx(2 * rows["validate"], rel=0.2), "two thirds are fitted"
    report = who.get(f"/identifications/{found['identification']}/report.json")
    assert {entry["role"] for entry in report["data"]} == {"operation", "validate"}
    assert found["comparison"]["active"] == active
    assert all(table["after"] > 0 for table in found["comparison"]["joints"].values())
    assert who.get(f"/calibrations/{found['calibration']}")["state"] == "proposed"
    assert [row["id"] for row in who.get("/calibrations", machine=MACHINE, state="active")["items"]] == [active]
