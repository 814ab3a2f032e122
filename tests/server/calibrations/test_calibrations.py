"""Calibrations: proposed by one, approved by another, one in use per machine, and the way back."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from typing import Any

import pytest
from access_fakes import Guarded, guarded_service
from service_fakes import API, Running, recording_bytes

from server.audit.audit_resource import Audit
from server.calibrations.calibration_content import Parameter, content_of
from server.calibrations.calibration_desk import ByPolicy, Calibrations
from server.calibrations.calibration_resource import compare_errors, compare_parameters
from server.identifications.identification_order import IdentificationOrders, Wish
from server.identifications.identification_results import IdentificationResults
from server.platform.authorization.principals import LOCAL, SERVICE
from server.platform.database.engine import Database
from server.platform.errors import ConflictError
from server.platform.files import DataDirectory
from server.platform.settings import Settings

pytestmark = pytest.mark.slow

PLACE = f"{API}/calibrations"


def report(friction: float, std: float = 3.0) -> dict[str, Any]:
    """A report with one parameter of each kind."""
    errors = {"unit": "N m", "noise_floor": 0.5, "before": {"validate": 2.1}, "after": {"validate": friction / 100}}
    effect = {"id": "stribeck", "joint": "joint1", "parameters": {"f_b": {"value": 5.0, "std": 0.5, "unit": "N"}}}
    return {
        "schema": "hilfit/report/1",
        "machine": "lever",
        "cylinders": {"joint1": {"parameters": {"f_c": {"value": friction, "std": std, "unit": "N"}}}},
        "rigid_body": {"parameters": [{"expression": "ZZ1", "value": 31.2, "std": 0.1, "unit": "kg m^2"}]},
        "errors": {"joint1": errors},
        "overall": {"before": 1.0, "after": 0.4},
        "loop": {"verdict": "effect_added", "effects": [effect], "candidates": [{"id": "backlash"}]},
    }


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Guarded]:
    with guarded_service(tmp_path_factory.mktemp("data")) as service:
        yield service


@pytest.fixture(scope="module")
def recordings(guarded: Guarded, tmp_path_factory: pytest.TempPathFactory) -> tuple[tuple[str, None], ...]:
    content = recording_bytes(tmp_path_factory.mktemp("made"))
    found = []
    for role in ("train", "validate"):
        query = {"machine": "lever", "role": role, "name": "made.csv"}
        made = guarded.client.post(
            f"{API}/recordings/upload", params=query, content=content, headers=guarded.bearer("operator")
        )
        found.append((made.json()["id"], None))
    return tuple(found)


@pytest.fixture
def identified(guarded: Guarded, recordings: tuple[tuple[str, None], ...]) -> Any:
    """Makes identifications that are done, with a report of one's own."""

    def make(content: dict[str, Any]) -> str:
        running: Running = guarded.running
        identification = running.service[IdentificationOrders].order(Wish("lever", recordings, {}, "of a test"), None)
        assert running.follow(identification.job)[-1]["state"] == "done"
        path = running.service[IdentificationResults].directory(identification.id) / "report.json"
        path.write_text(json.dumps(content))
        return identification.id

    return make


def act(guarded: Guarded, id: str, verb: str, role: str = "engineer", **more: Any) -> Any:
    headers = guarded.bearer(role) | more.pop("headers", {})  # type: ignore[arg-type]
    body = {} if verb == "activate" else {"json": {"note": "as measured"}}
    return guarded.client.post(f"{PLACE}/{id}/{verb}", headers=headers, **body)


def propose(guarded: Guarded, identification: str, role: str = "operator") -> Any:
    body = {"identification": identification, "label": "after the new seals"}
    return guarded.client.post(PLACE, json=body, headers=guarded.bearer(role))  # type: ignore[arg-type]


def test_from_a_proposal_to_use_and_back(guarded: Guarded, identified: Any) -> None:
    viewer = guarded.bearer("viewer")
    ids = []
    for friction in (80.0, 92.0):
        made = propose(guarded, identified(report(friction)))
        assert made.status_code == 201, made.text
        assert made.json()["state"] == "proposed"
        assert made.headers["location"] == f"{PLACE}/{made.json()['id']}"
        ids.append(made.json()["id"])
        assert act(guarded, ids[-1], "activate").status_code == 409, "nobody approved it"
        approved = act(guarded, ids[-1], "approve").json()
        assert (approved["state"], approved["approved_by"], approved["note"]) == (
            "approved",
            "a engineer",
            "as measured",
        )
        assert act(guarded, ids[-1], "activate").json()["state"] == "active"
    first, second = ids
    service = guarded.running.service

    def states() -> list[str]:
        return [guarded.client.get(f"{PLACE}/{id}", headers=viewer).json()["state"] for id in ids]

    assert states() == ["retired", "active"]
    active = service[Calibrations].active("lever")
    assert active is not None and active.id == second
    listed = guarded.client.get(PLACE, params={"machine": "lever", "state": "active"}, headers=viewer).json()["items"]
    assert [row["id"] for row in listed] == [second]

    place = f"{API}/machines/lever/calibrations/rollback"
    assert guarded.client.post(place, headers=guarded.bearer("operator")).status_code == 403
    assert guarded.client.post(place, headers=guarded.bearer("engineer")).json()["id"] == first
    assert states() == ["active", "retired"]
    assert guarded.client.post(place, headers=guarded.bearer("engineer")).status_code == 409, "there is none before"
    assert act(guarded, second, "activate").json()["state"] == "active"
    assert states() == ["retired", "active"]

    compared = guarded.client.get(f"{PLACE}/compare", params={"a": first, "b": second}, headers=viewer).json()
    shift = compared["parameters"][0]
    assert (shift["name"], shift["a"], shift["b"]) == ("joint1.f_c", 80.0, 92.0)
    assert shift["sigmas"] == pytest.approx(12 / math.sqrt(18))
    assert compared["errors"]["joint1"] == {"unit": "N m", "a": 0.8, "b": 0.92}

    model = guarded.client.get(f"{PLACE}/{second}/model.json", headers=viewer)
    assert "attachment" in model.headers["content-disposition"]
    assert model.json()["schema"] == "hilfit/calibration/1", "a stage of old wrote no model"
    assert model.json()["cylinders"] == report(92.0)["cylinders"]
    assert model.json()["effects"] == report(92.0)["loop"]["effects"]


def test_the_first_activation_can_be_undone(guarded: Guarded, identified: Any) -> None:
    """None is in use then, the same one can be used again, and rolling back leads past it to nothing."""
    service = guarded.running.service
    if (earlier := service[Calibrations].active("lever")) is not None:
        service[Calibrations].deactivate(earlier.id, None, LOCAL, "")
    id = propose(guarded, identified(report(70.0))).json()["id"]
    assert act(guarded, id, "deactivate").status_code == 409, "it is not in use"
    for verb in ("approve", "activate"):
        act(guarded, id, verb)
    assert act(guarded, id, "deactivate", "operator").status_code == 403
    undone = act(guarded, id, "deactivate").json()
    assert (undone["state"], undone["history"][-1]["action"], undone["history"][-1]["note"]) == (
        "retired",
        "retired",
        "taken out of use: as measured",
    )
    assert service[Calibrations].active("lever") is None
    back = f"{API}/machines/lever/calibrations/rollback"
    assert guarded.client.post(back, headers=guarded.bearer("engineer")).status_code == 409
    assert act(guarded, id, "activate").json()["state"] == "active"
    act(guarded, id, "deactivate")


def test_the_model_says_which_calibration_it_is(guarded: Guarded, identified: Any) -> None:
    """The model of the identification, its provenance completed, and else untouched."""
    id = propose(guarded, identified(report(70.0)), "engineer").json()["id"]
    service = guarded.running.service
    results = IdentificationResults(service[Database], service[DataDirectory])
    folder = results.directory(service[Calibrations].get(id).identification)
    written = {"schema": "hilfit/model/1", "provenance": {"verdict": "x", "calibration": None}, "told": [True]}
    (folder / "model.json").write_text(json.dumps(written))
    found = guarded.client.get(f"{PLACE}/{id}/model.json", headers=guarded.bearer("viewer")).json()
    assert found["provenance"] == {"verdict": "x", "calibration": id}
    assert (found["schema"], found["told"], found["state"]) == ("hilfit/model/1", [True], "proposed")
    (folder / "model.json").write_text("torn {")
    torn = guarded.client.get(f"{PLACE}/{id}/model.json", headers=guarded.bearer("viewer")).json()
    assert torn["schema"] == "hilfit/calibration/1"


def test_who_proposed_may_not_approve(guarded: Guarded, identified: Any) -> None:
    id = propose(guarded, identified(report(70.0)), "engineer").json()["id"]
    refused = act(guarded, id, "approve")
    assert refused.status_code == 409
    assert "second person" in refused.json()["detail"]
    assert act(guarded, id, "approve", "operator").status_code == 403
    assert act(guarded, id, "approve", "admin").json()["approved_by"] == "a admin"


def test_a_rejected_one_stays_rejected(guarded: Guarded, identified: Any) -> None:
    identification = identified(report(70.0))
    id = propose(guarded, identification).json()["id"]
    assert act(guarded, id, "reject").json()["state"] == "rejected"
    for verb in ("approve", "reject", "activate"):
        assert act(guarded, id, verb).status_code == 409
    again = propose(guarded, identification)
    assert (again.status_code, again.json()["id"], again.json()["state"]) == (200, id, "rejected")


def test_a_change_with_an_outdated_etag_is_refused(guarded: Guarded, identified: Any) -> None:
    made = propose(guarded, identified(report(70.0)))
    id, tag = made.json()["id"], made.headers["etag"]
    approved = act(guarded, id, "approve", headers={"If-Match": tag})
    assert approved.status_code == 200
    assert approved.headers["etag"] != tag
    assert act(guarded, id, "activate", headers={"If-Match": tag}).status_code == 412
    assert act(guarded, id, "activate", headers={"If-Match": "nonsense"}).status_code == 412
    assert guarded.client.get(f"{PLACE}/{id}", headers=guarded.bearer("viewer")).json()["state"] == "approved"


def test_only_what_is_done_can_be_proposed(guarded: Guarded, identified: Any) -> None:
    assert propose(guarded, "idn-nowhere").status_code == 404
    broken = identified({"loop": {}})
    assert propose(guarded, broken).status_code == 422
    path = guarded.running.service[IdentificationResults].directory(broken) / "report.json"
    path.unlink()
    assert propose(guarded, broken).status_code == 409


def test_what_a_policy_does_is_in_the_audit_log(guarded: Guarded, identified: Any) -> None:
    service = guarded.running.service
    policy = ByPolicy(service[Calibrations], service[Audit])
    identification = identified(report(60.0))
    made = policy.propose(identification, "nightly")
    assert policy.propose(identification, "nightly").id == made.id
    policy.activate(made.id, "better by 10 %")
    policy.activate(made.id, "again")
    active = policy.active("lever")
    assert active is not None
    assert (active.id, active.approved_by, active.note) == (made.id, SERVICE.name, "better by 10 %")
    traces = [entry for entry in service[Audit].list(50).items if entry.subject == made.id]
    assert [entry.action for entry in traces] == ["calibrations.activate", "calibrations.propose"]


def test_parameters_are_named_by_what_they_belong_to() -> None:
    names = [entry.name for entry in content_of(report(1.0)).parameters]
    assert names == ["joint1.f_c", "ZZ1", "stribeck:joint1.f_b"]
    assert "candidates" not in content_of(report(1.0)).model


def test_parameters_that_one_of_them_lacks_and_units_that_differ_have_no_shift() -> None:
    a = [Parameter(name=name, value=1.0, std=0.1, unit="N") for name in ("p", "q")]
    b = [Parameter(name="q", value=2.0, std=0.1, unit="kN"), Parameter(name="r", value=1.0, std=None, unit="m")]
    shifts = compare_parameters(a, b)
    assert [(shift.name, shift.a, shift.b, shift.sigmas) for shift in shifts] == [
        ("p", 1.0, None, None),
        ("q", 1.0, 2.0, None),
        ("r", None, 1.0, None),
    ]
    assert compare_errors({"j": {"unit": "N", "after": {}}}, {"k": {"unit": "N", "after": {"validate": 1}}}) == {
        "j": {"unit": "N", "a": None, "b": None},
        "k": {"unit": "N", "a": None, "b": 1.0},
    }


def test_history_says_who_and_when(guarded: Guarded, identified: Any) -> None:
    first, second = (propose(guarded, identified(report(size))).json()["id"] for size in (80.0, 81.0))
    for id in (first, second):
        act(guarded, id, "approve")
        act(guarded, id, "activate", "admin")
    found = guarded.client.get(f"{PLACE}/{first}", headers=guarded.bearer("viewer")).json()
    steps = [(step["action"], step["by"]) for step in found["history"]]
    assert steps == [
        ("proposed", "a operator"),
        ("approved", "a engineer"),
        ("activated", "a admin"),
        ("retired", "a admin"),
    ]
    assert [step["time"] for step in found["history"]] == sorted(step["time"] for step in found["history"])


def test_whoever_ordered_a_recalibration_does_not_approve_what_it_proposes(guarded: Guarded, identified: Any) -> None:
    """It is the service that proposes, in the name of the person who ordered it."""
    admin, other = (
        guarded.client.get(f"{API}/access/me", headers=guarded.bearer(r)).json() for r in ("admin", "engineer")
    )
    policy = guarded.running.service[ByPolicy]
    made = policy.propose(identified(report(80.0)), "", (admin["id"], admin["name"]))
    assert (made.proposed_by_id, made.proposed_by) == (admin["id"], admin["name"])
    place = f"{API}/calibrations/{made.id}/approve"
    refused = guarded.client.post(place, json={}, headers=guarded.bearer("admin"))
    assert refused.status_code == 409
    assert (refused.json()["code"], refused.json()["values"]) == ("second_person", {"calibration": made.id})
    assert "a second person has to approve it" in refused.json()["detail"]
    approved = guarded.client.post(place, json={}, headers=guarded.bearer("engineer"))
    assert approved.json()["approved_by"] == other["name"]


@pytest.mark.parametrize("second_person", [True, False])
def test_whether_one_person_is_enough_is_a_policy(guarded: Guarded, identified: Any, second_person: bool) -> None:
    """On this computer only there is one principal: it may approve its own unless the policy says otherwise."""
    assert Settings(second_person=None, access="loopback").approves_own
    assert not Settings(second_person=None, access="required").approves_own
    service = guarded.running.service
    calibrations = Calibrations(service.database, service.files, Settings(second_person=second_person).approves_own)
    made, _ = calibrations.propose(identified(report(80.0)), "", LOCAL)
    if second_person:
        with pytest.raises(ConflictError, match="second person"):
            calibrations.decide(made.id, "approved", LOCAL, "", None)
    else:
        assert calibrations.decide(made.id, "approved", LOCAL, "", None).approved_by == "local"
