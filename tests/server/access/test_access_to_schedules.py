"""Who may do what with schedules and backups, and that a key or a pairing code is made once."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from access_fakes import Guarded, guarded_service
from service_fakes import API

WISH = {"machine": "lever", "cron": "30 2 * * 1", "timezone": "Europe/Vienna"}


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Guarded]:
    with guarded_service(tmp_path_factory.mktemp("data")) as service:
        yield service


def refusal(response: Any, status: int) -> str:
    assert response.status_code == status, response.text
    assert response.headers["content-type"] == "application/problem+json"
    detail = str(response.json()["detail"])
    assert "\n" not in detail
    return detail


def test_backups_are_for_admins_of_all_machines(guarded: Guarded) -> None:
    ask = guarded.client
    for headers in (guarded.bearer("engineer"), guarded.bearer("admin", ("lever",))):
        refusal(ask.post(f"{API}/backups", headers=headers), 403)
        refusal(ask.get(f"{API}/backups", headers=headers), 403)
    backup = ask.post(f"{API}/backups", headers=guarded.bearer("admin"))
    assert backup.status_code == 201
    listed = ask.get(f"{API}/backups", headers=guarded.bearer("admin")).json()["items"]
    assert backup.json() in listed
    assert backup.json()["bytes"] > 0


def test_what_is_scheduled_for_a_foreign_machine_does_not_exist(guarded: Guarded) -> None:
    mine, foreign = guarded.bearer("engineer", ("lever",)), guarded.bearer("engineer", ("other",))
    schedule = guarded.client.post(f"{API}/schedules", json=WISH, headers=mine)
    place = schedule.headers["location"]
    refusal(guarded.client.post(f"{API}/schedules", json=WISH, headers=foreign), 404)
    for method, path in (("GET", ""), ("PUT", ""), ("DELETE", ""), ("POST", "/run"), ("GET", "/slots")):
        refusal(guarded.client.request(method, place + path, json=WISH, headers=foreign), 404)
    assert guarded.client.get(f"{API}/schedules", headers=foreign).json()["items"] == []
    assert len(guarded.client.get(f"{API}/schedules", headers=mine).json()["items"]) == 1


def test_a_schedule_is_not_moved_to_a_foreign_machine(guarded: Guarded) -> None:
    mine = guarded.bearer("engineer", ("lever",))
    place = guarded.client.post(f"{API}/schedules", json=WISH, headers=mine).headers["location"]
    refusal(guarded.client.put(place, json=WISH | {"machine": "other"}, headers=mine), 404)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("path", "order", "secret"),
    [("keys", {"name": "line", "role": "viewer"}, "key"), ("pairing-codes", {"role": "viewer"}, "code")],
)
def test_a_secret_is_made_once_per_key(guarded: Guarded, path: str, order: dict[str, Any], secret: str) -> None:
    def ask(role: Any, content: dict[str, Any]) -> Any:
        headers = guarded.bearer(*role) | {"Idempotency-Key": "once"}
        return guarded.client.post(f"{API}/access/{path}", json=content, headers=headers)

    first = ask(("admin",), order)
    again = ask(("admin",), order)
    assert (first.status_code, again.status_code) == (201, 201), first.text
    assert again.json()[secret] == first.json()[secret]
    assert "new key" in refusal(ask(("admin",), order | {"role": "operator"}), 409)
