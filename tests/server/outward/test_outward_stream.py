"""The one stream that webhooks, MQTT and OPC UA take: nothing is lost, nothing waits, one schema."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import jsonschema_rs
import pytest
import sqlalchemy as sa

from server.alarms.alarm_desk import Alarms
from server.composition.declarations import RESOURCES, TABLES
from server.jobs.job_store import Jobs
from server.outward.outward_message import Message, StateData, schema
from server.outward.outward_stream import MessageReader, OutwardStream
from server.platform.authorization.ownership import Ownership
from server.platform.changes import Changes
from server.platform.database.engine import Database
from server.platform.database.schema import outbox, put_out


class Sink:
    """Keeps what it is given; ``broken``: raises at first."""

    def __init__(self, broken: bool = False) -> None:
        self.taken: list[Message] = []
        self.broken = broken

    def take(self, message: Message) -> None:
        if self.broken:
            raise RuntimeError("broken")
        self.taken.append(message)


class States:
    """Acquisition as a test says it."""

    def __init__(self) -> None:
        self.now: dict[str, dict[str, Any]] = {}

    def names(self) -> tuple[str, ...]:
        return tuple(self.now)

    def statistics(self, name: str) -> dict[str, Any]:
        return self.now[name]


class Site:
    """A store with a stream of which no thread runs."""

    def __init__(self, directory: Path) -> None:
        self.database = Database(directory / "hilfit.sqlite", TABLES, changed=lambda: None)
        self.sink, self.states = Sink(), States()
        self.delivered: list[str] = []
        self.fails = False
        reader = MessageReader(Jobs(self.database), Ownership(self.database, RESOURCES), lambda id: None)
        self.stream = OutwardStream(self.database, Changes(), reader, self.states, self.deliver, lambda: None)
        self.stream._sinks = (Sink(broken=True), self.sink)

    def deliver(self, connection: sa.Connection, messages: Sequence[Message]) -> Callable[[], None]:
        if self.fails:
            raise sa.exc.OperationalError("", {}, Exception("the database went away"))
        self.delivered += [message.id for message in messages]
        return lambda: None

    def waiting(self) -> int:
        with self.database.read() as connection:
            return int(connection.execute(sa.select(sa.func.count()).select_from(outbox)).scalar_one())

    def job(self, id: str = "job-1") -> None:
        with self.database.write("jobs") as connection:
            Jobs(self.database).insert(connection, id=id, kind="excitation", label="x", subject="exc-1", stages=("a",))


@pytest.fixture
def site(tmp_path: Path) -> Any:
    made = Site(tmp_path)
    yield made
    made.database.close()


def test_an_alarm_is_said_when_it_changes_and_only_then(site: Site) -> None:
    alarms = Alarms(site.database)
    for _ in range(3):
        alarms.report("lever", "overload", "hit", "critical", True)
    (alarm,) = alarms.active()
    alarms.acknowledge(alarm.id, "somebody")
    alarms.acknowledge(alarm.id, "somebody else")
    alarms.shelve(alarm.id, "somebody", "noise", 60)
    alarms.report("lever", "overload", "", "critical", False)
    assert site.stream.look_at_outbox() == 4
    said = [(m.data.state, m.data.acknowledged, m.data.shelved_until is not None) for m in site.sink.taken]  # type: ignore[union-attr]
    assert said == [("active", False, False), ("active", True, False), ("active", True, True), ("cleared", True, True)]
    assert {message.place for message in site.sink.taken} == {("machines", "lever", "alarms", "overload")}
    assert site.delivered == [message.id for message in site.sink.taken]
    assert site.stream.look_at_outbox() == site.waiting() == 0


def test_the_end_of_a_job_is_said_once_whoever_ends_it_how_often(site: Site) -> None:
    site.job()
    jobs = Jobs(site.database)
    jobs.progress("job-1", "a", 0.5, "half")
    assert jobs.finish("job-1", "failed", "Failed", "no room") and not jobs.finish("job-1", "done", "Done")
    site.stream.look_at_outbox()
    (message,) = site.sink.taken
    assert message.type == "result"
    assert message.content()["data"] | {"ended": None} == {
        "job": "job-1",
        "kind": "excitation",
        "label": "x",
        "state": "failed",
        "error": "no room",
        "subject": "exc-1",
        "path": "/api/v1/excitations/exc-1",
        "verdict": None,
        "started": message.data.started,  # type: ignore[union-attr]
        "ended": None,
        "error_message": None,
    }


def test_a_transaction_that_is_rolled_back_says_nothing(site: Site) -> None:
    with pytest.raises(RuntimeError), site.database.write("alarms") as connection:
        put_out(connection, "result", site.database.now(), {"job": "job-1"})
        raise RuntimeError
    assert site.waiting() == 0


def test_what_could_not_be_stored_for_delivery_is_said_again(site: Site) -> None:
    Alarms(site.database).report(None, "disk_full", "little", "warning", True)
    site.fails = True
    with pytest.raises(sa.exc.OperationalError):
        site.stream.look_at_outbox()
    assert site.waiting() == 1
    site.fails = False
    assert site.stream.look_at_outbox() == 1
    first, second = site.sink.taken
    assert first == second, "twice with one id: a receiver drops the second"
    assert site.delivered == [first.id]


def test_a_job_that_is_gone_holds_up_nothing(site: Site) -> None:
    with site.database.write() as connection:
        put_out(connection, "result", site.database.now(), {"job": "none"})
    Alarms(site.database).report(None, "disk_full", "little", "warning", True)
    assert site.stream.look_at_outbox() == 2
    assert [message.type for message in site.sink.taken] == ["alarm"]
    assert site.waiting() == 0


def test_states_are_said_when_they_change(site: Site) -> None:
    for state in ("starting", "running", "running", "waiting"):
        site.states.now = {"lever": {"state": state, "restarts": 0, "error": "away" if state == "waiting" else None}}
        site.stream.look_at_states()
    site.states.now = {}
    site.stream.look_at_states()
    site.stream.look_at_states()
    assert [message.data for message in site.sink.taken] == [
        StateData("starting"),
        StateData("running"),
        StateData("waiting", "away"),
        StateData("off"),
    ]


def test_every_message_fits_the_schema_that_is_told(site: Site) -> None:
    site.states.now = {"lever": {"state": "running"}}
    site.stream.look_at_states()
    site.job()
    Jobs(site.database).finish("job-1", "done", "Done")
    Alarms(site.database).report("lever", "overload", "hit", "critical", True)
    site.stream.look_at_outbox()
    assert {message.type for message in site.sink.taken} == {"state", "result", "alarm"}
    validator = jsonschema_rs.Draft202012Validator(schema())
    for message in site.sink.taken:
        validator.validate(json.loads(message.body()))
    with pytest.raises(jsonschema_rs.ValidationError):
        validator.validate({"id": "x"})
