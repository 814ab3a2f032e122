"""Identifications of valves over REST: order, files, refusals, with a fake stage."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from typing import Any, get_args

import pytest
from service_fakes import API, Running, recording_bytes

from fitting.valve.export import export_valve, formats
from fitting.valve.inverse import Direction, ValveModel
from server.valves.valve_fits import ValveOrders
from server.valves.valve_resource import ENDINGS, InverseFormat

VALVES = f"{API}/valves"


def ordered(running: Running, csv: bytes, **more: Any) -> dict[str, Any]:
    """An order that was taken, and followed to its end."""
    body = {"machine": "lever", "recordings": running.choices(csv), **more}
    answer = running.client.post(VALVES, json=body)
    assert answer.status_code == 202, answer.text
    made: dict[str, Any] = answer.json()
    assert answer.headers["location"] == f"{API}/jobs/{made['job']}"
    running.follow(made["job"])
    return made


def names(content: bytes) -> list[str]:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        return archive.namelist()


@pytest.mark.slow
def test_an_order_becomes_a_report_and_inverses(running: Running, csv: bytes) -> None:
    made = ordered(running, csv, label="day 1")
    place = f"{VALVES}/{made['id']}"
    job = running.client.get(f"{API}/jobs/{made['job']}").json()
    assert (job["state"], job["kind"], job["subject"], job["stages"]) == ("done", "valve", made["id"], ["valve"])
    found = running.client.get(place).json()
    assert found["axes"]["joint1"] == {
        "verdict": "effect_added",
        "handed_out": "model",
        "error": 0.031,
        "judged_on": "validate",
        "delay": 0.16,
        "edges": {"extend": 0.056},
        "speeds": {"extend": 0.21},
        "effects": [{"id": "spool_hysteresis", "probability": 0.99}],
    }
    assert made | {"axes": found["axes"]} == found == running.client.get(VALVES).json()["items"][0]
    assert running.client.get(f"{place}/valve.json").json()["schema"] == "hilfit/valve/1"
    whole = running.client.get(f"{place}/inverse.zip")
    assert (whole.status_code, whole.headers["content-type"]) == (200, "application/zip")
    assert names(whole.content) == ["valve_joint1.c", "valve_joint1.h", "valve_joint1.st"]
    assert whole.content == running.client.get(f"{place}/inverse.zip").content, "the same files, the same archive"
    one = running.client.get(f"{place}/inverse.zip", params={"format": "st"})
    assert names(one.content) == ["valve_joint1.st"]
    assert f'filename="{made["id"]}-inverse-st.zip"' in one.headers["content-disposition"]
    assert running.client.get(f"{place}/inverse.zip", params={"format": "csv"}).status_code == 404
    assert running.client.get(f"{place}/inverse.zip", params={"format": "../valve"}).status_code == 422


@pytest.mark.slow
def test_valves_are_approved_and_used_as_calibrations_are_beside_those_of_the_mechanics(
    running: Running, csv: bytes
) -> None:
    place = f"{API}/calibrations"
    used = []
    for label in ("spring", "autumn"):
        made = ordered(running, csv, label=label)
        proposed = running.client.post(place, json={"valves": made["id"]})
        assert (proposed.status_code, proposed.json()["label"]) == (201, label), proposed.text
        again = running.client.post(place, json={"valves": made["id"]})
        assert (again.status_code, again.json()["id"]) == (200, proposed.json()["id"])
        assert running.client.post(f"{place}/{proposed.json()['id']}/activate").status_code == 409, "nobody approved it"
        running.client.post(f"{place}/{proposed.json()['id']}/approve", json={"note": "as measured"})
        used.append(running.client.post(f"{place}/{proposed.json()['id']}/activate").json())
    first, second = used
    assert (second["state"], second["valves"], second["identification"]) == ("active", made["id"], None)
    assert second["verdict"] == "effect_added"
    assert second["errors"]["joint1"]["after"] == {"validate": 0.031}
    names = [own["name"] for own in second["parameters"]]
    assert names == ["joint1.delay", "joint1.extend.edge_at_2_percent", "joint1.extend.speed_at_largest"]
    model = running.client.get(f"{place}/{second['id']}/model.json").json()
    assert (model["valves"], model["axes"]) == (made["id"], {"joint1": {"schema": "hilfit/valve-model/1"}})

    identified = running.client.post(
        f"{API}/identifications", json={"machine": "lever", "recordings": running.choices(csv)}
    ).json()
    running.follow(identified["job"])
    other = running.client.post(place, json={"identification": identified["id"]}).json()
    for verb in ("approve", "activate"):
        running.client.post(f"{place}/{other['id']}/{verb}", **({"json": {}} if verb == "approve" else {}))
    listed = running.client.get(place, params={"machine": "lever", "state": "active"}).json()["items"]
    assert {own["id"] for own in listed} == {second["id"], other["id"]}, "one of each is in use"
    steps = running.client.get(f"{API}/machines/lever/history").json()["items"]
    assert {own["subject"] for own in steps if own["kind"] == "calibration"} == {other["id"]}, "of the mechanics"
    mixed = running.client.get(f"{place}/compare", params={"a": first["id"], "b": other["id"]})
    assert mixed.status_code == 409 and "two of a kind" in mixed.json()["detail"]
    compared = running.client.get(f"{place}/compare", params={"a": first["id"], "b": second["id"]}).json()
    assert compared["parameters"][0]["sigmas"] == 0.0

    back = f"{API}/machines/lever/calibrations/rollback"
    assert running.client.post(back).status_code == 409, "there is none before"
    assert running.client.post(back, params={"of": "valves"}).json()["id"] == first["id"]
    assert running.client.get(f"{place}/{other['id']}").json()["state"] == "active"
    for wrong in ({}, {"valves": made["id"], "identification": identified["id"]}):
        assert running.client.post(place, json=wrong).status_code == 422


def test_every_format_of_an_inverse_has_its_endings(tmp_path: Path) -> None:
    assert set(ENDINGS.values()) == set(get_args(InverseFormat)) == set(formats())
    way = Direction(0.05, 0.3, 1.0, (), (), "none", {}, 1e5, 1e5, 0.8)
    model = ValveModel("boom", "1", 0, 1, 1, -1, 1, 0.1, (way, way), (0.01, 0.005), None, (), None)
    for name in formats():
        suffixes = {path.suffix for path in export_valve(model, name, tmp_path).files}
        assert suffixes == {ending for ending, own in ENDINGS.items() if own == name}


@pytest.mark.slow
def test_one_key_makes_one_job_and_another_order_under_it_is_refused(running: Running, csv: bytes) -> None:
    body = {"machine": "lever", "recordings": running.choices(csv)}
    headers = {"Idempotency-Key": "valve-1"}
    first, second = (running.client.post(VALVES, json=body, headers=headers) for _ in range(2))
    assert (first.status_code, first.json()) == (202, second.json())
    other = running.client.post(f"{API}/identifications", json=body, headers=headers)
    assert (other.status_code, other.json()["code"]) == (409, "key_used")
    plain = {**body, "options": {"loop": False}}
    assert running.client.post(VALVES, json=plain, headers=headers).status_code == 409
    assert running.follow(first.json()["job"])[-1]["state"] == "done"


@pytest.mark.slow
def test_the_same_words_for_an_identification_and_for_valves_are_two_requests(running: Running, csv: bytes) -> None:
    """Whatever their contents: what tells them apart is no option."""
    body = {"machine": "lever", "recordings": running.choices(csv)}
    headers = {"Idempotency-Key": "valve-2"}
    assert running.client.post(f"{API}/identifications", json=body, headers=headers).status_code == 202
    assert running.client.post(VALVES, json=body, headers=headers).status_code == 409


@pytest.mark.slow
def test_orders_that_make_no_sense_are_refused(running: Running, csv: bytes) -> None:
    train, validate = running.choices(csv)
    for recordings, status, says in (
        ([validate], 422, "no recording in the role 'train'"),
        ([train, train], 422, "twice"),
        ([train, {"id": "absent"}], 404, "absent"),
        ([], 422, "recordings"),
    ):
        answer = running.client.post(VALVES, json={"machine": "lever", "recordings": recordings})
        assert (answer.status_code, says in answer.text) == (status, True), answer.text
    unknown = {"machine": "lever", "recordings": [train], "options": {"command": 0.1}}
    assert running.client.post(VALVES, json=unknown).status_code == 422
    absent = running.client.get(f"{VALVES}/vlv-absent")
    assert absent.status_code == 404
    assert absent.json()["detail"] == "there is no identification of valves 'vlv-absent'"


@pytest.mark.slow
def test_a_recording_that_valves_were_identified_from_stays(running: Running, csv: bytes) -> None:
    train, _ = running.choices(csv)
    own = running.upload(recording_bytes(running.service.files.root, seconds=9), "train", "own.csv")
    body = {"machine": "lever", "recordings": [{"id": own}]}
    made = running.client.post(VALVES, json=body).json()
    running.follow(made["job"])
    answer = running.client.delete(f"{API}/recordings/{own}")
    assert answer.status_code == 409
    assert f"is the data of valve '{made['id']}'" in answer.json()["detail"]
    assert train["id"] != own


def steered(running: Running, csv: bytes, **options: Any) -> dict[str, Any]:
    """An order past the check of its options, which steer the fake stage; its job once it has ended."""
    from server.identifications.identification_order import Wish

    recordings = tuple((choice["id"], None) for choice in running.choices(csv))
    made = running.service[ValveOrders].order(Wish("lever", recordings, options, ""), None)
    running.follow(made.job)
    job: dict[str, Any] = running.client.get(f"{API}/jobs/{made.job}").json()
    return job


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"fail": ["valve", 2, "run.csv: joint1: has no valve"]}, "run.csv: joint1: has no valve"),
        ({"crash": "valve"}, "SIGKILL"),
        ({"no_report": True}, "no report"),
    ],
)
def test_a_stage_that_fails_says_why_and_leaves_nothing(
    running: Running, csv: bytes, options: dict[str, Any], says: str
) -> None:
    job = steered(running, csv, **options)
    assert job["state"] == "failed" and says in job["error"]
    place = f"{VALVES}/{job['subject']}"
    assert running.client.get(place).json()["axes"] is None
    for file in ("valve.json", "inverse.zip"):
        answer = running.client.get(f"{place}/{file}")
        assert (answer.status_code, "its job" in answer.json()["detail"]) == (409, True)


@pytest.mark.slow
def test_valves_that_never_moved_have_no_inverse(running: Running, csv: bytes) -> None:
    job = steered(running, csv, inverses=[])
    answer = running.client.get(f"{VALVES}/{job['subject']}/inverse.zip")
    assert (answer.status_code, "none was seen to move" in answer.json()["detail"]) == (404, True)


@pytest.mark.slow
def test_cancelling_ends_it(running: Running, csv: bytes) -> None:
    from server.identifications.identification_order import Wish

    recordings = tuple((choice["id"], None) for choice in running.choices(csv))
    made = running.service[ValveOrders].order(Wish("lever", recordings, {"block": "valve"}, ""), None)
    running.follow(made.job, lambda event: event["text"] == "Half of valve")
    assert running.client.post(f"{API}/jobs/{made.job}/cancel").status_code == 202
    assert running.follow(made.job)[-1]["state"] == "cancelled"
