"""Every list of the service is narrowed by time and label in the same way."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from service_fakes import API, Fakes, Running, running_service

from server.alarms.alarm_desk import Alarms
from server.audit.audit_resource import Audit

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    with running_service(tmp_path_factory.mktemp("site"), Fakes()) as running:
        yield running


def test_every_list_with_pages_is_narrowed_by_time_and_label(site: Running) -> None:
    paths = site.client.get(f"{API}/openapi.json").json()["paths"]
    for path, methods in paths.items():
        named = {parameter["name"] for parameter in methods.get("get", {}).get("parameters", ())}
        if "cursor" in named:
            assert {"since", "until", "label"} <= named, path


@pytest.mark.parametrize("place", ["alarms", "audit", "access/keys"])
def test_rows_are_found_by_time_and_by_a_part_of_what_they_say(site: Running, place: str) -> None:
    kinds = ["overload", "residual_drift", "residual_grew"]

    def make(text: str) -> None:
        if place == "alarms":
            site.service[Alarms].report(None, kinds.pop(), text, "warning", True)
        elif place == "audit":
            site.service[Audit].write("somebody", "thing.made", text)
        else:
            site.client.post(f"{API}/access/keys", json={"name": text, "role": "viewer"}).raise_for_status()

    def found(**wanted: str) -> list[dict[str, str]]:
        answer = site.client.get(f"{API}/{place}", params=wanted)
        assert answer.status_code == 200, answer.text
        items: list[dict[str, str]] = answer.json()["items"]
        return items

    said, time = {"alarms": ("text", "raised"), "audit": ("subject", "time")}.get(place, ("name", "created"))
    for text in ("Kran-Nord", "kran-mitte", "50%"):
        make(text)
    assert [row[said] for row in found(label="KRAN")] == ["kran-mitte", "Kran-Nord"]
    assert [row[said] for row in found(label="%")] == ["50%"]
    first, second, third = (found(label=text)[0][time] for text in ("Nord", "mitte", "50%"))
    assert [row[said] for row in found(since=second, until=third) if "ran" in row[said]] == ["kran-mitte"]
    assert "kran-mitte" not in [row[said] for row in found(until=second)] and first < second
    assert site.client.get(f"{API}/{place}", params={"since": "yesterday"}).status_code == 422
