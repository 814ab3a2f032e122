"""All machines at a glance, one machine over months, and the log: who sees what, and that it is true."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from datetime import datetime, timedelta
from typing import Any

import pytest
from access_fakes import Guarded, guarded_service
from service_fakes import API

from server.alarms.alarm_desk import Alarms, alarms
from server.calibrations.calibration_content import content_of
from server.calibrations.calibration_desk import Calibrations
from server.fleet.fleet_resource import worst_joint
from server.history.history_resource import gathered
from server.identifications.identification_store import Identification, Identifications
from server.jobs.job_store import Jobs, found_by
from server.monitor.monitor_supervisor import Monitors
from server.platform.authorization.principals import LOCAL
from server.platform.database.engine import Database, as_stored

EFFECT = {"id": "stribeck", "joint": "joint1", "title": "Stribeck friction", "parameters": {}}
REPORT: dict[str, Any] = {
    "schema": "hilfit/report/1",
    "machine": "lever",
    "overall": {"before": 2.0, "after": 1.1},
    "loop": {"verdict": "effect_added", "effects": [EFFECT]},
}


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Guarded]:
    with guarded_service(tmp_path_factory.mktemp("data")) as service:
        yield service


def ask(guarded: Guarded, path: str, role: Any = "viewer", machines: tuple[str, ...] | None = None) -> Any:
    answer = guarded.client.get(f"{API}{path}", headers=guarded.bearer(role, machines))
    assert answer.status_code == 200, answer.text
    return answer.json()


def identify(guarded: Guarded, id: str, machine: str = "lever") -> Identification:
    """An identification that is done, with its report."""
    service = guarded.running.service
    new = Identification(
        id=id,
        job=f"job-{id}",
        machine=machine,
        machine_version=1,
        label=f"label of {id}",
        recordings=(),
        options={},
        created=service.now(),
    )
    service[Jobs].order(service[Identifications], new, "identification", ("check",))
    place = service.files.identifications / id
    place.mkdir(parents=True)
    (place / "report.json").write_text(json.dumps(REPORT))
    result = found_by(Identification, id, verdict="effect_added", overall=REPORT["overall"])
    service[Jobs].finish(new.job, "done", "Done", result=result, place=".")
    return new


@pytest.fixture(scope="module")
def calibrated(guarded: Guarded) -> str:
    """The lever with a calibration in use."""
    calibrations = guarded.running.service[Calibrations]
    found, _ = calibrations.add(identify(guarded, "idn-1"), "spring", content_of(REPORT), LOCAL)
    calibrations.decide(found.id, "approved", replace(LOCAL, id="second", name="second"), "looks right", None)
    calibrations.activate(found.id, None, LOCAL)
    return found.id


@pytest.fixture(scope="module")
def alarmed(guarded: Guarded) -> None:
    desk = guarded.running.service[Alarms]
    for _ in range(2):
        desk.report("lever", "overload", "too much", "critical", True)
    desk.report("lever", "residual_drift", "friction", "warning", True)
    desk.report("lever", "residual_drift", "", "warning", False)
    desk.report("other", "overload", "of another machine", "critical", True)


@pytest.mark.slow
@pytest.mark.usefixtures("alarmed")
def test_the_fleet_says_of_each_machine_what_its_own_routes_say(guarded: Guarded, calibrated: str) -> None:
    fleet = {one["name"]: one for one in ask(guarded, "/fleet")["items"]}
    assert set(fleet) == {"lever", "other"}
    lever = fleet["lever"]
    assert lever["calibration"] == {"id": calibrated, "label": "spring", "activated": ANY_TIME, "error": 1.1}
    assert lever["alarms"] == {"critical": 1, "warning": 0, "info": 0, "waiting": 2}
    monitor = ask(guarded, "/machines/lever/monitor")
    assert (lever["monitor"], lever["reason"], lever["acquisition"]) == (monitor["state"], monitor["reason"], "off")
    assert fleet["other"]["calibration"] is None and fleet["other"]["alarms"]["critical"] == 1


class _AnyTime:
    def __eq__(self, other: object) -> bool:
        return isinstance(other, str) and datetime.fromisoformat(other).tzinfo is not None

    __hash__ = None  # type: ignore[assignment]


ANY_TIME = _AnyTime()


def test_who_is_bound_to_a_machine_sees_no_other(guarded: Guarded) -> None:
    assert [one["name"] for one in ask(guarded, "/fleet", "viewer", ("other",))["items"]] == ["other"]
    bound = guarded.bearer("admin", ("other",))
    assert guarded.client.get(f"{API}/machines/lever/history", headers=bound).status_code == 404
    assert guarded.client.get(f"{API}/logs", headers=bound).status_code == 403
    assert guarded.client.get(f"{API}/logs", headers=guarded.bearer("engineer")).status_code == 403


def joint(name: str, cusum: float) -> dict[str, Any]:
    return {
        "joint": name,
        "residual": 1.0,
        "unit": "N m",
        "cusum": cusum,
        "statistic": "offset",
        "threshold": 10.0,
        "false_alarms_per_year": 0.1,
        "learnt": 1.0,
    }


def test_of_several_joints_the_one_nearest_to_its_limit_is_shown() -> None:
    worst = worst_joint([joint("a", 2.0), joint("b", 8.0), joint("c", 3.0)])
    assert worst is not None and worst.joint == "b"
    assert worst_joint([]) is None


def test_a_machine_of_which_only_the_valves_are_watched_is_shown_by_these(
    guarded: Guarded, monkeypatch: pytest.MonkeyPatch
) -> None:
    valves = {"state": "drift", "joints": [joint("boom", 12.0)]}
    monkeypatch.setattr(Monitors, "state", lambda self, machine: {"state": "off", "reason": "x", "valves": valves})
    fleet = {one["name"]: one for one in ask(guarded, "/fleet")["items"]}
    lever = fleet["lever"]
    assert (lever["monitor"], lever["reason"], lever["joint"]["joint"]) == ("drift", None, "boom")


@pytest.mark.usefixtures("alarmed")
def test_the_history_is_one_time_line_newest_first(guarded: Guarded, calibrated: str) -> None:
    history = ask(guarded, "/machines/lever/history")
    items = history["items"]
    assert [one["time"] for one in items] == sorted((one["time"] for one in items), reverse=True)
    assert history["complete"]
    by_kind: dict[str, list[dict[str, Any]]] = {}
    for one in reversed(items):
        by_kind.setdefault(one["kind"], []).append(one)
    assert [one["subject"] for one in by_kind["file"]] == ["1"]
    found = by_kind["identification"][0]
    assert (found["subject"], found["what"], found["error"]) == ("idn-1", "effect_added", 1.1)
    effect = {"id": "stribeck", "joint": "joint1", "title": "Stribeck friction"}
    assert found["effects"] == [effect]
    steps = by_kind["calibration"]
    assert [one["what"] for one in steps] == ["proposed", "approved", "activated"]
    assert all(one["subject"] == calibrated and one["effects"] == [effect] for one in steps)
    assert steps[1]["by"] == "second"
    drift, alarm = by_kind["drift"][0], by_kind["alarm"][0]
    assert (drift["what"], drift["until"]) == ("residual_drift", ANY_TIME)
    assert (alarm["what"], alarm["severity"], alarm["until"]) == ("overload", "critical", None)


def test_what_is_older_is_left_out_unless_it_lasts(guarded: Guarded) -> None:
    service = guarded.running.service
    long_ago = (datetime.fromisoformat(service.now()) - timedelta(days=40)).isoformat()
    values = {
        "machine": "other",
        "kind": "disk_full",
        "text": "",
        "severity": "info",
        "acknowledged": False,
        "count": 1,
    }
    rows = [("gone", "cleared", long_ago), ("stays", "active", None)]
    with service[Database].write("alarms") as connection:
        for id, state, cleared in rows:
            row = values | {"id": id, "state": state, "cleared": cleared, "raised": long_ago}
            connection.execute(alarms.insert().values(**row))
    month = ask(guarded, "/machines/other/history?days=30")["items"]
    year = ask(guarded, "/machines/other/history?days=365")["items"]
    assert {"stays"} == {one["subject"] for one in month} & {"gone", "stays"}
    assert {"gone", "stays"} <= {one["subject"] for one in year}


def test_a_calibration_in_use_when_the_time_begins_is_in_it(guarded: Guarded, calibrated: str) -> None:
    """Of what was done before only that, so that a time line shows for how long it has been in use."""
    service = guarded.running.service
    later = datetime.fromisoformat(service.now()) + timedelta(seconds=1)
    found = gathered(service, "lever", as_stored(later)).items
    assert [(one.what, one.subject) for one in found if one.kind == "calibration"] == [("activated", calibrated)]


def test_a_report_that_is_gone_takes_no_history_with_it(guarded: Guarded) -> None:
    identify(guarded, "idn-2", "other")
    (guarded.running.service.files.identifications / "idn-2" / "report.json").unlink()
    found = [one for one in ask(guarded, "/machines/other/history")["items"] if one["kind"] == "identification"]
    assert [(one["subject"], one["effects"]) for one in found] == [("idn-2", [])]


@pytest.mark.slow
def test_the_log_is_read_on_from_where_one_was(guarded: Guarded) -> None:
    newest = ask(guarded, "/logs", "admin")["newest"]
    again = ask(guarded, f"/logs?after={newest}", "admin")
    assert again == {"items": [], "newest": newest}
