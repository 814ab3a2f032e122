"""A service with the simulated machine, and what a machine gathers over months; a browser as slow as a tablet's."""

from __future__ import annotations

import json
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path
from typing import Any

import httpx2

from benchmarks.service.hosts import API, running, wait_until
from daq.errors import InputError
from fitting.pipeline.stage_names import STAGES
from server.alarms.alarm_desk import Alarms
from server.audit.audit_resource import Audit
from server.calibrations.calibration_content import content_of
from server.calibrations.calibration_desk import Calibrations
from server.composition.declarations import TABLES
from server.identifications.identification_store import Identification, Identifications
from server.jobs.job_store import Jobs, found_by
from server.platform.authorization.principals import LOCAL
from server.platform.database.engine import Database
from server.platform.files import DataDirectory

#: What a real identification of the demonstration's arm found; tests of the page read it, too.
REPORT = Path(__file__).parents[2] / "server" / "web" / "src" / "views" / "results" / "report.fixture.json"
START_S = 180.0
#: Id of the job under way.
UNDER_WAY = "job-under-way"
#: s of the recordings that are made, and how many there are of each role.
RECORDED_S = 12.0


@dataclass(frozen=True)
class Site:
    """A running service, and a client of it."""

    url: str
    data_dir: Path
    client: httpx2.Client

    def ask(self, method: str, path: str, content: Any = None) -> Any:
        """Send one request; return its JSON."""
        return self.client.request(method, path, json=content).raise_for_status().json()

    def is_sealed(self, recording: str) -> bool:
        """Test whether a recording is over and whole."""
        return bool(self.ask("GET", f"/recordings/{recording}")["state"] == "sealed")


@contextmanager
def simulated() -> Iterator[Site]:
    """Run ``hilfit serve --simulate`` on a free port, once it measures."""
    with tempfile.TemporaryDirectory(prefix="hilfit-bench-") as directory:
        data = Path(directory) / "data"
        words = ["serve", "--simulate", "--port", "0", "--json", "--data-dir", str(data)]
        # A tablet does not take the service's processor: here it would, with brakes that wait busily.
        with (
            running(words, subprocess.DEVNULL, before=("nice", "-n", "-10")) as (_, up),
            httpx2.Client(base_url=up["url"] + API, timeout=60) as client,
        ):
            site = Site(str(up["url"]), data, client)
            wait_until(lambda: bool(site.ask("GET", "/live")), START_S, "the first live frame")
            yield site


def furnish(site: Site) -> dict[str, str]:
    """Furnish a site with recordings, results, calibrations, alarms and work; return ids by what they are of.

    Raises
    ------
    InputError
        If this is no checkout of hilfit, which has the report that is shown.
    """
    if not REPORT.is_file():
        raise InputError(f"{REPORT}: is missing; run this in a checkout of hilfit")
    machine = site.ask("GET", "/machines")["items"][0]["name"]
    recordings = []
    for role in ("train", "repeat", "validate"):
        order = {"machine": machine, "role": role, "label": f"{role} before the seals", "seconds": RECORDED_S}
        recordings.append(site.ask("POST", "/recordings", order)["id"])
        wait_until(partial(site.is_sealed, recordings[-1]), START_S, "the recording")
    schedule = {"machine": machine, "label": "Sunday night", "cron": "0 3 * * 0", "timezone": "Europe/Berlin"}
    site.ask("POST", "/schedules", schedule)
    _months(site, machine)
    return {"machine": machine, "recording": recordings[0], "result": "idn-months-4", "job": UNDER_WAY}


class _Past:
    """A clock that is set."""

    def __init__(self) -> None:
        self.now = datetime.now(UTC)

    def __call__(self) -> datetime:
        return self.now


def _months(site: Site, machine: str) -> None:
    """Store five identifications over four months, three of them used, and what was wrong between."""
    clock, report = _Past(), json.loads(REPORT.read_text(encoding="utf-8"))
    files = DataDirectory(site.data_dir)
    database = Database(files.database, TABLES, clock=clock, changed=lambda: None)
    with closing(database):
        desk, audit = Alarms(database), Audit(database)
        calibrations = Calibrations(database, files)
        for number, (days, error, found) in enumerate(
            [(110, 1.42, False), (83, 1.19, True), (55, 1.31, False), (30, 1.02, True), (4, 1.01, True)]
        ):
            clock.now = datetime.now(UTC) - timedelta(days=days)
            loop = report["loop"] if found else report["loop"] | {"verdict": "nothing_missing", "effects": []}
            content = report | {"machine": machine, "loop": loop, "overall": report["overall"] | {"after": error}}
            source = _identification(site, database, machine, f"idn-months-{number}", content)
            if number == 2:
                continue
            proposed, _ = calibrations.add(source, f"Calibration {number + 1}", content_of(content), LOCAL)
            audit.write(LOCAL, "calibrations.propose", proposed.id, {"identification": source.id})
            if number == 4:
                continue
            clock.now += timedelta(hours=3)
            calibrations.decide(proposed.id, "approved", replace(LOCAL, id="second", name="Kim"), "looked at it", None)
            calibrations.activate(proposed.id, None, LOCAL)
            audit.write(LOCAL, "calibrations.activate", proposed.id)
        for ago, hours, kind, text, severity in _WRONG:
            clock.now = datetime.now(UTC) - timedelta(days=ago)
            for on in (True, False):
                for _ in range(2):  # a delay of a kind has passed between the two
                    desk.report(machine, kind, text, severity, on)
                clock.now += timedelta(hours=hours)
            for alarm in desk.open():
                desk.acknowledge(alarm.id, "Kim")
        clock.now = datetime.now(UTC) - timedelta(seconds=40)
        _under_way(database, machine)
        clock.now = datetime.now(UTC)
        desk.report(machine, "residual_grew", "the error of joint2 grew by a fifth; recalibrate", "warning", True)


def _new(database: Database, machine: str, id: str, job: str, label: str) -> Identification:
    return Identification(
        id=id,
        job=job,
        machine=machine,
        machine_version=1,
        label=label,
        recordings=(),
        options={},
        created=database.now(),
    )


def _under_way(database: Database, machine: str) -> None:
    """Store a job that looks half-way; nobody works on it, so that pictures take no processor time."""
    jobs = Jobs(database)
    new = _new(database, machine, "idn-under-way", UNDER_WAY, "After the seals")
    jobs.order(Identifications(database), new, "identification", STAGES)
    jobs.progress(UNDER_WAY, STAGES[0], 0.0, "Reads the recordings")
    jobs.progress(UNDER_WAY, STAGES[2], 0.3, "Fits masses and inertias")


_WRONG: tuple[tuple[float, float, str, str, Any], ...] = (
    (96.0, 20.0, "residual_drift", "joint2: more or less force against the motion (friction); recalibrate", "warning"),
    (62.0, 60.0, "residual_drift", "joint3: a constant force more or less; recalibrate", "warning"),
    (41.0, 0.2, "overload", "joint1: 340 N m beyond the model", "critical"),
    (12.0, 0.1, "clock_jumped", "the clock of this computer was set by 4 s", "info"),
)


def _identification(site: Site, database: Database, machine: str, id: str, report: dict[str, Any]) -> Identification:
    """Make one that is done."""
    jobs = Jobs(database)
    new = _new(database, machine, id, f"job-{id}", f"Identification {id[-1]}")
    jobs.order(Identifications(database), new, "identification", STAGES)
    place = site.data_dir / "identifications" / id
    place.mkdir(parents=True, exist_ok=True)
    (place / "report.json").write_text(json.dumps(report), encoding="utf-8")
    result = found_by(Identification, id, verdict=report["loop"]["verdict"], overall=report["overall"])
    jobs.finish(new.job, "done", "Done", result=result, place=".")
    return new


ARGUMENTS = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking"]


@dataclass(frozen=True)
class Tablet:
    """Slowness of a device and its network.

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
        network = {"offline": False, "latency": tablet.latency_ms}
        network |= {"downloadThroughput": bytes_per_s, "uploadThroughput": bytes_per_s}
        session.send("Network.emulateNetworkConditions", network)
        session.send("Emulation.setCPUThrottlingRate", {"rate": tablet.cpu})
        yield page
    finally:
        context.close()
