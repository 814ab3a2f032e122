"""The audit log: who did what, in order, and that a changed log shows."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from pathlib import Path

import pytest
from access_fakes import guarded_service
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from service_fakes import API

from server.audit.audit_resource import Audit
from server.composition.declarations import TABLES
from server.platform.authorization.principals import LOCAL
from server.platform.database.engine import Database

COLUMNS = ("time", "principal", "action", "subject", "detail", "hash")


@pytest.fixture
def place(tmp_path: Path) -> Path:
    return tmp_path / "store.sqlite"


@pytest.fixture
def audit(place: Path) -> Iterator[Audit]:
    database = Database(place, TABLES, changed=lambda: None)
    yield Audit(database)
    database.close()


def tamper(place: Path, statement: str) -> None:
    """Change the log as somebody could who has the file and takes the triggers away."""
    connection = sqlite3.connect(place)
    for event in ("update", "delete"):
        connection.execute(f"DROP TRIGGER IF EXISTS audit_log_no_{event}")
    connection.execute(statement)
    connection.commit()
    connection.close()


def fill(audit: Audit, count: int = 6) -> None:
    for number in range(count):
        audit.write(LOCAL, "recordings.start", f"rec-{number}", {"n": number})


def test_entries_are_numbered_and_newest_first(audit: Audit) -> None:
    fill(audit, 3)
    audit.write("timer", "schedules.run", "sch-1")
    entries = audit.list(2).items
    assert [(entry.number, entry.principal, entry.detail) for entry in entries] == [
        (4, "timer", {}),
        (3, "local (local)", {"n": 2}),
    ]
    assert [entry.number for entry in audit.list(10, 3).items] == [2, 1]
    assert [entry.number for entry in audit.list(10, action="schedules").items] == [4]


def test_an_untouched_log_is_intact(audit: Audit) -> None:
    assert audit.verify().entries == 0
    fill(audit)
    found = audit.verify()
    assert (found.intact, found.first_broken, found.entries) == (True, None, 6)
    assert found.last_hash == audit.list(1).items[0].hash


@pytest.mark.parametrize("statement", ["UPDATE audit_log SET subject = 'x'", "DELETE FROM audit_log"])
def test_the_database_refuses_changes(audit: Audit, place: Path, statement: str) -> None:
    fill(audit)
    connection = sqlite3.connect(place)
    with pytest.raises(sqlite3.IntegrityError, match="append-only"):
        connection.execute(statement)
    connection.close()
    assert audit.verify().intact


@pytest.mark.slow
@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(column=st.sampled_from(COLUMNS), number=st.integers(1, 6), text=st.text("abc0", min_size=1, max_size=4))
def test_verification_names_the_entry_that_was_changed(
    tmp_path_factory: pytest.TempPathFactory, column: str, number: int, text: str
) -> None:
    place = tmp_path_factory.mktemp("log") / "store.sqlite"
    database = Database(place, TABLES, changed=lambda: None)
    audit = Audit(database)
    fill(audit)
    tamper(place, f"UPDATE audit_log SET {column} = '{text}' WHERE number = {number}")
    found = audit.verify()
    database.close()
    assert (found.intact, found.first_broken) == (False, number)


def test_a_deleted_entry_is_found_by_the_verification(audit: Audit, place: Path) -> None:
    fill(audit)
    tamper(place, "DELETE FROM audit_log WHERE number = 3")
    assert audit.verify().first_broken == 4


def test_the_newest_entries_cut_off_show_against_a_noted_hash(audit: Audit, place: Path) -> None:
    fill(audit)
    noted = audit.verify()
    tamper(place, "DELETE FROM audit_log WHERE number > 4")
    now = audit.verify()
    assert now.intact, "the chain alone cannot know"
    assert (now.entries, now.last_hash) != (noted.entries, noted.last_hash)


@pytest.mark.slow
def test_requests_that_change_something_are_noted_and_others_are_not(tmp_path: Path) -> None:
    with guarded_service(tmp_path) as guarded:
        admin, engineer = guarded.bearer("admin"), guarded.bearer("engineer")
        guarded.client.get(f"{API}/machines", headers=engineer)
        guarded.client.put(f"{API}/machines/nowhere/acquisition", json={"enabled": True}, headers=engineer)
        guarded.client.put(f"{API}/machines/lever/acquisition", json={"enabled": False}, headers=engineer)
        made = guarded.client.post(f"{API}/access/keys", json={"name": "k", "role": "viewer"}, headers=admin)
        entries = guarded.client.get(f"{API}/audit", headers=admin).json()["items"]
        assert [(entry["action"], entry["subject"]) for entry in entries] == [
            ("access.make_key", f"{API}/access/keys"),
            ("machines.acquisition", f"{API}/machines/lever/acquisition"),
            ("machines.acquisition", f"{API}/machines/nowhere/acquisition"),  # refused, and tried
        ]
        assert entries[2]["detail"] == {"status": 404}
        assert entries[1]["principal"].startswith("a engineer (key-")
        assert made.json()["key"] not in str(entries)
        assert guarded.client.get(f"{API}/audit/verification", headers=admin).json()["intact"]


@pytest.mark.slow
def test_refused_attempts_are_noted_and_do_not_fill_the_log(tmp_path: Path) -> None:
    with guarded_service(tmp_path) as guarded:
        viewer, admin = guarded.bearer("viewer"), guarded.bearer("admin")
        for _ in range(80):
            assert guarded.client.delete(f"{API}/schedules/x", headers=viewer).status_code == 403
        entries = guarded.client.get(f"{API}/audit", headers=admin, params={"limit": 200}).json()["items"]
        assert 55 < len(entries) < 75
        assert {(own["action"], own["principal"][:8]) for own in entries} == {("schedules.delete", "a viewer")}
        assert {own["detail"]["status"] for own in entries} == {403}
