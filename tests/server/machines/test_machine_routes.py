"""Machine files: upload, versions, reading back, acquisition and live values."""

from __future__ import annotations

import pytest
from acquired_machines import MACHINES, acquire, named
from service_fakes import API, Running

from server.machines.acquisition import Acquisition
from server.machines.machine_uploads import MachineUploads
from server.platform.errors import UnavailableError


def test_upload_makes_versions(running: Running) -> None:
    first = running.client.post(MACHINES, content=named("versions"))
    assert first.status_code == 201
    assert first.headers["location"] == f"{MACHINES}/versions"
    assert first.json()["version"] == 1
    again = running.client.post(MACHINES, content=named("versions"))
    assert (again.status_code, again.json()["version"]) == (200, 1)
    changed = named("versions").replace("velocity: 1.0", "velocity: 1.5")
    assert running.client.post(MACHINES, content=changed).json()["version"] == 2
    detail = running.client.get(f"{MACHINES}/versions").json()
    assert detail["versions"] == [2, 1]
    assert detail["machine"]["joints"][0]["limits"]["velocity"] == 1.5
    old = running.client.get(f"{MACHINES}/versions", params={"version": 1}).json()
    assert (old["version"], old["current"]) == (1, 2)
    assert old["machine"]["joints"][0]["limits"]["velocity"] == 1.0


def test_two_who_change_one_file_do_not_overwrite_each_other(running: Running) -> None:
    new = running.client.post(MACHINES, content=named("shared"), headers={"If-Match": '"0"'})
    assert (new.status_code, new.headers["etag"]) == (201, '"1"')
    read = running.client.get(f"{MACHINES}/shared/file").headers["etag"]
    assert running.client.get(f"{MACHINES}/shared").headers["etag"] == read == '"1"'
    mine, other = (named("shared").replace("velocity: 1.0", f"velocity: {speed}") for speed in (1.5, 2.5))
    assert running.client.post(MACHINES, content=other, headers={"If-Match": read}).status_code == 201
    refused = running.client.post(MACHINES, content=mine, headers={"If-Match": read})
    assert refused.status_code == 412
    assert "version 2 by now, not 1" in refused.json()["detail"]
    assert running.client.get(f"{MACHINES}/shared/file").text == other
    # The same text again changes nothing: it is no conflict, whoever sent it.
    assert running.client.post(MACHINES, content=other, headers={"If-Match": read}).status_code == 200
    now = running.client.get(f"{MACHINES}/shared", params={"version": 1}).headers["etag"]
    assert running.client.post(MACHINES, content=mine, headers={"If-Match": now}).json()["version"] == 3
    assert running.client.post(MACHINES, content=mine + "#", headers={"If-Match": "mine"}).status_code == 412
    taken = running.client.post(MACHINES, content=named("shared") + "# new\n", headers={"If-Match": '"0"'})
    assert taken.status_code == 412


def test_a_check_says_what_an_upload_would_and_stores_nothing(running: Running) -> None:
    before = running.client.get(MACHINES).json()
    check = running.client.post(f"{MACHINES}/check", content=named("draft"))
    assert (check.status_code, check.json()) == (200, {"name": "draft", "version": 1})
    assert running.client.get(MACHINES).json() == before
    running.client.post(MACHINES, content=named("draft"))
    assert running.client.post(f"{MACHINES}/check", content=named("draft")).json()["version"] == 1
    assert running.client.post(f"{MACHINES}/check", content=named("draft") + "#").json()["version"] == 2
    wrong = named("draft").replace("a: 1.0", "a: far")
    refused = running.client.post(f"{MACHINES}/check", content=wrong)
    assert refused.status_code == 422
    assert refused.json()["detail"] == running.client.post(MACHINES, content=wrong).json()["detail"]


def test_the_file_comes_back_as_it_was_sent(running: Running) -> None:
    text = "# a comment stays\n" + named("verbatim")
    running.client.post(MACHINES, content=text)
    response = running.client.get(f"{MACHINES}/verbatim/file")
    assert response.headers["content-type"] == "application/yaml"
    assert response.text == text


def test_json_is_yaml(running: Running) -> None:
    running.client.post(MACHINES, content=named("original"))
    content = running.client.get(f"{MACHINES}/original").json()["machine"]
    content["name"] = "copy"
    assert running.client.post(MACHINES, json=content).status_code == 201


@pytest.mark.slow
@pytest.mark.parametrize(
    ("content", "says"),
    [
        (named("a").replace("gravity:", "gravitation:").encode(), "gravitation"),
        (named("a").replace("a: 1.0", "a: far").encode(), "machine.yaml:8: joints[0].dh.a"),
        (named("../up").encode(), "name"),
        (b"not: [closed", "not valid YAML"),
        (b"\xff\xfe\x00", "UTF-8"),
        (b"", "machine file"),
        (b"[" * 50_000, "nested more than 32 deep"),
    ],
)
def test_a_wrong_file_is_refused_with_one_line(running: Running, content: bytes, says: str) -> None:
    before = running.client.get(MACHINES).json()
    response = running.client.post(MACHINES, content=content)
    assert response.status_code == 422
    assert says in response.json()["detail"]
    assert "\n" not in response.json()["detail"]
    assert running.client.get(MACHINES).json() == before


def test_machines_are_listed_in_pages(running: Running) -> None:
    for number in range(3):
        running.client.post(MACHINES, content=named(f"page{number}"))
    names: list[str] = []
    cursor = 0
    while cursor is not None:
        page = running.client.get(MACHINES, params={"limit": 2, "cursor": cursor}).json()
        assert len(page["items"]) <= 2
        names += [item["name"] for item in page["items"]]
        cursor = page["next"]
    assert len(names) == len(set(names))
    assert names[:3] == ["page2", "page1", "page0"]


def test_a_machine_that_names_no_bus_cannot_be_acquired(running: Running) -> None:
    text = named("offline").partition("buses:")[0]
    running.client.post(MACHINES, content=text)
    response = running.client.put(f"{MACHINES}/offline/acquisition", json={"enabled": True})
    assert response.status_code == 409
    assert "no buses" in response.json()["detail"]


def test_live_values_come_from_the_ring(running: Running) -> None:
    acquire(running, "living")
    assert running.client.get(f"{MACHINES}/living").json()["acquisition"]["state"] == "running"
    frame = running.client.get(f"{API}/live", params={"machine": "living"}).json()["living"]
    assert frame["cycle"] == 7
    angle = frame["channels"]["joint1.angle"]
    assert angle == {"value": pytest.approx(30.0), "unit": "deg", "quality": "fresh", "age_s": 0.001}
    torque = frame["channels"]["joint1.torque"]
    assert torque == {"value": None, "unit": "N m", "quality": "missing", "age_s": None}
    assert list(running.client.get(f"{API}/live").json()) == ["living"]
    off = running.client.put(f"{MACHINES}/living/acquisition", json={"enabled": False})
    assert off.json()["acquisition"] == {"state": "off"}
    refused = running.client.get(f"{API}/live", params={"machine": "living"})
    assert refused.status_code == 409
    assert "enable it" in refused.json()["detail"]


def test_a_machine_without_a_frame_yet_does_not_hide_the_others(
    running: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    acquire(running, "early")
    acquire(running, "late")
    latest = running.service[Acquisition].latest

    def none_yet(name: str) -> dict[str, object]:
        if name == "late":
            raise UnavailableError("machine 'late' has not sent a frame yet; try again")
        return latest(name)

    with monkeypatch.context() as patch:
        patch.setattr(running.service[Acquisition], "latest", none_yet)
        found = running.client.get(f"{API}/live").json()
        assert "early" in found and "late" not in found
        assert running.client.get(f"{API}/live", params={"machine": "late"}).status_code == 503


def test_a_new_version_is_acquired_from_then_on(running: Running) -> None:
    acquire(running, "changing")
    ended = running.fakes.acquisition.ended
    running.client.post(MACHINES, content=named("changing").replace("velocity: 1.0", "velocity: 2.0"))
    assert running.fakes.acquisition.ended == ended + 1
    assert "changing" in running.service[Acquisition].names()


def test_status_counts_changes(running: Running) -> None:
    before = running.client.get(f"{API}/status").json()
    running.client.post(MACHINES, content=named("counted"))
    after = running.client.get(f"{API}/status").json()
    assert after["revisions"]["machines"] == before["revisions"]["machines"] + 1
    assert after["version"]


@pytest.mark.slow
def test_the_simulated_machine_is_the_same_version_after_a_restart_that_moved_its_buses(running: Running) -> None:
    own = named("simulated").partition("buses:")[0] + (
        "buses:\n- name: can\n  type: canopen\n  interface: socketcand\n  channel: can0\n"
        "  options:\n    host: 127.0.0.1\n    port: 40001\n"
    )
    uploads = running.service[MachineUploads]
    first, made = uploads.add(own.encode(), own=True)
    assert (first.version, made) == (1, True)
    again, made = uploads.add(own.replace("40001", "40002").encode(), own=True)
    assert (again.version, made) == (1, False)
    assert "port: 40002" in running.client.get(f"{API}/machines/simulated/file").text
    changed, made = uploads.add(own.replace("rate_hz: 50", "rate_hz: 25").encode(), own=True)
    assert (changed.version, made) == (2, True)


def test_two_machines_do_not_differ_by_capitals_alone(running: Running) -> None:
    assert running.client.post(MACHINES, content=named("capitals")).status_code == 201
    answer = running.client.post(MACHINES, content=named("CAPITALS"))
    assert answer.status_code == 409
    assert "there is a machine 'capitals' already" in answer.json()["detail"]
