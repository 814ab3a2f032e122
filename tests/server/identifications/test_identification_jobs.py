"""Identifications as jobs: progress, result, failures, cancelling, idempotency, event streams."""

from __future__ import annotations

import dataclasses
import errno
import json
from pathlib import Path
from typing import Any, get_args

import pytest
from service_fakes import API, NICENESS, REPORT, Running, ran

from daq.messages import message_from_json
from fitting.loop.session import Options
from fitting.pipeline.stage_names import ReportLanguage
from fitting.report.languages import codes
from server.identifications.identification_resource import IdentificationOptions
from server.identifications.identification_results import IdentificationResults
from server.identifications.identification_store import Identification
from server.platform.processes import children
from server.platform.processes.children import ChildResult

pytestmark = pytest.mark.slow

IDENTIFICATIONS = f"{API}/identifications"


def outcome(running: Running, order: Identification) -> dict[str, Any]:
    """The job once it has ended."""
    running.follow(order.job)
    return dict(running.client.get(f"{API}/jobs/{order.job}").json())


def let_go(running: Running, order: Identification, stage: str) -> None:
    """Wait until a blocked stage runs, then let it finish."""
    running.follow(order.job, lambda event: event["text"] == f"Half of {stage}")
    (running.service.files.identifications / order.id / "go").touch()


def test_an_identification_runs_every_stage_and_stores_the_result(running: Running, csv: bytes) -> None:
    order = running.order(csv)
    events = running.follow(order.job)
    assert [event["number"] for event in events] == list(range(1, len(events) + 1))
    assert [event["state"] for event in events] == ["queued", *["running"] * (len(events) - 2), "done"]
    fractions = [event["fraction"] for event in events]
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0
    texts = [event["text"] for event in events]
    assert "Checking recordings and equations" in texts
    assert "Half of cylinder_stage" in texts
    identification = running.client.get(f"{IDENTIFICATIONS}/{order.id}").json()
    assert identification["verdict"] == "nothing_missing"
    assert identification["overall"] == REPORT["overall"]
    assert running.client.get(f"{IDENTIFICATIONS}/{order.id}/report.json").json() == REPORT
    missing = running.client.get(f"{IDENTIFICATIONS}/{order.id}/next-experiment.csv")
    assert (missing.status_code, "designed no next experiment" in missing.json()["detail"]) == (404, True)
    page = running.client.get(f"{IDENTIFICATIONS}/{order.id}/report.html")
    assert page.headers["content-type"].startswith("text/html")
    assert "default-src 'none'" in page.headers["content-security-policy"]
    assert "report</title>" in page.text and page.headers["content-language"] == "en"
    german = running.client.get(f"{IDENTIFICATIONS}/{order.id}/report.html", params={"language": "de"})
    assert "Bericht</title>" in german.text and german.headers["content-language"] == "de"
    assert german.headers["content-security-policy"] == page.headers["content-security-policy"]
    request = json.loads(next(running.service.files.identifications.glob(f"{order.id}/*/request.json")).read_text())
    assert request["languages"] == list(codes()) == list(get_args(ReportLanguage))
    assert running.client.get(IDENTIFICATIONS).json()["items"][0]["id"] == order.id
    assert running.client.get(f"{API}/jobs", params={"state": "done"}).json()["items"][0]["id"] == order.job


def test_a_page_in_a_language_that_there_is_not_is_english_or_refused(running: Running, csv: bytes) -> None:
    order = running.order(csv, english_only=True)
    running.follow(order.job)
    place = f"{IDENTIFICATIONS}/{order.id}/report.html"
    page = running.client.get(place, params={"language": "de"})
    assert (page.status_code, page.headers["content-language"]) == (200, "en") and "report</title>" in page.text
    refused = running.client.get(place, params={"language": "tlh"})
    assert refused.status_code == 422 and "language" in refused.text


def test_the_next_experiment_has_its_motion_and_an_unexamined_report_says_so(running: Running, csv: bytes) -> None:
    order = running.order(csv, next_experiment=True, looked=False)
    place = f"{IDENTIFICATIONS}/{order.id}"
    assert running.client.get(f"{place}/next-experiment.csv").status_code in (409, 200), "before the end there is none"
    running.follow(order.job)
    motion = running.client.get(f"{place}/next-experiment.csv")
    assert (motion.status_code, motion.headers["content-type"]) == (200, "text/csv; charset=utf-8")
    assert motion.text.startswith("# schema: hilfit/motion/1")
    assert f"{order.id}-next-experiment.csv" in motion.headers["content-disposition"]
    assert running.client.get(place).json()["verdict"] == "not_looked_for"
    made = running.client.post(f"{API}/calibrations", json={"identification": order.id, "label": ""})
    assert made.json()["verdict"] == "not_looked_for"


def test_stages_run_at_the_lowest_priority_in_processes_of_their_own(
    running: Running, csv: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(children, "NICENESS", NICENESS)
    order = running.order(csv)
    running.follow(order.job)
    lines = (running.service.files.identifications / order.id / "ran.txt").read_text().split("\n")[:-1]
    assert [line.split()[0] for line in lines] == ["check", "cylinder_stage", "report"]
    assert len({line.split()[1] for line in lines}) == 3
    assert {line.split()[2] for line in lines} == {"19"}


def test_location_is_the_job_and_there_is_no_report_before_the_end(running: Running, csv: bytes) -> None:
    order = running.order(csv, block="cylinder_stage")
    report = running.client.get(f"{IDENTIFICATIONS}/{order.id}/report.json")
    assert report.status_code == 409
    let_go(running, order, "cylinder_stage")
    assert outcome(running, order)["state"] == "done"


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"fail": ["check", 2, "run.csv: joint1.torque: is saturated"]}, "run.csv: joint1.torque: is saturated"),
        ({"fail": ["check", 2, "{output}/a.csv: is empty"]}, "identifications/idn-"),
        ({"fail": ["cylinder_stage", 1, "no convergence"]}, "stage cylinder_stage: no convergence"),
        ({"crash": "cylinder_stage"}, "SIGKILL"),
        ({"silent": "check"}, "without a result"),
        ({"no_report": True}, "no report"),
    ],
)
def test_a_stage_that_fails_ends_the_job_and_says_why(
    running: Running, csv: bytes, options: dict[str, Any], says: str
) -> None:
    order = running.order(csv, **options)
    job = outcome(running, order)
    assert job["state"] == "failed"
    assert says in job["error"]
    assert "\n" not in job["error"]
    assert str(running.service.files.root) not in job["error"]
    made_of = job["error_message"]  # none of a line that a stage wrote by itself
    assert (made_of is None) == (options["fail"][1] == 2 if "fail" in options else False)
    assert made_of is None or message_from_json(made_of) == job["error"]
    assert running.client.get(f"{IDENTIFICATIONS}/{order.id}/report.json").status_code == 409


def test_the_log_of_a_stage_keeps_its_standard_error(running: Running, csv: bytes) -> None:
    order = running.order(csv, fail=["check", 1, "it failed"])
    outcome(running, order)
    log = running.service[IdentificationResults].directory(order.id) / "check.log"
    assert "details for the log" in log.read_text()


def test_cancelling_ends_a_running_stage(running: Running, csv: bytes) -> None:
    order = running.order(csv, block="cylinder_stage")
    running.follow(order.job, lambda event: event["text"] == "Half of cylinder_stage")
    response = running.client.post(f"{API}/jobs/{order.job}/cancel")
    assert response.status_code == 202
    assert response.json()["cancel_requested"]
    job = outcome(running, order)
    assert (job["state"], job["error"]) == ("cancelled", None)
    path = running.service.files.identifications / order.id / "ran.txt"
    process = int(path.read_text().splitlines()[-1].split()[1])
    assert not Path(f"/proc/{process}").exists()
    again = running.client.post(f"{API}/jobs/{order.job}/cancel").json()
    assert again == job


def test_a_waiting_job_is_cancelled_at_once_and_never_starts(running: Running, csv: bytes) -> None:
    first = running.order(csv, block="check")
    second = running.order(csv)
    cancelled = running.client.post(f"{API}/jobs/{second.job}/cancel").json()
    assert cancelled["state"] == "cancelled"
    let_go(running, first, "check")
    assert outcome(running, first)["state"] == "done"
    third = running.order(csv)  # jobs run in order: once it is done, the second has had its turn
    assert outcome(running, third)["state"] == "done"
    assert not (running.service.files.identifications / second.id).exists()
    assert outcome(running, second)["state"] == "cancelled"


def test_an_idempotency_key_makes_one_job(running: Running, csv: bytes) -> None:
    body = {"machine": "lever", "recordings": running.choices(csv)}
    headers = {"Idempotency-Key": "tablet-1"}
    first = running.client.post(IDENTIFICATIONS, json=body, headers=headers)
    second = running.client.post(IDENTIFICATIONS, json=body, headers=headers)
    assert first.status_code == second.status_code == 202
    assert first.json() == second.json()
    assert first.headers["location"] == second.headers["location"] == f"{API}/jobs/{first.json()['job']}"
    other = running.client.post(IDENTIFICATIONS, json={**body, "label": "other"}, headers=headers)
    assert other.status_code == 409
    fresh = running.client.post(IDENTIFICATIONS, json=body, headers={"Idempotency-Key": "tablet-2"})
    assert fresh.json()["id"] != first.json()["id"]
    for made in (first, fresh):
        assert running.follow(made.json()["job"])[-1]["state"] == "done"


def test_orders_that_make_no_sense_are_refused(running: Running, csv: bytes) -> None:
    train, validate = running.choices(csv)
    for recordings, says in (
        ([train], "validate"),
        ([train, train, validate], "twice"),
        ([train, validate, {"id": "absent"}], "absent"),
        ([train, {**validate, "role": "train"}], "validate"),
    ):
        response = running.client.post(IDENTIFICATIONS, json={"machine": "lever", "recordings": recordings})
        assert response.status_code in (404, 422)
        assert says in response.json()["detail"]
    unknown = running.client.post(IDENTIFICATIONS, json={"machine": "absent", "recordings": [train, validate]})
    assert unknown.status_code == 404


def test_options_are_those_of_the_fitting_side(running: Running, csv: bytes) -> None:
    theirs = {field.name: field.default for field in dataclasses.fields(Options)}
    assert IdentificationOptions().model_dump() == theirs
    body = {"machine": "lever", "recordings": running.choices(csv), "options": {"lop": False}}
    response = running.client.post(IDENTIFICATIONS, json=body)
    assert response.status_code == 422
    assert "lop" in response.json()["detail"]


def test_recordings_in_use_cannot_be_deleted(running: Running, csv: bytes) -> None:
    order = running.order(csv)
    response = running.client.delete(f"{API}/recordings/{order.recordings[0][0]}")
    assert response.status_code == 409
    assert "is the data of identification" in response.json()["detail"]
    assert outcome(running, order)["state"] == "done"


def events_of(text: str) -> list[dict[str, Any]]:
    """Server-sent events of a stream (HTML standard, section 9.2.6)."""
    events = []
    for block in text.strip().split("\n\n"):
        fields = dict(line.split(": ", 1) for line in block.split("\n") if not line.startswith(":"))
        events.append({"id": int(fields["id"]), "event": fields["event"], **json.loads(fields["data"])})
    return events


def test_the_event_stream_ends_with_the_job_and_resumes_where_a_client_left(running: Running, csv: bytes) -> None:
    order = running.order(csv)
    with running.client.stream("GET", f"{API}/jobs/{order.job}/events") as response:
        assert response.headers["content-type"].startswith("text/event-stream")
        events = events_of(response.read().decode())
    assert [event["id"] for event in events] == list(range(1, len(events) + 1))
    assert {event["event"] for event in events} == {"progress"}
    assert events[-1]["state"] == "done"
    rest = running.client.get(f"{API}/jobs/{order.job}/events", headers={"Last-Event-ID": "3"})
    assert events_of(rest.text) == events[3:]


def test_the_request_that_a_stage_gets(running: Running, csv: bytes) -> None:
    order = running.order(csv, anything=[1, 2])
    running.follow(order.job)
    output = running.service[IdentificationResults].directory(order.id)
    request = json.loads((output / "request.json").read_text())
    assert request["options"] == {"anything": [1, 2]}
    assert request["output"] == str(output)
    assert [role for role, _ in request["recordings"]] == ["train", "validate"]
    assert all(Path(path).is_file() for _, path in request["recordings"])
    assert Path(request["machine"]).is_file()
    assert ran(running, order.id) == ["check", "cylinder_stage", "report"]


def test_a_stage_that_cannot_be_started_fails_the_job(
    running: Running, csv: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object, **__: object) -> ChildResult:
        raise OSError(errno.ENOSPC, "No space left on device")

    running.choices(csv)  # uploaded while children can be started
    with monkeypatch.context() as patch:
        patch.setattr("server.jobs.execution.Child.run", full)
        job = outcome(running, running.order(csv))
    assert job["state"] == "failed"
    assert "No space left on device" in job["error"]
