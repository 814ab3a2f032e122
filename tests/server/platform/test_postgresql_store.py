"""The store on PostgreSQL: backup and restore, the append-only audit log, migrations, pairing, recalibrations."""

from __future__ import annotations

import contextlib
import json
import threading
from datetime import UTC, datetime
from pathlib import Path

import pytest
import sqlalchemy as sa
from postgresql_server import PostgreSQL
from recalibration_fakes import setting
from service_fakes import MACHINE
from test_store_migrations import VERSION_1

from server.access.access_desk import Access
from server.audit.audit_resource import Audit
from server.backups.backup_archive import Backups, restore
from server.backups.backup_files import BackupContent
from server.commands.command_line import main
from server.composition.declarations import RESOURCES, TABLES
from server.jobs.executors import executors
from server.jobs.job_store import Jobs
from server.machines.machine_store import Machines
from server.platform.database import database_copies as copies
from server.platform.database import engine as database_module
from server.platform.database import schema
from server.platform.database.engine import Database
from server.platform.database.idempotency import IdempotencyKey, earlier
from server.platform.database.patience import away
from server.platform.errors import StartError
from server.platform.files import DataDirectory

pytestmark = pytest.mark.slow

CONTENT = BackupContent.of(RESOURCES)


CHANGES = ("UPDATE audit_log SET subject = 'x'", "DELETE FROM audit_log", "TRUNCATE audit_log")


def nothing() -> None:
    """Nobody waits for changes here."""


@pytest.fixture
def url(postgresql: PostgreSQL) -> str:
    return postgresql.new_database()


def run_sql(url: str, *statements: str) -> None:
    """What somebody with the password does behind the service's back."""
    engine = sa.create_engine(copies.postgresql_url(url), poolclass=sa.NullPool)
    with engine.begin() as connection:
        for statement in statements:
            connection.exec_driver_sql(statement)


def backups_of(files: DataDirectory, url: str) -> Backups:
    return Backups(files, CONTENT, copies.postgresql_url(url), lambda: datetime(2026, 1, 1, tzinfo=UTC))


def test_a_backup_is_restored_as_it_was_the_engine_s_tables_and_the_audit_log_included(
    tmp_path: Path, url: str, postgresql: PostgreSQL
) -> None:
    files = DataDirectory(tmp_path / "data")
    database = Database(url, TABLES, changed=nothing, backups=files.backups)
    Machines(database).add("lever", 1, "hash")
    (files.machines / "lever").mkdir()
    (files.machines / "lever" / "1.yaml").write_text(MACHINE)
    Audit(database).write("person", "machines.add", "lever")
    run_sql(url, "CREATE SCHEMA dbos", "CREATE TABLE dbos.steps (n int)", "INSERT INTO dbos.steps VALUES (7)")
    backup = files.backups / backups_of(files, url).make().id
    Machines(database).add("later", 1, "hash")
    run_sql(url, "INSERT INTO dbos.steps VALUES (8)")
    machine_file = files.machines / "lever" / "1.yaml"
    machine_file.write_text("newer")
    with pytest.raises(StartError, match="stop the server and all workers"):
        restore(backup, files, CONTENT, copies.postgresql_url(url))
    assert machine_file.read_text() == "newer"
    assert Machines(database).get("later").version == 1, "refused: nothing is changed"
    database.close()
    # In its place, and in an empty database on another host.
    for target in (url, postgresql.new_database()):
        restore(backup, files, CONTENT, copies.postgresql_url(target))
        again = Database(target, TABLES, changed=nothing, backups=files.backups)
        assert [row.name for row in Machines(again).list(10).items] == ["lever"]
        with again.read() as connection:
            assert connection.exec_driver_sql("SELECT n FROM dbos.steps").scalars().all() == [7]
        found = Audit(again).verify()
        assert (found.intact, found.entries) == (True, 1)
        Audit(again).write("person", "machines.look", "lever")  # it goes on
        again.close()
        with pytest.raises(sa.exc.DBAPIError, match="append-only"):
            run_sql(target, "DELETE FROM audit_log")


def test_a_damaged_dump_changes_nothing_and_a_copy_of_sqlite_does_not_fit(tmp_path: Path, url: str) -> None:
    database = Database(url, TABLES, changed=nothing, backups=tmp_path)
    Machines(database).add("lever", 1, "hash")
    database.close()
    dump = copies.copy_database(copies.postgresql_url(url), tmp_path, "store")
    dump.write_bytes(dump.read_bytes()[: dump.stat().st_size * 2 // 3])
    with pytest.raises(StartError, match="pg_restore failed"):
        copies.restore_database(dump, copies.postgresql_url(url))
    other = Database(tmp_path / "s.sqlite", TABLES, changed=nothing)
    other.close()
    with pytest.raises(StartError, match="another kind of database"):
        copies.restore_database(tmp_path / "s.sqlite", copies.postgresql_url(url))
    with pytest.raises(StartError, match="cannot be reached"):
        copies.restore_database(dump, copies.postgresql_url(url).rpartition("/")[0] + "/absent")
    database = Database(url, TABLES, changed=nothing, backups=tmp_path)
    assert Machines(database).get("lever").version == 1
    database.close()


def test_without_postgresql_s_programs_a_backup_is_refused_and_says_why(
    tmp_path: Path, url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = DataDirectory(tmp_path / "data")
    Database(url, TABLES, changed=nothing, backups=files.backups).close()
    monkeypatch.setattr(copies, "_DEBIAN", tmp_path / "absent")
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(StartError, match="pg_dump is not installed here"):
        backups_of(files, url).make()
    assert list(files.backups.iterdir()) == []


@pytest.mark.parametrize("statement", CHANGES)
def test_the_database_refuses_to_change_the_audit_log(tmp_path: Path, url: str, statement: str) -> None:
    database = Database(url, TABLES, changed=nothing, backups=tmp_path)
    audit = Audit(database)
    for number in range(3):
        audit.write("person", "recordings.start", f"rec-{number}")
    with pytest.raises(sa.exc.DBAPIError, match="append-only"):
        run_sql(url, statement)
    assert audit.verify().entries == 3
    # Whoever owns the database gets around that, and the chain shows it.
    run_sql(
        url,
        "ALTER TABLE audit_log DISABLE TRIGGER audit_log_append_only",
        "UPDATE audit_log SET subject = 'rec-9' WHERE number = 2",
    )
    assert audit.verify().first_broken == 2
    database.close()


def test_a_store_of_version_1_is_copied_and_brought_up_to_date(tmp_path: Path, url: str) -> None:
    old = VERSION_1.replace("1, 0);", "1, false);").replace("NULL, 0,", "NULL, false,")  # its booleans
    run_sql(url, *(statement for statement in old.split(";") if statement.strip()))
    database = Database(url, TABLES, changed=nothing, backups=tmp_path / "backups")
    with database.read() as connection:
        assert earlier(connection, IdempotencyKey("tablet-1", "hash")) == "idn-1"
        assert connection.execute(sa.select(schema.store_version.c.version)).scalar() == schema.SCHEMA_VERSION
    assert database.revisions() == {"jobs": 7}
    database.close()
    (copy,) = (tmp_path / "backups").iterdir()
    assert copy.name == f"before-version-{schema.SCHEMA_VERSION}-1.pgdump"
    with pytest.raises(sa.exc.DBAPIError, match="append-only"):
        run_sql(url, "TRUNCATE audit_log")


def test_a_store_of_version_4_is_copied_and_keeps_what_it_has(tmp_path: Path, url: str) -> None:
    database = Database(url, TABLES, changed=nothing, backups=tmp_path / "backups")
    Machines(database).add("lever", 1, "hash")
    database.close()
    before = 4
    run_sql(
        url,
        "ALTER TABLE calibrations DROP COLUMN valves",
        "ALTER TABLE calibrations ALTER COLUMN identification SET NOT NULL",
        "ALTER TABLE principals DROP COLUMN expires",
        "ALTER TABLE pairing_codes DROP COLUMN days",
        "DROP TABLE hosts",
        f"UPDATE store_version SET version = {before}",
    )
    again = Database(url, TABLES, changed=nothing, backups=tmp_path / "backups")
    assert Machines(again).get("lever").version == 1
    with again.read() as connection:
        assert connection.exec_driver_sql("SELECT expires FROM principals").all() == []
        assert connection.exec_driver_sql("SELECT id FROM hosts").all() == []
        assert connection.exec_driver_sql("SELECT valves FROM calibrations").all() == []
    columns = {own["name"]: own for own in sa.inspect(again._engine).get_columns("calibrations")}
    assert columns["identification"]["nullable"]
    again.close()
    (copy,) = (tmp_path / "backups").iterdir()
    assert copy.name == f"before-version-{schema.SCHEMA_VERSION}-{before}.pgdump"
    # The copy is the store as it was, for whoever goes back.
    copies.restore_database(copy, copies.postgresql_url(url))
    with pytest.raises(sa.exc.DBAPIError, match="expires"):
        run_sql(url, "SELECT expires FROM principals")


def test_the_audit_log_of_version_2_gets_its_trigger(tmp_path: Path, url: str) -> None:
    database = Database(url, TABLES, changed=nothing, backups=tmp_path / "backups")
    Audit(database).write("person", "recordings.start", "rec-1")
    database.close()
    run_sql(
        url,
        "DROP TRIGGER audit_log_append_only ON audit_log",
        "DROP FUNCTION audit_log_append_only",
        "CREATE RULE audit_log_no_update AS ON UPDATE TO audit_log DO INSTEAD NOTHING",
        "CREATE RULE audit_log_no_delete AS ON DELETE TO audit_log DO INSTEAD NOTHING",
        "ALTER TABLE jobs DROP COLUMN place",
        "UPDATE store_version SET version = 2",
    )
    run_sql(url, "DELETE FROM audit_log")  # did nothing, and said nothing
    database = Database(url, TABLES, changed=nothing, backups=tmp_path / "backups")
    assert Audit(database).verify().entries == 1
    database.close()
    for statement in CHANGES:
        with pytest.raises(sa.exc.DBAPIError, match="append-only"):
            run_sql(url, statement)


def test_without_a_copy_there_is_no_migration(tmp_path: Path, url: str) -> None:
    Database(url, TABLES, changed=nothing, backups=tmp_path).close()
    run_sql(url, "UPDATE store_version SET version = 2")
    (tmp_path / "file").write_text("where the directory should be")
    with pytest.raises(StartError, match="backup cannot be written"):
        Database(url, TABLES, changed=nothing, backups=tmp_path / "file")
    engine = sa.create_engine(copies.postgresql_url(url), poolclass=sa.NullPool)
    with engine.connect() as connection:
        assert connection.exec_driver_sql("SELECT version FROM store_version").scalar() == 2


def test_pairing_with_a_service_on_postgresql(
    tmp_path: Path, url: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HILFIT_DATABASE_URL", url)
    arguments = ["access", "pair", "--role", "operator", "--data-dir", str(tmp_path), "--json"]
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 0
    code = json.loads(capsys.readouterr().out)["code"]
    assert not DataDirectory(tmp_path).database.exists()
    database = Database(url, TABLES, changed=nothing, backups=tmp_path)
    holder, _ = Access(database, Audit(database), required=True).pair(code, "tablet")
    database.close()
    assert holder.role == "operator"


def test_a_server_whose_lock_went_with_its_connection_takes_it_again_or_learns_who_did(
    tmp_path: Path, url: str
) -> None:
    here = "(SELECT oid FROM pg_database WHERE datname = current_database())"
    others = f"FROM pg_locks WHERE locktype = 'advisory' AND pid <> pg_backend_pid() AND database = {here}"
    cut = f"SELECT pg_terminate_backend(pid, 60000) {others}"  # and wait until it has ended
    first, second = (Database(url, TABLES, changed=nothing, backups=tmp_path) for _ in range(2))
    with first.alone():
        assert first.still_alone()
        run_sql(url, cut)
        assert first.still_alone(), "nobody took it meanwhile"
        with pytest.raises(StartError, match="another hilfit server"), second.alone():
            raise AssertionError("two have it")
        third = Database(url, TABLES, changed=nothing, backups=tmp_path)
        run_sql(url, cut)
        with third.alone():
            assert not first.still_alone()
        third.close()
    first.close()


def test_a_server_waits_for_the_session_of_the_one_before_it(tmp_path: Path, url: str) -> None:
    killed, successor = (Database(url, TABLES, changed=nothing, backups=tmp_path) for _ in range(2))
    leaving = contextlib.ExitStack()
    leaving.enter_context(killed.alone())
    timer = threading.Timer(0.3, leaving.close)
    timer.start()
    with successor.alone():
        timer.join()
    for each in (killed, successor):
        each.close()


def test_a_process_that_is_stopped_while_it_writes_does_not_hold_up_the_others(
    tmp_path: Path, url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(database_module, "FROZEN_S", 1)
    stopped, other = (Database(f"{url}?options=-c%20lock_timeout%3D60s", TABLES, changed=nothing) for _ in range(2))
    count = sa.select(sa.func.count()).select_from(executors)
    with pytest.raises(sa.exc.DBAPIError) as caught, stopped.write() as connection:  # and is stopped in the middle:
        connection.execute(executors.insert().values(id="stopped", host="h", started="", seen=""))
        with other.write() as meanwhile:
            meanwhile.execute(executors.insert().values(id="other", host="h", started="", seen=""))
        connection.execute(count)
    assert away(caught.value), "it is done again, like anything that the database was away for"
    with stopped.write() as connection:
        assert connection.execute(count).scalar() == 1
        assert connection.exec_driver_sql("SHOW lock_timeout").scalar() == "1min", "the user's own options hold"
    for each in (stopped, other):
        each.close()


def test_a_recalibration_by_the_clock(tmp_path: Path, url: str) -> None:
    with setting(tmp_path, database_url=url) as site:
        schedule = site.schedule()
        (job,) = site.later(1.1)
        assert site.later(0) == (), "the same moment again"
        assert site.running.follow(job)[-1]["state"] == "done", site.service[Jobs].get(job)
        assert [(slot.job, slot.state) for slot in site.slots(schedule)] == [(job, "done")]
        assert len(site.calibrations.proposed) == 1


def test_a_database_that_cannot_be_reached_is_waited_for_and_not_taken_for_damage(tmp_path: Path, url: str) -> None:
    """No address for the name, a closed port: what a host sees while the other one starts."""
    reasons: list[str] = []

    class EnoughError(Exception):
        pass

    def pause(why: str) -> None:
        reasons.append(why)
        if len(reasons) == 2:
            raise EnoughError

    for away_url in ("postgresql://hilfit@no-such-host.invalid/hilfit", "postgresql://hilfit@127.0.0.1:1/hilfit"):
        reasons.clear()
        with pytest.raises(EnoughError):
            Database(away_url, TABLES, changed=nothing, backups=tmp_path, pause=pause)
        assert len(set(reasons)) == 1 and "cannot be reached" in reasons[0] and "move it away" not in reasons[0]
        with pytest.raises(StartError, match="cannot be reached"):
            Database(away_url, TABLES, changed=nothing, backups=tmp_path)
        # The workflow engine asks this of every error that it waits after.
        with pytest.raises(sa.exc.DBAPIError) as failed, sa.create_engine(copies.postgresql_url(away_url)).connect():
            pass
        assert failed.value.connection_invalidated


def test_a_wrong_password_is_refused_with_what_to_do(tmp_path: Path, url: str) -> None:
    waited: list[str] = []
    wrong = sa.make_url(url).set(password="wrong").render_as_string(hide_password=False)
    with pytest.raises(StartError, match="database_password_file") as refused:
        Database(wrong, TABLES, changed=nothing, backups=tmp_path, pause=waited.append)
    assert waited == [] and "move it away" not in str(refused.value) and "wrong@" not in str(refused.value)


def test_a_worker_changes_no_store_of_an_older_version(tmp_path: Path, url: str) -> None:
    Database(url, TABLES, changed=nothing, backups=tmp_path).close()
    run_sql(url, "UPDATE store_version SET version = 2")
    with pytest.raises(StartError, match="no server of this version has used it yet"):
        Database(url, TABLES, changed=nothing, backups=tmp_path, may_migrate=False)
    assert list(tmp_path.iterdir()) == []
