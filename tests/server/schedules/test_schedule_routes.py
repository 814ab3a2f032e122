"""Routes of schedules and excitations: what they refuse, with which status, and that a key makes one thing."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from service_fakes import API, MACHINE, Running

from server.alarms.alarm_desk import Alarms
from server.machines.machine_desk import MachineDesk
from server.platform.database.idempotency import LIFETIME_S, MOST, Replays
from server.schedules.schedule_clock import ScheduleClock

WISH = {"machine": "lever", "cron": "30 2 * * 1", "timezone": "Europe/Vienna"}


@pytest.fixture(autouse=True)
def machine(running: Running) -> None:
    running.client.post(f"{API}/machines", content=MACHINE)


def refusal(response: Any, status: int) -> str:
    assert response.status_code == status, response.text
    assert response.headers["content-type"] == "application/problem+json"
    detail = str(response.json()["detail"])
    assert "\n" not in detail
    return detail


def made(running: Running, **changes: Any) -> tuple[str, str]:
    """A schedule's address and ETag."""
    response = running.client.post(f"{API}/schedules", json=WISH | changes)
    assert response.status_code == 201, response.text
    return response.headers["location"], response.headers["etag"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "status", "said"),
    [
        ({"cron": "often"}, 422, "cannot be read"),
        ({"cron": "* * * * *"}, 422, "more often than every 5 minutes"),
        ({"cron": "0 0 30 2 *"}, 422, "never comes"),
        ({"cron": "0 0 1 1 * 2030"}, 422, "cannot be read"),
        ({"timezone": "Mars/Olympus"}, 422, "unknown"),
        ({"machine": "absent"}, 404, "absent"),
        ({"motion": "standard"}, 422, "needs excitations"),
        ({"motion": "standard", "excitations": ["exc-absent"]}, 404, "exc-absent"),
        ({"excitations": ["a", "b", "c"]}, 422, "excitations"),
        ({"duration_s": 1}, 422, "duration_s"),
        ({"activate": "always"}, 422, "activate"),
        ({"crom": "0 2 * * *"}, 422, "crom"),
        ({"options": {"estimator": 5}}, 422, "estimator"),
    ],
)
def test_a_schedule_that_cannot_be_is_refused(
    running: Running, changes: dict[str, Any], status: int, said: str
) -> None:
    before = running.client.get(f"{API}/schedules").json()
    assert said in refusal(running.client.post(f"{API}/schedules", json=WISH | changes), status)
    place, _ = made(running)
    assert said in refusal(running.client.put(place, json=WISH | changes), status), "nor is one changed to that"
    running.client.delete(place)
    assert running.client.get(f"{API}/schedules").json() == before


@pytest.mark.slow
def test_a_change_from_an_old_reading_is_refused(running: Running) -> None:
    place, first = made(running)
    changed = running.client.put(place, json=WISH | {"label": "second"}, headers={"If-Match": first})
    assert changed.status_code == 200
    second = changed.headers["etag"]
    assert second != first
    refusal(running.client.put(place, json=WISH | {"label": "third"}, headers={"If-Match": first}), 412)
    refusal(running.client.delete(place, headers={"If-Match": first}), 412)
    refusal(running.client.put(place, json=WISH, headers={"If-Match": '"no number"'}), 412)
    assert running.client.get(place).json()["label"] == "second"
    assert running.client.delete(place, headers={"If-Match": second}).status_code == 204
    refusal(running.client.get(place), 404)


def test_a_schedule_begins_by_the_clock_by_which_its_slots_come(
    running: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(running.service[ScheduleClock], "now", lambda: datetime(2031, 3, 4, 0, 59, tzinfo=UTC))
    hourly = {"cron": "0 * * * *", "timezone": "UTC"}
    place, tag = made(running, **hourly)
    for answer in (running.client.get(place), running.client.put(place, json=WISH | hourly, headers={"If-Match": tag})):
        assert answer.json()["next"] == "2031-03-04T01:00:00.000Z"
    assert running.client.get(f"{API}/schedules/upcoming", params=hourly).json()["slots"][0] == answer.json()["next"]
    running.client.delete(place)


def test_a_key_makes_one_schedule_and_is_not_taken_for_another(running: Running) -> None:
    headers = {"Idempotency-Key": "nightly"}
    first = running.client.post(f"{API}/schedules", json=WISH, headers=headers)
    again = running.client.post(f"{API}/schedules", json=WISH, headers=headers)
    assert (first.status_code, again.status_code) == (201, 201)
    assert again.json() == first.json()
    other = running.client.post(f"{API}/schedules", json=WISH | {"label": "x"}, headers=headers)
    assert "new key" in refusal(other, 409)


def test_running_a_schedule_of_a_machine_that_is_not_acquired_says_so(running: Running) -> None:
    place, _ = made(running)
    assert "not being acquired" in refusal(running.client.post(f"{place}/run"), 409)
    assert running.client.get(f"{place}/slots").json() == {"items": []}


def test_an_excitation_that_cannot_be_is_refused(running: Running) -> None:
    for changes, status, said in (
        ({"machine": "absent"}, 404, "absent"),
        ({"joints": ["elbow"]}, 422, "elbow"),
        ({"joints": []}, 422, "joints"),
        ({"duration_s": 1e9}, 422, "duration_s"),
        ({"use": 1.5}, 422, "use"),
        ({"speed": 2}, 422, "speed"),
    ):
        order = {"machine": "lever"} | changes
        assert said in refusal(running.client.post(f"{API}/excitations", json=order), status)


def test_a_motion_is_there_when_its_design_is_done_and_a_real_arm_gets_no_file(running: Running) -> None:
    headers = {"Idempotency-Key": "motion"}
    order = {"machine": "lever", "duration_s": 20}
    designed = running.client.post(f"{API}/excitations", json=order, headers=headers)
    assert designed.status_code == 202, designed.text
    place = f"{API}/excitations/{designed.json()['id']}"
    other = running.client.post(f"{API}/excitations", json=order | {"seed": 2}, headers=headers)
    assert "new key" in refusal(other, 409)
    running.client.post(f"{API}/jobs/{designed.json()['job']}/cancel")
    ended = running.follow(designed.json()["job"])[-1]["state"]
    assert ended in ("cancelled", "done")
    if ended == "cancelled":
        assert "has no motion" in refusal(running.client.get(f"{place}/motion.csv"), 409)
        assert "not designed yet" in refusal(running.client.post(f"{place}/send"), 409)
    else:
        assert "real one" in refusal(running.client.post(f"{place}/send"), 409)


@pytest.mark.slow
def test_two_recordings_at_once_and_deleting_what_is_in_use(running: Running, csv: bytes) -> None:
    running.service[MachineDesk].set_acquisition("lever", True)
    assert running.fakes.acquisition.up.wait(30)
    order, headers = {"machine": "lever", "role": "train"}, {"Idempotency-Key": "go"}
    first = running.client.post(f"{API}/recordings", json=order, headers=headers)
    assert first.status_code == 201, first.text
    assert running.client.post(f"{API}/recordings", json=order, headers=headers).json()["id"] == first.json()["id"]
    assert first.json()["id"] in refusal(running.client.post(f"{API}/recordings", json=order), 409)
    refusal(running.client.delete(first.headers["location"]), 409)
    off = running.client.put(f"{API}/machines/lever/acquisition", json={"enabled": False})
    assert first.json()["id"] in refusal(off, 409)
    assert running.client.post(f"{first.headers['location']}/stop").json()["state"] == "sealed"
    running.service[MachineDesk].set_acquisition("lever", False)
    identification = running.order(csv)
    used = running.choices(csv)[0]["id"]
    assert identification.id in refusal(running.client.delete(f"{API}/recordings/{used}"), 409)
    running.follow(identification.job)


@pytest.mark.slow
def test_an_answer_is_kept_for_its_own_asker_and_for_a_while() -> None:
    now = [0.0]
    replays, numbers = Replays(lambda: now[0]), iter(range(1000))

    def once(who: str = "a", key: str | None = "k") -> int:
        return replays.once(who, "keys", key, {}, lambda: next(numbers))

    assert [once(), once(), once("b"), once(), once(key=None), once(key=None)] == [0, 0, 1, 0, 2, 3]
    now[0] = LIFETIME_S
    assert once() == 4
    for number in range(MOST):
        once(key=f"k{number}")
    assert once() > 4, "the oldest went"


@pytest.mark.slow
def test_a_change_of_an_alarm_with_an_outdated_etag_is_refused(running: Running) -> None:
    running.service[Alarms].report("lever", "recalibration_failed", "of a test", "warning", True)
    (row,) = [a for a in running.client.get(f"{API}/alarms").json()["items"] if a["text"] == "of a test"]
    place = f"{API}/alarms/{row['id']}"
    tag = running.client.get(place).headers["etag"]
    shelf = {"seconds": 60, "reason": "known"}
    shelved = running.client.post(f"{place}/shelve", json=shelf, headers={"If-Match": tag})
    assert shelved.status_code == 200, shelved.text
    assert shelved.headers["etag"] != tag
    for action in ("acknowledge", "unshelve"):
        refusal(running.client.post(f"{place}/{action}", headers={"If-Match": tag}), 412)
    assert running.client.get(place).json()["acknowledged"] is False
    current = shelved.headers["etag"]
    assert running.client.post(f"{place}/acknowledge", headers={"If-Match": current}).json()["acknowledged"]
    assert running.client.post(f"{place}/unshelve", headers={"If-Match": "*"}).status_code == 200


@pytest.mark.slow
def test_a_list_is_answered_from_memory_until_it_changes(running: Running, csv: bytes, tmp_path: Path) -> None:
    ask = running.client.get
    first = ask(f"{API}/recordings")
    tag = first.headers["etag"]
    assert ask(f"{API}/recordings", headers={"If-None-Match": tag}).status_code == 304
    id = running.upload(csv, "repeat")
    second = ask(f"{API}/recordings", headers={"If-None-Match": tag})
    assert second.status_code == 200
    assert second.json()["items"][0]["id"] == id
    assert second.headers["etag"] != tag
    assert ask(f"{API}/recordings", params={"role": "repeat"}).json()["items"][0]["id"] == id
    assert second.headers["x-content-type-options"] == "nosniff"
    running.client.delete(f"{API}/recordings/{id}")
    assert id not in ask(f"{API}/recordings").text
