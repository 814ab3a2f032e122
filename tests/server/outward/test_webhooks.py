"""Webhooks: signed, to listed addresses only, at least once, tried again durably, given up visibly."""

from __future__ import annotations

import base64
import hashlib
import hmac
import json
import logging
import re
import sqlite3
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from access_fakes import guarded_service
from service_fakes import API, Fakes, Running, recording_bytes, running_service, wait_for_change
from webhook_receiver import Receiver, receiver

from server.alarms.alarm_desk import Alarms
from server.backups.backup_archive import Backups
from server.jobs.job_runner import JobRunner
from server.outward.outward_resource import PAUSES, RESOLVER
from server.outward.outward_stream import OutwardStream
from server.outward.webhook_desk import ERRAND, PAUSES_S, Webhooks
from server.outward.webhook_post import headers
from server.platform.authorization.principals import Role

#: Tries follow each other at once: three, then it is given up.
SOON = (0.0, 0.0)


@contextmanager
def hooked(data_dir: Path, port: int, *, pauses: tuple[float, ...] = SOON, **more: Any) -> Iterator[Running]:
    fakes = Fakes()
    fakes.parts[PAUSES] = pauses
    fakes.parts[RESOLVER] = more.pop("resolve", lambda host, port: ["127.0.0.1"])
    settings = {"webhook_places": [f"http://hook.example:{port} in 127.0.0.0/8"], **more}
    with running_service(data_dir, fakes, **settings) as running:
        yield running


def add(running: Running, port: int, **body: Any) -> dict[str, Any]:
    answer = running.client.post(f"{API}/webhooks", json={"url": f"http://hook.example:{port}/in?a=1", **body})
    assert answer.status_code == 201, answer.text
    return dict(answer.json())


def ended(running: Running, webhook: str, count: int = 1) -> list[dict[str, Any]]:
    """Deliveries, once that many are over."""
    while True:
        number = running.service.changes.number
        items = running.client.get(f"{API}/webhooks/{webhook}/deliveries").json()["items"]
        if sum(item["state"] != "pending" for item in items) >= count:
            return list(items)
        assert wait_for_change(running.service, number), items


def until_alarms(running: Running, count: int) -> None:
    """Wait until that many alarms are active."""
    while True:
        number = running.service.changes.number
        if len(running.service[Alarms].active()) == count:
            return
        assert wait_for_change(running.service, number)


def is_signed(secret: str, heard: dict[str, str], body: bytes) -> bool:
    """As the receiver's side of standardwebhooks.com checks it, from its text and not from our code."""
    key = base64.b64decode(secret.removeprefix("whsec_"))
    signed = f"{heard['webhook-id']}.{heard['webhook-timestamp']}.".encode() + body
    wanted = base64.b64encode(hmac.new(key, signed, hashlib.sha256).digest()).decode()
    return heard["webhook-signature"] == f"v1,{wanted}"


def test_a_signature_is_that_of_the_published_example() -> None:
    """The values of the specification's own example."""
    key = base64.b64decode("MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw")
    found = headers(key, "msg_p5jXN8AQM9LWM0D4loKWxJek", 1614265330, b'{"test": 2432232314}')
    assert found["webhook-signature"] == "v1,g0hM9SsE+OTPJTGt/tmIKtSyZlE3uFJELVlNIOLJ1OE="


@pytest.fixture
def heard() -> Iterator[Receiver]:
    with receiver() as found:
        yield found


@pytest.mark.slow
def test_alarms_and_finished_jobs_arrive_signed(tmp_path: Path, heard: Receiver) -> None:
    with hooked(tmp_path / "data", heard.port) as running:
        made = add(running, heard.port, label="ERP")
        alarms = running.service[Alarms]
        alarms.report(None, "overload", "joint2 hit something", "critical", True)
        heard.wait(1)
        alarms.report(None, "overload", "", "critical", False)
        heard.wait(2)
        job = running.order(recording_bytes(tmp_path)).job
        running.follow(job)
        heard.wait(3)
        bodies = [json.loads(body) for _, _, body in heard.heard]
        assert sorted((body["type"], body["data"]["state"]) for body in bodies) == [
            ("alarm", "active"),
            ("alarm", "cleared"),
            ("result", "done"),
        ]
        (result,) = (body for body in bodies if body["type"] == "result")
        assert result["machine"] == "lever"
        assert result["data"]["job"] == job
        assert result["data"]["verdict"] == running.client.get(result["data"]["path"]).json()["verdict"] is not None
        for path, given, body in heard.heard:
            assert path == "/in?a=1"
            assert given["host"] == f"hook.example:{heard.port}"
            assert is_signed(made["secret"], given, body)
            assert given["webhook-id"] == json.loads(body)["id"]
        assert {item["state"] for item in ended(running, made["id"], 3)} == {"delivered"}


@pytest.mark.slow
def test_a_test_message_arrives_at_that_webhook_alone(tmp_path: Path, heard: Receiver) -> None:
    with hooked(tmp_path, heard.port) as running:
        first, second = add(running, heard.port), add(running, heard.port)
        sent = running.client.post(f"{API}/webhooks/{first['id']}/test")
        assert sent.status_code == 202
        (delivery,) = ended(running, first["id"])
        assert (delivery["state"], delivery["tries"], delivery["type"]) == ("delivered", 1, "test")
        assert delivery["id"] == sent.json()["id"]
        assert running.client.get(f"{API}/webhooks/{second['id']}/deliveries").json()["items"] == []
        assert json.loads(heard.heard[0][2])["type"] == "test"


@pytest.mark.slow
def test_only_listed_types_are_sent(tmp_path: Path, heard: Receiver) -> None:
    with hooked(tmp_path, heard.port) as running:
        made = add(running, heard.port, events=["result"])
        running.service[Alarms].report(None, "overload", "x", "critical", True)
        running.service[OutwardStream].look_at_outbox()
        assert running.client.get(f"{API}/webhooks/{made['id']}/deliveries").json()["items"] == []


#: Not listed, or no receiver; the place that is listed is http://hook.example:4000.
REFUSED = (
    "http://elsewhere.example/",
    "https://hook.example:4000/",
    "http://hook.example:1/",
    "http://user@hook.example:4000/",
    "http://hook.example:4000@elsewhere.example/",
    "ftp://hook.example:4000/",
    "http://127.0.0.1:4000/",
    "http://hook.example:4000/a b",
    "http://hook.example:4000/\r\nx",
    "nothing",
)


@pytest.mark.slow
def test_what_is_not_listed_is_refused(tmp_path: Path) -> None:
    with hooked(tmp_path, 4000) as running:
        for url in REFUSED:
            answer = running.client.post(f"{API}/webhooks", json={"url": url})
            assert answer.status_code == 422, (url, answer.text)
        assert running.client.get(f"{API}/webhooks").json()["items"] == []


@pytest.mark.slow
def test_a_name_that_leads_elsewhere_meanwhile_is_not_asked(tmp_path: Path, heard: Receiver) -> None:
    with hooked(
        tmp_path,
        heard.port,
        resolve=lambda host, port: ["127.0.0.1"],
        webhook_places=[f"http://hook.example:{heard.port}", f"http://hook.example:{heard.port} in 10.0.0.0/8"],
    ) as running:
        made = add(running, heard.port, events=["result"])
        running.client.post(f"{API}/webhooks/{made['id']}/test")
        (delivery,) = ended(running, made["id"])
        assert delivery["state"] == "given_up"
        assert "webhook_places does not let through" in delivery["error"]
    assert heard.heard == []


@pytest.mark.slow
def test_a_redirect_is_not_followed(tmp_path: Path, heard: Receiver) -> None:
    with receiver() as other:
        heard.answers = [(307, {"Location": f"http://127.0.0.1:{other.port}/"})]
        with hooked(tmp_path, heard.port) as running:
            made = add(running, heard.port, events=["result"])
            running.client.post(f"{API}/webhooks/{made['id']}/test")
            (delivery,) = ended(running, made["id"])
            assert (delivery["state"], delivery["error"]) == ("given_up", "the receiver answered 307")
        assert other.heard == []


@pytest.mark.slow
def test_a_failed_try_is_made_again_with_the_same_id(tmp_path: Path, heard: Receiver) -> None:
    heard.answers = [(500, {}), (503, {}), (204, {})]
    with hooked(tmp_path, heard.port) as running:
        made = add(running, heard.port)
        running.client.post(f"{API}/webhooks/{made['id']}/test")
        (delivery,) = ended(running, made["id"])
        assert (delivery["state"], delivery["tries"], delivery["error"]) == ("delivered", 3, None)
        assert len({given["webhook-id"] for _, given, _ in heard.heard}) == 1
        assert all(is_signed(made["secret"], given, body) for _, given, body in heard.heard)
        assert running.service[Alarms].active() == ()


@pytest.mark.slow
def test_what_is_given_up_is_an_alarm_and_stays_visible(tmp_path: Path, heard: Receiver) -> None:
    heard.answers = [(500, {})]
    with hooked(tmp_path, heard.port) as running:
        made = add(running, heard.port, label="ERP", events=["result"])
        running.client.post(f"{API}/webhooks/{made['id']}/test")
        ended(running, made["id"])
        until_alarms(running, 1)
        (alarm,) = running.service[Alarms].active()
        assert (alarm.kind, "'ERP'" in alarm.text) == ("webhook_failed", True)
        heard.answers = [(200, {})]
        running.client.post(f"{API}/webhooks/{made['id']}/test")
        ended(running, made["id"], 2)
        given_up = running.client.get(f"{API}/webhooks/{made['id']}/deliveries", params={"state": "given_up"}).json()
        assert [item["tries"] for item in given_up["items"]] == [3]
        until_alarms(running, 0)
        assert [alarm.kind for alarm in running.service[Alarms].open()] == ["webhook_failed"]


@pytest.mark.slow
def test_an_alarm_about_webhooks_does_not_go_round(tmp_path: Path, heard: Receiver) -> None:
    heard.answers = [(500, {})]
    with hooked(tmp_path, heard.port) as running:
        made = add(running, heard.port)
        running.client.post(f"{API}/webhooks/{made['id']}/test")
        items = ended(running, made["id"], 2)  # the test, and the alarm that it was given up
        running.service[OutwardStream].look_at_outbox()
        assert len(items) == 2 == len(running.client.get(f"{API}/webhooks/{made['id']}/deliveries").json()["items"])
        running.client.delete(f"{API}/webhooks/{made['id']}")
        assert running.service[Alarms].active() == ()


@pytest.mark.slow
def test_what_was_on_its_way_goes_on_after_a_restart(tmp_path: Path, heard: Receiver) -> None:
    """Stored and not sent, and between two tries: both are delivered by the next process, once each."""
    heard.answers = [(500, {}), (200, {})]
    with hooked(tmp_path, heard.port, pauses=(3600.0,)) as running:
        waits = add(running, heard.port)
        running.client.post(f"{API}/webhooks/{waits['id']}/test")
        heard.wait(1)
        webhooks = running.service[Webhooks]
        while running.client.get(f"{API}/webhooks/{waits['id']}/deliveries").json()["items"][0]["tries"] == 0:
            wait_for_change(running.service, running.service.changes.number, 0.1)
        unsent = running.client.post(f"{API}/webhooks", json={"url": f"http://hook.example:{heard.port}/second"}).json()
        running.service[JobRunner].errands.forget()  # as if killed between the store and the engine
        webhooks.test(unsent["id"])
    with hooked(tmp_path, heard.port, pauses=(3600.0,)) as running:
        assert [item["state"] for item in ended(running, unsent["id"])] == ["delivered"]
        # Its hour is not over: it waits in the engine, and is not sent twice.
        (waiting,) = running.client.get(f"{API}/webhooks/{waits['id']}/deliveries").json()["items"]
        assert (waiting["state"], waiting["tries"]) == ("pending", 1)
    assert [path for path, _, _ in heard.heard] == ["/in?a=1", "/second"]


@pytest.mark.slow
def test_whoever_was_killed_before_the_alarm_raises_it_at_the_next_start(tmp_path: Path, heard: Receiver) -> None:
    heard.answers = [(500, {})]
    with hooked(tmp_path, heard.port) as running:
        made = add(running, heard.port, events=["result"])
        webhooks = running.service[Webhooks]
        delivery = webhooks.test(made["id"])
        ended(running, made["id"])
        until_alarms(running, 1)
        running.service[Alarms].report(None, "webhook_failed", "", "warning", False)
        assert webhooks.attempt(delivery.id, 3) is None  # the try that is made again
        assert len(running.service[Alarms].active()) == 1
        running.service[Alarms].report(None, "webhook_failed", "", "warning", False)
    with hooked(tmp_path, heard.port) as running:
        until_alarms(running, 1)


@pytest.mark.slow
def test_a_broken_try_is_made_again_and_a_good_one_is_not(tmp_path: Path, heard: Receiver) -> None:
    with hooked(tmp_path, heard.port) as running:
        made = add(running, heard.port)
        running.client.post(f"{API}/webhooks/{made['id']}/test")
        (delivery,) = ended(running, made["id"])
        assert running.service[Webhooks].attempt(delivery["id"], 1) is None
        running.service[JobRunner].errands.send(ERRAND, delivery["id"])
    assert len(heard.heard) == 1


@pytest.mark.slow
def test_nothing_holds_a_thread_while_it_waits(tmp_path: Path, heard: Receiver) -> None:
    heard.answers = [(500, {})]
    with hooked(tmp_path, heard.port, pauses=(3600.0,)) as running:
        made = add(running, heard.port)
        for _ in range(20):
            running.client.post(f"{API}/webhooks/{made['id']}/test")
        heard.wait(20)
        ended_by = running.client.get(f"{API}/webhooks/{made['id']}/deliveries").json()["items"]
        assert {item["state"] for item in ended_by} == {"pending"}
        assert threading.active_count() < 60


def test_pauses_last_nearly_a_day() -> None:
    assert sorted(PAUSES_S) == list(PAUSES_S)
    assert 20 * 3600 < sum(PAUSES_S) < 24 * 3600


@pytest.mark.slow
class TestSecrets:
    def test_a_secret_is_shown_once_and_is_nowhere_else(
        self, tmp_path: Path, heard: Receiver, caplog: pytest.LogCaptureFixture
    ) -> None:
        caplog.set_level(logging.DEBUG)
        with hooked(tmp_path, heard.port) as running:
            made = add(running, heard.port)
            running.client.post(f"{API}/webhooks/{made['id']}/test")
            ended(running, made["id"])
            secret = made["secret"].removeprefix("whsec_")
            raw = base64.b64decode(secret)
            assert len(raw) == 32
            for path in ("webhooks", f"webhooks/{made['id']}", f"webhooks/{made['id']}/deliveries", "logs"):
                assert secret not in running.client.get(f"{API}/{path}").text
            assert "whsec_" not in re.sub(
                r"`whsec_\.\.\.`|`+whsec_\.\.\.`+", "", running.client.get(f"{API}/openapi.json").text
            )
            backup = running.service[Backups]
            made_backup = backup.directory / backup.make().id
            key = (tmp_path / "webhooks" / "site.key").read_bytes()
        for path in [*made_backup.rglob("*"), *tmp_path.glob("*.sqlite*")]:
            content = path.read_bytes() if path.is_file() else b""
            for forbidden in (secret.encode(), raw, raw.hex().encode(), key, key.hex().encode()):
                assert forbidden not in content, path
        assert secret not in caplog.text
        assert (tmp_path / "webhooks" / "site.key").stat().st_mode & 0o077 == 0

    def test_a_store_that_came_elsewhere_signs_nothing(self, tmp_path: Path, heard: Receiver) -> None:
        with hooked(tmp_path, heard.port) as running:
            made = add(running, heard.port, events=["result"])
        (tmp_path / "webhooks" / "site.key").unlink()
        with hooked(tmp_path, heard.port) as running:
            running.client.post(f"{API}/webhooks/{made['id']}/test")
            (delivery,) = ended(running, made["id"])
            assert delivery["state"] == "given_up"
            assert "add it again" in delivery["error"]
        assert heard.heard == []

    def test_the_same_order_again_makes_no_second(self, tmp_path: Path) -> None:
        with hooked(tmp_path, 4000) as running:
            body, key = {"url": "http://hook.example:4000/"}, {"Idempotency-Key": "once"}
            answers = [running.client.post(f"{API}/webhooks", json=body, headers=key).json() for _ in range(2)]
            assert answers[0] == answers[1]
            assert len(running.client.get(f"{API}/webhooks").json()["items"]) == 1


@pytest.mark.slow
def test_only_admins_of_all_machines_have_webhooks(tmp_path: Path) -> None:
    with guarded_service(tmp_path, webhook_places=["https://erp.example"]) as guarded:
        roles: tuple[Role, ...] = ("viewer", "operator", "engineer")
        for who in (*map(guarded.bearer, roles), guarded.bearer("admin", ("lever",))):
            made = guarded.client.post(f"{API}/webhooks", json={"url": "https://erp.example/"}, headers=who)
            assert made.status_code == 403
            assert guarded.client.get(f"{API}/webhooks", headers=who).status_code == 403
        admin = guarded.bearer("admin")
        made = guarded.client.post(f"{API}/webhooks", json={"url": "https://erp.example/"}, headers=admin)
        assert made.status_code == 201
        assert made.headers["cache-control"] == "no-store"
        assert made.json()["created_by"] == "a admin"


@pytest.mark.slow
def test_what_was_said_leaves_the_outbox(tmp_path: Path) -> None:
    with hooked(tmp_path, 4000) as running:
        running.service[Alarms].report(None, "overload", "x", "critical", True)
        running.service[OutwardStream].look_at_outbox()
    connection = sqlite3.connect(tmp_path / "hilfit.sqlite")
    assert connection.execute("SELECT count(*) FROM outbox").fetchone() == (0,)
    connection.close()
